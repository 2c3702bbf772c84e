"""A fence for the compiler."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

T = TypeVar("T")


def once(holds: Bool[Array, ""], of: Callable[[], T]) -> T:
    """of(), with every value that it returns evaluated once.

    XLA on the CPU evaluates cheap arithmetic again in every loop that uses it, and a chain is one long piece of cheap arithmetic;
    but it does not look across a conditional. (`jax.lax.optimization_barrier` is no such fence: it is dropped before loops fuse.)

    **Arguments:** `holds`: a condition that always holds, and of which the compiler cannot know it. Under `vmap` it must not be
    batched, or both branches are computed.
    """
    shapes = jax.eval_shape(of)
    return jax.lax.cond(holds, of, lambda: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes))
