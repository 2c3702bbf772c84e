"""Gauss-Newton on the reduced normal equations, damped where a step would climb."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...algebra.vectors import Vec3
from ...rules import RESULTS, arrays_of, compiled
from ...rules.progress import tell
from ...rules.results import codes_of
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


class Solved(eqx.Module):
    """The state at the optimum, the equations there, the number of steps that were taken, and how the iteration ended."""

    state: State
    reduced: Reduced
    steps: Any
    result: RESULTS


def equations(ready: Ready, state: State) -> tuple[Reduced, Vec3]:
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


reduce = compiled(equations, lambda ready, state: ready.rays)


class Iteration(eqx.Module):
    """Where the iteration is: the state with its equations and its moved points, and what is evaluated next.

    - `target`: the state to be evaluated: a step (`tries`), or the state itself where its points have arrived.
    - `step`, `move`: the Gauss-Newton step, and what is taken of it or foretold from it (`foretold`); `decrement`: what the step
      should take off the cost.
    - `before`: the last move and the Gauss-Newton step there, where there are (`remembers`).
    - `code`: negative while it goes on, else the result.
    """

    state: State
    reduced: Reduced
    points: Vec3
    target: State
    step: Float[Array, " m"]
    move: Float[Array, " m"]
    decrement: Float[Array, ""]
    last: Float[Array, ""]
    damping: Float[Array, ""]
    before: tuple[Float[Array, " m"], Float[Array, " m"]]
    tries: Bool[Array, ""]
    foretold: Bool[Array, ""]
    remembers: Bool[Array, ""]
    tried: Int[Array, ""]
    steps: Int[Array, ""]
    most: Int[Array, ""]
    code: Int[Array, ""]


def gauss_newton(ready: Ready, state: State, max_steps: int = 30) -> Solved:
    """Minimise from a state; pure, and not to be differentiated (derivative.py).

    A step that raises the cost is taken back and damped (Levenberg); of steps that shrink slowly two foretell the next ones. One
    compiled function evaluates and judges; outside of tracing the host asks for it again and again, and tells how far it is.

    **Arguments:** `max_steps`: that are tried, taken or not.
    """
    now = _begin(state, max_steps)
    if arrays_of((ready, state)) is jnp:
        now = jax.tree.map(jnp.asarray, now)
        now = jax.lax.while_loop(lambda now: now.code < 0, lambda now: _advance(ready, now), now)
        return Solved(now.state, now.reduced, now.steps, jax.tree.map(lambda _: now.code, RESULTS.successful))
    tell("adjust: first equations (the first time compiled)")
    while int(now.code) < 0:
        now = _advance_compiled(ready, now)
        if int(now.tried):
            tell(f"adjust: step {int(now.tried)}, sum of squares {float(now.reduced.cost):.6g}")
    return Solved(now.state, now.reduced, int(now.steps), jax.tree.map(lambda _: np.asarray(now.code), RESULTS.successful))


def _begin(state: State, max_steps: int) -> Iteration:
    size = state.x.size + state.u.size
    nothing, number = np.zeros(size), np.zeros(())
    none: Any = (np.zeros((size, size)), np.zeros((size, size)), nothing, number)
    reduced = Reduced(*none)
    no, count = np.zeros((), dtype=bool), np.zeros((), dtype=np.int32)
    most, going = np.asarray(max_steps, dtype=np.int32), np.asarray(-1, dtype=np.int32)
    ahead: Any = (nothing, nothing, number, np.asarray(np.inf), number, (nothing, nothing), no, no, no, count, count, most, going)
    return Iteration(state, reduced, state.points, state, *ahead)


def _advance(ready: Ready, now: Iteration) -> Iteration:
    """Evaluate the target, take it or take it back, and say what comes next."""
    there, relaxed = equations(ready, now.target)
    cost = now.reduced.cost
    climbs = ~(there.cost <= cost * (1 + _SAME_COST))
    back = now.tries & climbs & (now.foretold | (now.decrement > jnp.maximum(_ROUNDING, _SAME_COST * cost)))
    taken = now.tries & ~back

    def unless_back(new: Any, old: Any) -> Any:
        return jax.tree.map(lambda a, b: jnp.where(back, b, a), new, old)

    # The cost of a state was that of points moved to first order: compare with it where they have arrived.
    here = State(now.state.x, now.state.u, now.points)
    state = unless_back(now.target, here)
    reduced, points = unless_back((there, relaxed), (now.reduced, now.points))
    stalls = (now.decrement < _ROUNDING) & (now.decrement > 0.25 * now.last)
    settled = taken & (now.damping == 0) & ((now.decrement < _SETTLED) | stalls)
    harder = jnp.maximum(10 * now.damping, _FIRST_DAMPING)
    softer = jnp.where(now.damping > _LEAST_DAMPING, now.damping / 10, 0.0)
    damping = jnp.where(back & ~now.foretold, harder, jnp.where(taken, softer, now.damping))
    before, remembers = (now.move, now.step), taken
    last = jnp.where(taken, now.decrement, now.last)
    tried = now.tried + now.tries.astype(now.tried.dtype)

    damping, step = jax.lax.while_loop(
        lambda at: ~jnp.isfinite(at[1]).all() & (at[0] <= _MOST_DAMPING) & ~back & jnp.isfinite(reduced.matrix).all(),
        lambda at: damped(reduced, jnp.maximum(10 * at[0], _FIRST_DAMPING)),
        damped(reduced, damping),
    )
    decrement = step @ reduced.right
    slow = (jnp.maximum(_ROUNDING, _SLOWLY * last) < decrement) & (decrement < _NEAR * reduced.cost)
    foretold = remembers & (damping == 0) & slow
    move = jnp.where(foretold, _ahead(reduced.matrix, step, *before), step)
    size = state.x.size
    onwards = State(state.x + move[:size].reshape(state.x.shape), state.u + move[size:], points)
    target = jax.tree.map(lambda a, b: jnp.where(back, b, a), onwards, here)

    failed = ~back & ~jnp.isfinite(step).all()
    unknown = (tried == 0) & ~jnp.isfinite(reduced.matrix).all()
    code = jnp.where(back & (damping > _MOST_DAMPING), _code(RESULTS.not_converged), -1)
    code = jnp.where(~back & (tried >= now.most), _code(RESULTS.not_converged), code)
    code = jnp.where(failed, jnp.where(unknown, _code(RESULTS.nonfinite), _code(RESULTS.rank_deficient)), code)
    code = jnp.where(settled, _code(RESULTS.successful), code).astype(jnp.int32)
    ended = code >= 0
    # Where it ends by a step that was taken, or for want of further ones, the points have moved on with it.
    arrived = State(state.x, state.u, points)
    return Iteration(
        state=jax.tree.map(lambda a, b: jnp.where(ended & ~failed, a, b), arrived, state),
        reduced=reduced,
        points=points,
        target=target,
        step=step,
        move=move,
        decrement=decrement,
        last=last,
        damping=damping,
        before=before,
        tries=~back,
        foretold=foretold & ~back,
        remembers=remembers,
        tried=tried,
        steps=now.steps + taken.astype(now.steps.dtype),
        most=now.most,
        code=code,
    )


_advance_compiled = compiled(_advance, lambda ready, now: ready.rays)


def _code(result: RESULTS) -> int:
    return int(codes_of(result))


def damped(reduced: Reduced, damping: Array) -> tuple[Array, Array]:
    """The damping, and the step with it."""
    matrix = reduced.matrix + damping * jnp.eye(reduced.matrix.shape[0])
    return damping, jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), reduced.right)


def _ahead(matrix: Array, step: Array, last_move: Array, last_step: Array) -> Array:
    """Where two Gauss-Newton steps in a row lead (Anderson 1965, over one step back, in the metric of the normal matrix).

    Where residuals stay large and the model is curved, as a delay sees the noise of POS, Gauss-Newton steps shrink by a constant
    factor r only; along one direction this is their sum r + r^2 + ...
    """
    change = step - last_step
    length = change @ matrix @ change
    share = (step @ matrix @ change) / jnp.where(length == 0, 1.0, length)
    return step - share * (last_move + change)
