"""Gauss-Newton on the reduced normal equations, damped where a step would climb."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...algebra.vectors import Vec3
from ...rules import RESULTS
from ...rules.progress import tell
from .normal import accumulate
from .prepare import Ready, State

# Of the decrement step . right side: what the step should take off the cost, and the squared length of the step in sigmas.
_SETTLED = 1e-14
_ROUNDING = 1e-8  # below it a decrement that no longer shrinks is rounding
_SAME_COST = 1e-10  # relative: below it a rise is rounding
_SLOWLY = 0.25  # a decrement of more than this part of the last one ...
_NEAR = 1e-3  # ... and less than this part of the cost: steps near the end, in one direction, of which two foretell the others
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-7, 1e12


class Reduced(eqx.Module):
    """Normal matrix, right side and cost of stations (axis by axis) and unknowns, points eliminated and priors included.

    `cost` is the sum of squared whitened residuals with the points at their optimum; `observed` is the normal matrix of the rays
    and control points alone.
    """

    observed: Float[Array, "m m"]
    matrix: Float[Array, "m m"]
    right: Float[Array, " m"]
    cost: Float[Array, ""]


class Solved(NamedTuple):
    """The state at the optimum, the equations there, the number of steps that were taken, and how the iteration ended."""

    state: State
    reduced: Reduced
    steps: int
    result: RESULTS


@eqx.filter_jit
def reduce(ready: Ready, state: State) -> tuple[Reduced, Vec3]:
    """The reduced equations at a state, and the points moved to their optimum."""
    stations, q = state.x.shape[1], state.u.shape[0]
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)
    normal, points = accumulate(sensor, ready.unknowns, ready.tiles, state.points)
    m = 6 * stations
    half = normal.half.reshape(m, m)
    border = normal.border.reshape(m, q + 1)
    corner = normal.corner
    observed = jnp.block([[half + half.T, border[:, :q]], [border[:, :q].T, corner[:q, :q]]])
    right = jnp.concatenate([border[:, q], corner[:q, q]])
    residual = jnp.einsum("aek,ak->ae", ready.roots, state.x)
    information = jnp.einsum("aei,aej->aij", ready.roots, ready.roots)
    matrix = observed
    for a in range(6):
        place = slice(a * stations, (a + 1) * stations)
        matrix = matrix.at[place, place].add(information[a])
    pull = ready.unknowns.others.information
    slope = pull @ state.u
    matrix = matrix.at[m:, m:].add(pull)
    right = right - jnp.concatenate([jnp.einsum("aek,ae->ak", ready.roots, residual).ravel(), slope])
    cost = corner[q, q] + (residual**2).sum() + slope @ state.u
    return Reduced(observed, matrix, right, cost), points


@jax.jit
def _step(matrix: Array, right: Array, damping: Array) -> Array:
    damped = matrix + damping * jnp.eye(matrix.shape[0])
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(damped), right)


@jax.jit
def _ahead(matrix: Array, step: Array, last_move: Array, last_step: Array) -> Array:
    """Where two Gauss-Newton steps in a row lead (Anderson 1965, over one step back, in the metric of the normal matrix).

    Where residuals stay large and the model is curved, as a delay sees the noise of POS, Gauss-Newton steps shrink by a constant
    factor r only; along one direction this is their sum r + r^2 + ...
    """
    change = step - last_step
    length = change @ matrix @ change
    share = (step @ matrix @ change) / jnp.where(length == 0, 1.0, length)
    return step - share * (last_move + change)


def gauss_newton(ready: Ready, state: State, max_steps: int = 30) -> Solved:
    """Minimise from a state.

    A step that raises the cost is taken back and damped (Levenberg); of steps that shrink slowly two foretell the next ones.

    **Arguments:** `max_steps`: that are tried, taken or not.
    """
    tell("adjust: first equations (the first time compiled)")
    reduced, points = reduce(ready, state)
    damping, tried, steps, last = 0.0, 0, 0, np.inf
    before = None  # the last move, and the Gauss-Newton step there
    while tried < max_steps:
        step = np.asarray(_step(reduced.matrix, reduced.right, jnp.asarray(damping)))
        if not np.isfinite(step).all():
            if tried == 0 and not np.isfinite(np.asarray(reduced.matrix)).all():
                return Solved(state, reduced, steps, RESULTS.nonfinite)
            if damping > _MOST_DAMPING:
                return Solved(state, reduced, steps, RESULTS.rank_deficient)
            damping = max(10 * damping, _FIRST_DAMPING)
            continue
        decrement, cost = float(step @ np.asarray(reduced.right)), float(reduced.cost)
        size, move = state.x.size, step
        slow = max(_ROUNDING, _SLOWLY * last) < decrement < _NEAR * cost
        foretold = before is not None and damping == 0.0 and slow
        if foretold:
            move = np.asarray(_ahead(reduced.matrix, step, *before))
        moved = State(state.x + move[:size].reshape(state.x.shape), state.u + move[size:], points)
        there, relaxed = reduce(ready, moved)
        tried += 1
        tell(f"adjust: step {tried}, sum of squares {float(there.cost):.6g}")
        climbs = not float(there.cost) <= cost * (1 + _SAME_COST)
        if climbs and (foretold or decrement > max(_ROUNDING, _SAME_COST * cost)):
            damping = damping if foretold else max(10 * damping, _FIRST_DAMPING)
            before = None
            if damping > _MOST_DAMPING:
                return Solved(state, reduced, steps, RESULTS.not_converged)
            # The cost there was that of points moved to first order: compare with it where they have arrived.
            state = State(state.x, state.u, points)
            reduced, points = reduce(ready, state)
            continue
        state, reduced, points, steps, before = moved, there, relaxed, steps + 1, (move, step)
        stalls = decrement < _ROUNDING and decrement > 0.25 * last
        if damping == 0.0 and (decrement < _SETTLED or stalls):
            return Solved(State(state.x, state.u, points), reduced, steps, RESULTS.successful)
        damping, last = (damping / 10 if damping > _LEAST_DAMPING else 0.0), decrement
    return Solved(State(state.x, state.u, points), reduced, steps, RESULTS.not_converged)
