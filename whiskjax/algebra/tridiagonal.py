"""Block tridiagonal systems on the host: cyclic reduction, whose every step is one operation on whole arrays."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float


def tridiagonal_solver(
    lower: Float[np.ndarray, "n k k"], diagonal: Float[np.ndarray, "n k k"], upper: Float[np.ndarray, "n k k"]
) -> Callable[[Float[np.ndarray, "n k m"]], Float[np.ndarray, "n k m"]]:
    """What solves lower[i] x[i - 1] + diagonal[i] x[i] + upper[i] x[i + 1] = right[i], for one right side after another.

    Rows 1, 3, 5 ... are freed of their neighbours and are then a system of the same kind and half the size: log2(n) rounds,
    where numpy takes a loop from the first row to the last a second for every 100,000 rows. Stable without pivots where the
    diagonal dominates, as it does in splines. lower[0] and upper[-1] are taken as zero.
    """
    n = len(diagonal)
    if n == 1:
        return lambda right: np.linalg.solve(diagonal, right)
    lower, upper = lower.copy(), upper.copy()
    lower[0] = upper[-1] = 0
    even, odd = slice(0, None, 2), slice(1, None, 2)
    # Every odd row has an even one before it; `m` of them, all but the last of an even n, have one after it too.
    inverse, rows = np.linalg.inv(diagonal[even]), n // 2
    m = len(inverse) - 1
    before = lower[odd] @ inverse[:rows]
    after = upper[odd][:m] @ inverse[1:]
    inner_diagonal = diagonal[odd] - before @ upper[even][:rows]
    inner_diagonal[:m] -= after @ lower[even][1:]
    inner_upper = np.zeros_like(before)
    inner_upper[: len(after)] = -after @ upper[even][1:]
    inner = tridiagonal_solver(-before @ lower[even][:rows], inner_diagonal, inner_upper)

    def solve(right: Float[np.ndarray, "n k m"]) -> Float[np.ndarray, "n k m"]:
        x, rest, inner_right = np.empty_like(right), right[even].copy(), right[odd] - before @ right[even][:rows]
        inner_right[:m] -= after @ right[even][1:]
        x[odd] = inner(inner_right)
        rest[:rows] -= upper[even][:rows] @ x[odd]
        rest[1:] -= lower[even][1:] @ x[odd][:m]
        x[even] = inverse @ rest
        return x

    return solve
