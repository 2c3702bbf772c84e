"""A fence for the compiler: what is made in it is made once."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp


def once(of: Callable[[], Any]) -> Any:
    """of(), evaluated once: XLA on the CPU evaluates a chain again in each loop that uses it, but not across a conditional.

    What stands in it comes out as numbers, whatever is asked of them. The condition is true, which the compiler cannot know: a
    barrier hides the constant until conditions are no longer simplified. To be called while tracing; `of` returns any pytree.
    """
    certain = jax.lax.optimization_barrier(jnp.ones((), dtype=bool))
    rest = []

    def arrays() -> Any:
        found, other = eqx.partition(of(), eqx.is_array)
        rest.append(other)
        return found

    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(arrays))
    return eqx.combine(jax.lax.cond(certain, arrays, lambda: nothing), rest[-1])
