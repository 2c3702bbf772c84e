"""Two solvers of one whitened least-squares problem: Levenberg-Marquardt for one, Gauss-Newton for speed.

`levenberg_marquardt` is optimistix's, safe from any start. `gauss_newton` takes a fixed number of steps on small normal
equations; it is what runs thousands of times, and is checked against the other.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from ..algebra.vectors import Vec2
from ..rules import RESULTS, compiled, first_failure, once
from ..rules.results import failure_if
from .columns import columns
from .problem import Group, Problem, residuals

# Of a prior sigma or scale; `calibrate` goes the rest of the way with Gauss-Newton steps.
_TOLERANCE = 1e-6
# Of the cost: residuals of 1e-9 px, what float64 leaves of coordinates, are 1e-10 of a cost of hundreds. The cost cannot judge a
# step that should gain less, if it is a short one (of a prior sigma or scale).
_ROUNDING, _SHORT = 1e-10, 1e-3
# The last of the Gauss-Newton steps, in prior sigmas: the error that is left is smaller by orders of magnitude; and one that is
# no more than rounding.
_CONVERGED, _SETTLED = 1e-6, 1e-10
# An unknown is lost where the others explain all but this share of what the data and priors say of it: rounding, not geometry.
_SINGULAR = 1e-12


class Solved(NamedTuple):
    """Whitened unknowns, the number of steps that were taken (not those that were rejected), and how the iteration ended."""

    u: Float[Array, " unknowns"]
    steps: Int[Array, ""]
    result: RESULTS


class _Search(optx.ClassicalTrustRegion):
    """Takes short steps that should gain less than rounding of the cost hides, where the cost rises by no more.

    A step near the minimum gains the square of its length: judged by the cost alone, good last steps are rejected at random, each
    time with four times the damping, and the iteration creeps for tens of steps in which nothing moves.
    """

    def step(self, first_step, y, y_eval, f_info, f_eval_info, state):
        """As the base class, and whether the step is rounding."""
        size, accept, result, after = super().step(first_step, y, y_eval, f_info, f_eval_info, state)
        cost, there = f_info.as_min(), f_eval_info.as_min()
        predicted = self.predict_reduction(y_eval - y, f_info)
        rounding = (-predicted <= _ROUNDING * cost) & (there - cost <= _ROUNDING * cost) & (jnp.abs(y_eval - y).max() < _SHORT)
        size = jnp.where(rounding & ~accept, state.step_size, size)
        return size, accept | rounding, result, eqx.tree_at(lambda s: s.step_size, after, size)


class _LevenbergMarquardt(optx.LevenbergMarquardt):
    def __init__(self):
        super().__init__(rtol=_TOLERANCE, atol=_TOLERANCE)
        self.search = _Search()


def _levenberg_marquardt(problem: Problem, start: Float[Array, " unknowns"], max_steps: int = 100) -> Solved:
    """Minimise by optimistix's Levenberg-Marquardt in whitened unknowns.

    **Arguments:**

    - `problem`: baked.
    - `start`: whitened, (unknowns,).
    - `max_steps`: that are tried, taken or not.
    """
    # optimistix counts the evaluation at the start as a step that was accepted.
    solution = optx.least_squares(residuals, _LevenbergMarquardt(), start, args=problem, max_steps=max_steps + 1, throw=False)
    finite = jnp.isfinite(solution.value).all()
    stopped = solution.result != optx.RESULTS.successful
    result = first_failure(failure_if(~finite, RESULTS.nonfinite), failure_if(stopped, RESULTS.not_converged))
    return Solved(solution.value, solution.state.num_accepted_steps - 1, result)


levenberg_marquardt = compiled(_levenberg_marquardt, lambda problem, *_: problem.size, often=True)


def normal_equations(problem: Problem, u: Float[Array, " unknowns"]) -> Float[Array, "unknowns+1 unknowns+1"]:
    """Normal matrix of [J | r], priors included: only the unknowns that act on a group are differentiated for it.

    One product for each image axis: a Jacobian stacked from rows makes XLA compute the chain again for each row.
    """
    m = u.shape[0]
    pull = problem.unknowns.information
    slope = pull @ u
    normal = jnp.pad(pull, (0, 1)) + _border(slope, slope @ u)
    if problem.shared is not None:  # rays of one point may be in several groups: all of them at once
        for x, y in observed_rows(problem, u):
            normal = normal + x @ x.T + y @ y.T
        return normal
    for group in (g for g in problem.groups if g.decides):
        residual, by, order, _ = columns(problem, group, u)
        weight = 1.0
        if problem.loss is not None:
            weight = jnp.sqrt(problem.loss.weight(residual[0] * residual[0] + residual[1] * residual[1]))
        rows = [jnp.concatenate([c, r[None]]) * weight for c, r in zip(by, residual, strict=True)]
        # Where each unknown stands in the product; those that do not act find its last row, which is zero. (Adding to a part
        # of the matrix is a scatter, which costs as much as the product.)
        place = np.full(m + 1, len(order) + 1)
        place[[*order, m]] = np.arange(len(order) + 1)
        product = rows[0] @ rows[0].T + rows[1] @ rows[1].T
        normal = normal + jnp.pad(product, (0, 1))[place[:, None], place[None, :]]
    return normal


def observed_rows(problem: Problem, u: Float[Array, " unknowns"]) -> list[Vec2]:
    """Of each group the whitened derivatives of its residuals by all unknowns, and the residuals as the last row,
    (unknowns + 1, n) for x and y, under the robust loss; rays of one point weighed together. Zero of groups that decide nothing.
    """
    m, whole = u.shape[0], []
    for group in problem.groups:
        if not group.decides:
            whole.append((jnp.zeros((m + 1, *group.point[0].shape)),) * 2)
            continue

        def seen(group: Group = group) -> Vec2:
            residual, by, order, _ = columns(problem, group, u)
            place = jnp.array([*order, m])
            parts = [jnp.concatenate([c, r[None]]) for c, r in zip(by, residual, strict=True)]
            return tuple(jnp.zeros((m + 1, part.shape[1])).at[place].set(part) for part in parts)

        whole.append(once(seen))
    if problem.shared is not None:
        whole = problem.shared.independent(whole)
    if problem.loss is None:
        return whole
    weights = [jnp.sqrt(problem.loss.weight(x[m] * x[m] + y[m] * y[m]))[None] for x, y in whole]
    return [(w * x, w * y) for w, (x, y) in zip(weights, whole, strict=True)]


def _border(v: Float[Array, " unknowns"], corner: Float[Array, ""]) -> Float[Array, "unknowns+1 unknowns+1"]:
    """A symmetric matrix of zeros with v and the corner in its last row and column."""
    full = jnp.append(v, corner)
    last = jnp.arange(full.shape[0]) == v.shape[0]
    return jnp.where(last[:, None], full[None, :], jnp.where(last[None, :], full[:, None], 0.0))


def gauss_newton(problem: Problem, start: Float[Array, " unknowns"], steps: int = 5) -> Float[Array, " unknowns"]:
    """A fixed number of Gauss-Newton steps on the normal equations of a baked problem (robust losses by reweighting).

    For whitened unknowns with priors, whose normal matrix is at least the identity; 4 to 7 steps reach rounding.
    """
    return descend(problem, start, steps).u


class Descent(NamedTuple):
    """Where the last step led, the step, and the normal equations (of [J | r]) that it solved."""

    u: Float[Array, " unknowns"]
    step: Float[Array, " unknowns"]
    normal: Float[Array, "unknowns+1 unknowns+1"]


def descend(problem: Problem, start: Float[Array, " unknowns"], steps: int) -> Descent:
    """`gauss_newton` with what its last step knew."""
    return jax.lax.fori_loop(0, steps, lambda _, here: _next(problem, here), _at(start))


def converge(problem: Problem, start: Float[Array, " unknowns"], most: int) -> tuple[Descent, Int[Array, ""]]:
    """Gauss-Newton steps until one is rounding, at most so many, and how many there were."""

    def goes_on(carry: tuple[Array, Descent]) -> Array:
        i, here = carry
        return (i == 0) | ((i < most) & (jnp.abs(here.step).max() > _SETTLED))

    zero = jnp.zeros((), dtype=jnp.int32)
    steps, here = jax.lax.while_loop(goes_on, lambda carry: (carry[0] + 1, _next(problem, carry[1])), (zero, _at(start)))
    return here, steps


def judge(here: Descent) -> RESULTS:
    """How a descent ended."""
    m = here.u.shape[0]
    root = jnp.linalg.cholesky(here.normal[:m, :m])
    return first_failure(
        failure_if(~jnp.isfinite(here.normal).all(), RESULTS.nonfinite),
        failure_if(~(jnp.diag(root) ** 2 > _SINGULAR * jnp.diag(here.normal)[:m]).all(), RESULTS.rank_deficient),
        failure_if(~(jnp.abs(here.step).max() < _CONVERGED), RESULTS.not_converged),
    )


def _at(start: Float[Array, " unknowns"]) -> Descent:
    m = start.shape[0]
    return Descent(start, jnp.zeros(m), jnp.zeros((m + 1, m + 1)))


def _next(problem: Problem, here: Descent) -> Descent:
    m = here.u.shape[0]
    normal = normal_equations(problem, here.u)
    factor = jax.scipy.linalg.cho_factor(normal[:m, :m])
    change = -jax.scipy.linalg.cho_solve(factor, normal[:m, m])
    # Where the matrix is singular stay, so that it can be seen to be.
    change = jnp.where(jnp.isfinite(change).all() | ~jnp.isfinite(normal).all(), change, 0.0)
    return Descent(here.u + change, change, normal)
