"""The minimum of a calibration as a pure function of all that goes in: under jit, vmap and every derivative.

One problem is solved by Levenberg-Marquardt. Under vmap each lane takes Gauss-Newton steps on small normal equations and stops
where it has converged (a Levenberg-Marquardt under vmap runs to its slowest lane, and pays for both of its branches). What the
iteration did is not differentiated: the solution is where the slope of the cost vanishes, and that equation implies how it
follows everything else. Weights are those of the problem that is given, and held where the iteration would change them.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float

from ..algebra.implicit import stationary
from ..rules import RESULTS, once
from .least_squares import Solved, converge, judge, observed_rows
from .least_squares import levenberg_marquardt as plain_marquardt
from .problem import Problem, residuals

# Gauss-Newton steps after the solver, while they are this small (of a prior sigma or scale).
POLISH, NEAR = 3, 1e-2
_LANE_STEPS, _SIDE_BY_SIDE = 12, 10
_NULL = 1e-13  # of the largest singular value: what rounding leaves of a direction that nothing determines
_FAR = 1e9  # a bound of a robust loss under which it is least squares


def solution(problem: Problem, start: Float[Array, " k"], max_steps: int = 100) -> Solved:
    """The whitened unknowns at the minimum, differentiable by every array of the problem to every order.

    **Arguments:** `problem`: baked and weighed; `start`: whitened.
    """
    found = _search(*jax.lax.stop_gradient(_dynamic((problem, start))), static=_static((problem, start)), max_steps=max_steps)
    return found._replace(u=stationary(_slope, found.u, problem))


def _slope(u: Float[Array, " k"], problem: Problem) -> Float[Array, " k"]:
    """Of half the sum of squares."""

    def cost(u: Array) -> Array:
        # Evaluated once, so that the derivative finds what it needs instead of evaluating the chain again.
        observed, prior = once(lambda: residuals(u, problem))
        return 0.5 * (sum((x * x + y * y).sum() for x, y in observed) + prior @ prior)

    return jax.grad(cost)(u)


def _dynamic(tree: Any) -> list[Array]:
    return jax.tree.leaves(eqx.filter(tree, eqx.is_array))


def _static(tree: Any) -> tuple[Any, Any]:
    arrays, static = eqx.partition(tree, eqx.is_array)
    return jax.tree.structure(arrays), static


def _search(*leaves: Array, static: tuple[Any, Any], max_steps: int) -> Solved:
    structure, rest = static

    def of(solve: Any, *leaves: Array) -> tuple[Array, Array, Array]:
        problem, start = eqx.combine(jax.tree.unflatten(structure, leaves), rest)
        u, steps, result = solve(problem, start)
        return u, steps, jax.tree.leaves(result)[0]

    @custom_vmap
    def one(*leaves: Array):
        return of(lambda problem, start: alone(problem, start, max_steps), *leaves)

    @one.def_vmap
    def many(size: int, is_batched: list[bool], *leaves: Array):
        batched = [leaf for leaf, b in zip(leaves, is_batched, strict=True) if b]

        def lane(own: list[Array]):
            left = iter(own)
            return of(in_lane, *(next(left) if b else leaf for leaf, b in zip(leaves, is_batched, strict=True)))

        return jax.lax.map(lane, batched, batch_size=min(size, _SIDE_BY_SIDE)), (True, True, True)

    u, steps, code = one(*leaves)
    return Solved(u, steps, jax.tree.map(lambda _: code, RESULTS.successful))


def levenberg_marquardt(problem: Problem, start: Float[Array, " k"], max_steps: int) -> Solved:
    """optimistix's; under a robust loss from the least-squares solution on, where few points are far off."""
    before = 0
    if problem.loss is not None:
        wide = plain_marquardt(_bounded(problem), start, max_steps)
        start, before = wide.u, wide.steps
    found = plain_marquardt(problem, start, max_steps)
    return found._replace(steps=before + found.steps)


def alone(problem: Problem, start: Float[Array, " k"], max_steps: int) -> Solved:
    """One problem, by Levenberg-Marquardt, and the rest of the way by Gauss-Newton; not to be differentiated."""
    found = levenberg_marquardt(problem, start, max_steps)

    def polish(_: Any, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        u, moves = carry
        step = _step(problem, u)
        moves = moves & (jnp.abs(step).max() < NEAR)
        return jnp.where(moves, u + step, u), moves

    u, _ = jax.lax.fori_loop(0, POLISH, polish, (found.u, jnp.ones((), dtype=bool)))
    return Solved(u, found.steps.astype(jnp.int32), found.result)


def in_lane(problem: Problem, start: Float[Array, " k"]) -> Solved:
    """One of many problems, by Gauss-Newton until it has converged; lanes that have wait for the others."""
    if problem.loss is not None:
        start = converge(_bounded(problem), start, _LANE_STEPS)[0].u
    found, steps = converge(problem, start, _LANE_STEPS)
    return Solved(found.u, steps, judge(found))


def _bounded(problem: Problem) -> Problem:
    return eqx.tree_at(lambda p: p.loss.bound, problem, jnp.full((), _FAR))


def rows_of(problem: Problem, u: Float[Array, " k"]) -> Float[Array, "rows k+1"]:
    """Whitened derivatives of all residuals, priors included, and the residuals in the last column."""
    parts = [part.T for pair in observed_rows(problem, u) for part in pair]
    root = problem.unknowns.root
    return jnp.concatenate([*parts, jnp.concatenate([root, (root @ u)[:, None]], axis=1)])


def _step(problem: Problem, u: Float[Array, " k"]) -> Float[Array, " k"]:
    """The Gauss-Newton step, by orthogonal decomposition; directions that nothing determines are left alone."""
    k = u.shape[0]
    triangle = jnp.linalg.qr(rows_of(problem, u), mode="r")
    left, values, right = jnp.linalg.svd(triangle[:k, :k])
    fine = values > _NULL * values[0]
    along = jnp.where(fine, left.T @ triangle[:k, k], 0.0) / jnp.where(fine, values, 1.0)
    return -right.T @ along
