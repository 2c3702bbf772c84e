"""Block tridiagonal systems: cyclic reduction, whose every step is one operation on whole arrays."""

from collections.abc import Callable
from typing import Any

from jaxtyping import Float

from ..rules import arrays_of


def tridiagonal_solver(
    lower: Float[Any, "n k k"], diagonal: Float[Any, "n k k"], upper: Float[Any, "n k k"]
) -> Callable[[Float[Any, "n k m"]], Float[Any, "n k m"]]:
    """What solves lower[i] x[i - 1] + diagonal[i] x[i] + upper[i] x[i + 1] = right[i], for one right side after another.

    Rows 1, 3, 5 ... are freed of their neighbours and are then a system of the same kind and half the size: log2(n) rounds,
    where numpy takes a loop from the first row to the last a second for every 100,000 rows. Stable without pivots where the
    diagonal dominates, as it does in splines. lower[0] and upper[-1] are taken as zero.
    """
    n, math = len(diagonal), arrays_of((lower, diagonal, upper))
    if n == 1:
        return lambda right: arrays_of((diagonal, right)).linalg.solve(diagonal, right)
    even, odd = slice(0, None, 2), slice(1, None, 2)
    # Every odd row has an even one before it; `m` of them, all but the last of an even n, have one after it too.
    inverse, rows = math.linalg.inv(diagonal[even]), n // 2
    m = len(inverse) - 1
    before = lower[odd] @ inverse[:rows]
    after = _filled(upper[odd][:m] @ inverse[1:], rows)
    # What an odd row takes of the even one after it; there is none after the last of an even n.
    next_upper, next_lower = _filled(upper[even][1:], rows), _filled(lower[even][1:], rows)
    inner_diagonal = diagonal[odd] - before @ upper[even][:rows] - after @ next_lower
    inner = tridiagonal_solver(-before @ lower[even][:rows], inner_diagonal, -after @ next_upper)

    def solve(right: Float[Any, "n k m"]) -> Float[Any, "n k m"]:
        math, of_even = arrays_of((inverse, right)), right[even]
        found = inner(right[odd] - before @ of_even[:rows] - after @ _filled(of_even[1:], rows))
        from_before, from_after = lower[even][1:] @ found[:m], upper[even][:rows] @ found
        nothing = math.zeros_like(of_even[:1])
        rest = of_even - math.concatenate([nothing, from_before]) - _filled(from_after, len(of_even))
        pairs = math.stack([inverse @ rest, _filled(found, len(of_even))], axis=1)
        return pairs.reshape(-1, *right.shape[1:])[:n]

    return solve


def _filled(blocks: Float[Any, "m k l"], n: int) -> Float[Any, "n k l"]:
    """With a block of zeros behind them where one lacks."""
    math = arrays_of(blocks)
    return blocks if len(blocks) == n else math.concatenate([blocks, math.zeros((n - len(blocks), *blocks.shape[1:]))])
