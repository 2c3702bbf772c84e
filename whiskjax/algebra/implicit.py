"""Numbers that were found by an iteration: their derivatives follow from the equations that they solve, not from its steps."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from .vectors import Component, columns, mul, sub


def implicit(equations: Callable[..., Sequence[Component]], x: Sequence[Component], *given: Any) -> tuple[Component, ...]:
    """x, which solves g(x, a) = 0 element by element, with the derivative that the equations imply: dx = -(dg/dx)^-1 (dg/da) da.

    The rule differentiates g where x stands, and x there is again one that this rule differentiates: so derivatives exist to
    every order, in both modes, and each is right to what x itself is. (A last step of Newton on a constant start gives the first
    derivative alone.) Where dg/dx is singular the derivative is finite, and means nothing.

    **Arguments:**

    - `equations`: g(x, *given) -> as many components as x has, one or two, of its batch shape. A plain function: what it closes
      over is not differentiated.
    - `x`: found by whatever means from `jax.lax.stop_gradient(given)`; float arrays of the full batch shape.
    - `given`: pytrees, of which only arrays are differentiated: whole sensors and shots, structural zeros, None.

    **Returns:** the same numbers as `x`.
    """
    residual, leaves = _of_leaves(equations, given)
    return _solution(residual, _elementwise, tuple(jax.lax.stop_gradient(c) for c in x), *leaves)


def stationary(slope: Callable[..., Any], x: Any, *given: Any, solve: Callable[..., Any] | None = None) -> Any:
    """As `implicit`, of a vector x at which a cost is least: its slope g(x, a) is zero, and dx = -H^-1 (dg/da) da.

    H, the derivative of the slope, is the whole Hessian, with the curvature of the residuals. One solution with it, whatever the
    iteration was that found x.

    **Arguments:**

    - `slope`: g(x, *given), (k,); or of the structure of x, where `solve` knows it.
    - `solve`: (g, x, change) -> -H^-1 change, for a Hessian that is not to be written down whole.
    """
    residual, leaves = _of_leaves(slope, given)
    return _solution(residual, _by_hessian if solve is None else solve, jax.lax.stop_gradient(x), *leaves)


def _of_leaves(equations: Callable[..., Any], given: Any) -> tuple[Callable[..., Any], list[Any]]:
    """The equations as a function of x and the arrays in what is given, and those arrays."""
    arrays, rest = eqx.partition(given, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)

    def residual(x: Any, leaves: Sequence[Any]) -> Any:
        return equations(x, *eqx.combine(jax.tree.unflatten(structure, leaves), rest))

    return residual, leaves


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _solution(residual: Callable[..., Any], solve: Callable[..., Any], x: Any, *leaves: Any) -> Any:
    return x


@partial(_solution.defjvp, symbolic_zeros=True)
def _solution_jvp(residual, solve, primals, tangents):
    found, *leaves = primals
    x = _solution(residual, solve, found, *leaves)
    # What does not move is left out, rather than multiplied by zeros: a sensor has many numbers, of which few are asked.
    moving = {i: t for i, t in enumerate(tangents[1:]) if not isinstance(t, SymbolicZero)}

    def with_moved(*values: Any) -> Any:
        moved = dict(zip(moving, values, strict=True))
        return residual(x, [moved.get(i, leaf) for i, leaf in enumerate(leaves)])

    _, change = jax.jvp(with_moved, tuple(leaves[i] for i in moving), tuple(moving.values()))
    return x, solve(lambda x: residual(x, leaves), x, change)


def _elementwise(residual: Callable[..., Any], x: tuple[Component, ...], change: Sequence[Component]) -> tuple[Component, ...]:
    by_x = columns(lambda *x: tuple(residual(x)), x)
    return tuple(jnp.broadcast_to(-d, c.shape) for d, c in zip(_solve(by_x, tuple(change)), x, strict=True))


def _by_hessian(slope: Callable[..., Any], x: Float[Array, " k"], change: Float[Array, " k"]) -> Float[Array, " k"]:
    return -jnp.linalg.solve(jax.jacfwd(slope)(x), change)


def _solve(by_x: Sequence[Sequence[Component]], right: Sequence[Component]) -> tuple[Component, ...]:
    """Solve one or two equations; by_x holds the columns of their matrix."""
    if len(right) == 1:
        return (right[0] / _nonzero(by_x[0][0]),)
    (a, c), (b, d) = by_x
    determinant = _nonzero(sub(mul(a, d), mul(b, c)))
    p, q = right
    return sub(mul(d, p), mul(b, q)) / determinant, sub(mul(a, q), mul(c, p)) / determinant


def _nonzero(a: Component) -> Component:
    a = jnp.asarray(a, dtype=float)
    return jnp.where(a == 0, 1.0, a)
