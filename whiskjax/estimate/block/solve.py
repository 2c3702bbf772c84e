"""Gauss-Newton on the reduced normal equations, damped where a step would climb."""

from collections.abc import Callable
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

    `cost` is the sum of squared whitened residuals with the points at their optimum.
    """

    matrix: Float[Array, "m m"]
    right: Float[Array, " m"]
    cost: Float[Array, ""]


class Solved(eqx.Module):
    """The state at the optimum, the equations there, the number of steps that were taken, and how the iteration ended."""

    state: State
    reduced: Reduced
    steps: Any
    result: RESULTS


def equations(ready: Ready, state: State, reversible: bool = False) -> tuple[Reduced, Vec3]:
    """The reduced equations at a state, and the points moved to their optimum."""
    stations, q = state.x.shape[1], state.u.shape[0]
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)
    normal, points = accumulate(sensor, ready.unknowns, ready.tiles, state.points, reversible)
    m = 6 * stations
    half = normal.half.reshape(m, m)
    border = normal.border.reshape(m, q + 1)
    corner = normal.corner
    matrix = jnp.block([[half + half.T, border[:, :q]], [border[:, :q].T, corner[:q, :q]]])
    right = jnp.concatenate([border[:, q], corner[:q, q]])
    groups, residual = len(ready.roots), ready.recorded(state.x)
    information = jnp.einsum("aei,aej->aij", ready.roots, ready.roots)
    for a in range(groups):
        place = slice(a * m // groups, (a + 1) * m // groups)
        matrix = matrix.at[place, place].add(information[a])
    pull = ready.unknowns.others.information
    slope = pull @ state.u
    matrix = matrix.at[m:, m:].add(pull)
    right = right - jnp.concatenate([jnp.einsum("aek,ae->ak", ready.roots, residual).ravel(), slope])
    cost = corner[q, q] + (residual**2).sum() + slope @ state.u
    return Reduced(matrix, right, cost), points


reduce = compiled(equations, lambda ready, state, reversible=False: ready.rays)


class Iteration(eqx.Module):
    """Where the iteration is: the state that was evaluated last, its moved points and cost, and what is evaluated next.

    - `target`: a step (`tries`), or where one is taken back what it started from, with the points where they arrived.
    - `step`, `move`: the Gauss-Newton step, and what is taken of it or foretold from it (`foretold`); `decrement`: what the step
      should take off the cost; `last`: what the one before it should have.
    - `code`: negative while it goes on, else the result.
    """

    state: State
    points: Vec3
    cost: Float[Array, ""]
    target: State
    step: Float[Array, " m"]
    move: Float[Array, " m"]
    decrement: Float[Array, ""]
    last: Float[Array, ""]
    damping: Float[Array, ""]
    tries: Bool[Array, ""]
    foretold: Bool[Array, ""]
    tried: Int[Array, ""]
    steps: Int[Array, ""]
    most: Int[Array, ""]
    code: Int[Array, ""]


def gauss_newton(ready: Ready, state: State, max_steps: int = 30) -> Solved:
    """Minimise from a state; pure, and not to be differentiated (derivative.py).

    A step that raises the cost is taken back and damped (Levenberg); of steps that shrink slowly two foretell the next ones.
    Outside of tracing the host asks again and again for the equations, judges them by the same code, and tells how far it is.

    **Arguments:** `max_steps`: that are tried, taken or not.
    """
    now = _begin(state, max_steps)
    if arrays_of((ready, state)) is jnp:

        def go(at: tuple[Iteration, Reduced]) -> tuple[Iteration, Reduced]:
            reduced, points = equations(ready, at[0].target)
            return _judged(at[0], reduced, points), reduced

        size = now.step.size
        nothing = Reduced(jnp.zeros((size, size)), jnp.zeros(size), jnp.zeros(()))
        now, reduced = jax.lax.while_loop(lambda at: at[0].code < 0, go, (jax.tree.map(jnp.asarray, now), nothing))
        return _solved(now, reduced, now.steps)
    tell("adjust: first equations (the first time compiled)")
    reduced: Any = None
    while now.code < 0:
        reduced, points = reduce(ready, now.target)
        with np.errstate(all="ignore"):  # what is no number is seen, and said
            now = _judged(now, *jax.tree.map(np.asarray, (reduced, points)))
        if now.tried:
            tell(f"adjust: step {int(now.tried)}, sum of squares {float(now.cost):.6g}")
    return _solved(now, reduced, int(now.steps))


def _solved(now: Iteration, reduced: Reduced, steps: Any) -> Solved:
    """What it ended with: the points have moved on with the last evaluation, unless that leads nowhere."""
    math = arrays_of(now)
    failed = (now.code == _code(RESULTS.rank_deficient)) | (now.code == _code(RESULTS.nonfinite))
    points = tuple(math.where(failed, old, new) for old, new in zip(now.state.points, now.points, strict=True))
    result = jax.tree.map(lambda _: math.asarray(now.code), RESULTS.successful)
    return Solved(State(now.state.x, now.state.u, points), reduced, steps, result)


def _begin(state: State, max_steps: int) -> Iteration:
    nothing, number = np.zeros(state.x.size + state.u.size), np.zeros(())
    endless: Any = np.asarray(np.inf)
    no, (count, most, going) = np.zeros((), dtype=bool), (np.asarray(i, dtype=np.int32) for i in (0, max_steps, -1))
    ahead: Any = (endless, state, nothing, nothing, number, endless, number, no, no, count, count, most, going)
    return Iteration(state, state.points, *ahead)


def _judged(now: Iteration, reduced: Reduced, points: Vec3) -> Iteration:
    """The target is taken or taken back, by the equations there; and what comes next.

    Normal matrices are large, so none is kept: where a step is taken back, what it started from is evaluated anew.
    """
    math = arrays_of((now, reduced))
    climbs = ~(reduced.cost <= now.cost * (1 + _SAME_COST))
    back = now.tries & climbs & (now.foretold | (now.decrement > math.maximum(_ROUNDING, _SAME_COST * now.cost)))
    taken = now.tries & ~back
    tried = now.tried + now.tries.astype(now.tried.dtype)
    stalls = (now.decrement < _ROUNDING) & (now.decrement > 0.25 * now.last)
    settled = taken & (now.damping == 0) & ((now.decrement < _SETTLED) | stalls)
    lost = ~back & (tried >= now.most) | ~now.tries & (now.damping > _MOST_DAMPING)
    last = math.where(taken, now.decrement, now.last)
    harder = math.maximum(10 * now.damping, _FIRST_DAMPING)
    softer = math.where(now.damping > _LEAST_DAMPING, now.damping / 10, 0.0)
    damping = math.where(back & ~now.foretold, harder, math.where(taken, softer, now.damping))

    goes_on, is_finite = ~(back | settled | lost), math.isfinite(reduced.matrix).all()
    damping, _, step, is_step = _repeated(
        lambda at: ~at[3] & (at[0] <= _MOST_DAMPING),
        lambda at: (at[1], math.maximum(10 * at[1], _FIRST_DAMPING), *_damped(reduced, math.asarray(at[1]))),
        (damping, damping, now.step, ~goes_on | ~is_finite),
    )
    decrement = step @ reduced.right
    slow = (math.maximum(_ROUNDING, _SLOWLY * last) < decrement) & (decrement < _NEAR * reduced.cost)
    foretold = goes_on & taken & (damping == 0) & slow
    move = step
    if math is jnp or foretold:
        move = math.where(foretold, _ahead(reduced.matrix, step, now.move, now.step), step)
    x, u = now.target.x, now.target.u
    onwards = State(x + move[: x.size].reshape(x.shape), u + move[x.size :], points)
    start = State(now.state.x, now.state.u, now.points)

    code = math.where(goes_on & ~is_step, _code(RESULTS.rank_deficient), -1)
    code = math.where(goes_on & ~is_finite, _code(RESULTS.nonfinite), code)
    code = math.where(lost, _code(RESULTS.not_converged), code)
    code = math.where(settled, _code(RESULTS.successful), code).astype(np.int32)
    return Iteration(
        state=now.target,
        points=points,
        cost=reduced.cost,
        target=jax.tree.map(lambda a, b: math.where(back, a, b), start, onwards),
        step=step,
        move=move,
        decrement=decrement,
        last=last,
        damping=damping,
        tries=~back,
        foretold=foretold,
        tried=tried,
        steps=now.steps + taken.astype(now.steps.dtype),
        most=now.most,
        code=code,
    )


def _code(result: RESULTS) -> int:
    return int(codes_of(result))


def damped(reduced: Reduced, damping: Array) -> tuple[Array, Array]:
    """The step with a damping, and whether there is one."""
    matrix = reduced.matrix + damping * jnp.eye(reduced.matrix.shape[0])
    step = jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(matrix), reduced.right)
    return step, jnp.isfinite(step).all()


def _repeated(goes_on: Callable[[Any], Any], once: Callable[[Any], Any], at: Any) -> Any:
    """`jax.lax.while_loop`, or a loop of the host where nothing is traced."""
    if arrays_of(at) is jnp:
        return jax.lax.while_loop(goes_on, once, at)
    while goes_on(at):
        at = jax.tree.map(np.asarray, once(at))
    return at


_damped = compiled(damped, lambda reduced, damping: reduced.matrix.size)


def _ahead(matrix: Array, step: Array, last_move: Array, last_step: Array) -> Array:
    """Where two Gauss-Newton steps in a row lead (Anderson 1965, over one step back, in the metric of the normal matrix).

    Where residuals stay large and the model is curved, as a delay sees the noise of POS, Gauss-Newton steps shrink by a constant
    factor r only; along one direction this is their sum r + r^2 + ...
    """
    change = step - last_step
    along = matrix @ change
    length = change @ along
    share = (step @ along) / arrays_of(length).where(length == 0, 1.0, length)
    return step - share * (last_move + change)
