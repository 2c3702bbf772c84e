"""Vectors and 3x3 matrices as tuples of components.

A component is an array of any batch shape (struct of arrays), so every formula is elementwise: it needs no `vmap`, has no
batch-axis convention, and XLA fuses it into one vectorised loop (3.5 times the looks a second of (3, 3) arrays). Exact
zeros and ones are the Python ints 0, 1 and -1. They are folded while tracing, so a product of elementary rotations, or one
column of a Jacobian, costs what a hand-written one costs.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

# Float[Array, "..."] or one of the ints 0, 1, -1; which of them is decided while tracing, where a type checker cannot follow.
Component: TypeAlias = Any
Vec2: TypeAlias = tuple[Component, ...]
Vec3: TypeAlias = tuple[Component, ...]
Mat3: TypeAlias = tuple[Vec3, ...]

IDENTITY: Mat3 = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
ZERO: Vec3 = (0, 0, 0)


def is_structural(a: Component, value: int) -> bool:
    """Whether a component is known, while tracing, to be exactly this integer."""
    return type(a) is int and a == value


def neg(a: Component) -> Component:
    """-a."""
    return -a


def add(a: Component, b: Component) -> Component:
    """a + b."""
    if is_structural(a, 0):
        return b
    return a if is_structural(b, 0) else a + b


def sub(a: Component, b: Component) -> Component:
    """a - b."""
    if is_structural(a, 0):
        return -b
    return a if is_structural(b, 0) else a - b


def mul(a: Component, b: Component) -> Component:
    """a * b."""
    for p, q in ((a, b), (b, a)):
        if is_structural(p, 0):
            return 0
        if is_structural(p, 1):
            return q
        if is_structural(p, -1):
            return -q
    return a * b


def total(terms: Iterable[Component]) -> Component:
    """Sum of components."""
    s: Component = 0
    for t in terms:
        s = add(s, t)
    return s


def dot(u: Sequence[Component], v: Sequence[Component]) -> Component:
    """Scalar product of two vectors of one length."""
    return total(mul(a, b) for a, b in zip(u, v, strict=True))


def vadd(u: Sequence[Component], v: Sequence[Component]) -> Any:
    """u + v."""
    return tuple(add(a, b) for a, b in zip(u, v, strict=True))


def vsub(u: Sequence[Component], v: Sequence[Component]) -> Any:
    """u - v."""
    return tuple(sub(a, b) for a, b in zip(u, v, strict=True))


def scale(s: Component, v: Sequence[Component]) -> Any:
    """s v."""
    return tuple(mul(s, a) for a in v)


def cross(u: Vec3, v: Vec3) -> Vec3:
    """u x v."""
    x, y, z = (sub(mul(u[i], v[j]), mul(u[j], v[i])) for i, j in ((1, 2), (2, 0), (0, 1)))
    return x, y, z


def norm(v: Sequence[Component]) -> Component:
    """Euclidean length."""
    return jnp.sqrt(dot(v, v))


def transpose(m: Sequence[Sequence[Component]]) -> Any:
    """Rows become columns."""
    return tuple(zip(*m, strict=True))


def apply(m: Sequence[Sequence[Component]], v: Sequence[Component]) -> Any:
    """Matrix times vector."""
    return tuple(dot(row, v) for row in m)


def matmul(m: Sequence[Sequence[Component]], n: Sequence[Sequence[Component]]) -> Any:
    """Matrix times matrix."""
    columns = transpose(n)
    return tuple(tuple(dot(row, column) for column in columns) for row in m)


def unstack(x: Float[ArrayLike, "... n"]) -> tuple[Float[Array, "..."], ...]:
    """Components of an array along its last axis; numpy takes its own arrays apart, without a compiled function for each."""
    if isinstance(x, np.ndarray):
        return tuple(jnp.asarray(np.array(x[..., i])) for i in range(x.shape[-1]))
    x = jnp.asarray(x)
    return tuple(x[..., i] for i in range(x.shape[-1]))


def stack(components: Sequence[Component]) -> Float[Array, "... n"]:
    """An array whose last axis holds the components; structural numbers and smaller batches are broadcast.

    A select over an iota instead of `jnp.stack`: around a concatenation XLA on the CPU recomputes, entry by entry and without
    vectors, all that leads to it (a projection took 1680 ns a point instead of 70).
    """
    arrays = jnp.broadcast_arrays(*[jnp.asarray(c, dtype=jnp.result_type(float)) for c in components])
    shape = (*arrays[0].shape, len(arrays))
    place = jax.lax.broadcasted_iota(jnp.int32, shape, len(shape) - 1)
    value = jnp.broadcast_to(arrays[-1][..., None], shape)
    for i, array in enumerate(arrays[:-1]):
        value = jnp.where(place == i, array[..., None], value)
    return value


def columns(f: Callable[..., Any], at: Sequence[Component], like: Component | None = None) -> tuple[Any, ...]:
    """Derivative of f(*components) -> tuple, one forward-mode column a component.

    `at` may hold structural zeros: the derivative is taken there without computing with them, so that products with zero
    never reach XLA. An output that is structural itself has structural zeros as its derivative.

    **Arguments:**

    - `like`: gives the batch shape where `at` is structural; by default the first component.
    """
    like = jnp.asarray(at[0] if like is None else like)

    def column(i: int) -> Any:
        x = jnp.zeros_like(like) if is_structural(at[i], 0) else jnp.asarray(at[i])
        _, d = jax.jvp(lambda v: f(*at[:i], v, *at[i + 1 :]), (x,), (jnp.ones_like(x),))
        return jax.tree.map(lambda e: 0 if e.dtype == jax.dtypes.float0 else e, d)

    return tuple(column(i) for i in range(len(at)))
