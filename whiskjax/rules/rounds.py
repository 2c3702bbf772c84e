"""A loop of so many rounds as an array says, which may have to be differentiated in reverse."""

from collections.abc import Callable
from typing import TypeVar

import jax
from jaxtyping import Array, Int

Carry = TypeVar("Carry")


def rounds(
    count: Int[Array, ""], most: int, once: Callable[[Array, Carry], Carry], start: Carry, reversible: bool = False
) -> Carry:
    """`once(0, ...)` to `once(count - 1, ...)`, one after the other; `count` is at most `most`.

    **Arguments:** `reversible`: for reverse mode the number of rounds has to be static, so it is `most`, and those beyond `count`
    do nothing. XLA cannot then work on large carries in place: a loop that is not differentiated does without.
    """
    if not reversible:
        return jax.lax.fori_loop(0, count, once, start)
    return jax.lax.fori_loop(0, most, lambda k, at: jax.lax.cond(k < count, once, lambda _, at: at, k, at), start)
