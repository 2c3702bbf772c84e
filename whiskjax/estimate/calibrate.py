"""Calibration: lever arms, boresight, interior and delays of any instrument from control points and priors."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..chain.imaging import into_camera
from ..chain.sensor import Sensor
from ..chain.sweep import sweep
from ..rules import RESULTS, SensorError, WhiskjaxError, first_failure, require_x64
from ..rules.results import codes_of, is_successful, message_of
from .diagnosis import consistency, warnings_of
from .least_squares import jacobian, levenberg_marquardt
from .losses import AbstractLoss
from .observations import Observations
from .posterior import Posterior, posterior
from .problem import Group, Problem, by_observation, pose_problem, weigh
from .unknown import Unknown

# Gauss-Newton steps after the solver, while they are this small (of a prior sigma or scale).
_POLISH, _NEAR = 3, 1e-2
# Under a robust loss, a residual of more sigmas than this is a blunder and does not count in the model test (chance: 3e-4).
_BLUNDER = 4.0


class Fit(NamedTuple):
    """How well the model meets the observations: chi-square over degrees of freedom, its tail probability, the verdict.

    Under a robust loss blunders are left out, and the verdict asks that most observations are none.
    """

    variance_factor: float
    tail_probability: float
    is_consistent: bool
    degrees_of_freedom: int


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A calibrated sensor, and problem that says how far to trust it.

    Values and sigmas are in the unit of the fields (m, rad, s, px); `Unknown.unit` shows them to people. Residuals are measured -
    projected in pixels, (n, 2) as (sample or column, line or row), for control and check points alike.
    """

    sensor: Sensor
    unknowns: tuple[Unknown, ...]
    start: Float[np.ndarray, " k"]
    value: Float[np.ndarray, " k"]
    posterior: Posterior
    fit: Fit
    residual_before_px: Float[np.ndarray, "n 2"]
    residual_after_px: Float[np.ndarray, "n 2"]
    observations: Observations
    robust_weight: Float[np.ndarray, " n"]
    steps: int
    result: RESULTS
    warnings: tuple[str, ...]

    @property
    def is_sound(self) -> bool:
        """Converged, every unknown determined (by data or prior), and consistent with its own sigmas."""
        return bool(is_successful(self.result)) and self.posterior.is_determined and self.fit.is_consistent


def calibrate(
    sensor: Sensor,
    observations: Observations,
    unknowns: Sequence[Unknown],
    *,
    loss: AbstractLoss | None = None,
    max_steps: int = 100,
    throw: bool = True,
) -> Calibration:
    """Estimate unknowns of any instrument from control points and priors.

    Minimises the whitened squares of residuals and priors by Levenberg-Marquardt (paper 000, equations 12 to 16, generalised: the
    pseudo-observations are the priors). Check points take no part and are reported apart. The sigmas of control point coordinates
    are propagated into the weights at the start.

    **Arguments:**

    - `sensor`: holds the start values.
    - `observations`: control and check points.
    - `unknowns`: what is to be estimated; all else stays as the sensor has it.
    - `loss`: `Huber(...)` or `Cauchy(...)` against blunders; None is least squares.
    - `throw`: raise where the solution did not converge or is not determined; else look at `result`.

    **Returns:** `Calibration`.

    **Raises:** `WhiskjaxError` for unknowns or observations that make no sense; `SensorError` naming the observation that cannot
    be imaged, or the unknowns that nothing determines.
    """
    require_x64("calibrate")
    used = observations.is_control
    if not used.any():
        raise WhiskjaxError("calibrate: all points are check points; at least one control point is needed")
    n = len(observations)
    problem, start, indices = pose_problem(sensor, observations, unknowns, loss, split=False)
    prepared, *first = _prepare(problem, jnp.asarray(start))
    before, follows, unseen = (by_observation(part, indices, n) for part in first)
    refuse(unseen, observations)
    weight = _weights(observations, follows)
    prepared = weigh(prepared, np.where(used[:, None], weight, 0.0), indices)

    u, steps, result = _solve(prepared, start, max_steps)
    u, after, whitened, jac, robust, unseen = _polish(prepared, u, indices, weight, used)

    has_prior, scale = np.asarray(problem.prior) > 0, np.asarray(problem.scale)
    trust = posterior(jac, scale, has_prior, [x.name for x in unknowns])
    squared = (whitened**2).sum(axis=1)
    kept = used if loss is None else used & (squared <= _BLUNDER**2)
    cost = float(squared[kept].sum() + (u[has_prior] ** 2).sum())
    freedom = 2 * int(kept.sum()) + int(has_prior.sum()) - len(unknowns)
    factor, tail, sound = consistency(cost, freedom)
    if not trust.is_determined:
        result = first_failure(result, RESULTS.rank_deficient)
    if throw:
        refuse(unseen, observations)
    elif unseen.any():
        result = first_failure(result, jax.tree.map(lambda _: unseen.max(), RESULTS.successful))
    answer = Calibration(
        sensor=problem.put(jnp.asarray(u)),
        unknowns=tuple(unknowns),
        start=np.asarray(problem.mean) + scale * start,
        value=np.asarray(problem.mean) + scale * u,
        posterior=trust,
        fit=Fit(factor, tail, sound and bool(2 * kept.sum() > used.sum()), freedom),
        residual_before_px=before,
        residual_after_px=after,
        observations=observations,
        robust_weight=robust,
        steps=steps,
        result=result,
        warnings=tuple(warnings_of(unknowns, trust, factor, tail, np.where(has_prior, u, np.nan))),
    )
    if throw:
        _raise(answer)
    return answer


def _solve(problem: Problem, start: Float[np.ndarray, " k"], max_steps: int) -> tuple[Float[np.ndarray, " k"], int, RESULTS]:
    """Whitened solution, steps and result; under a robust loss from the least-squares solution, where few points are far off."""
    u, steps = jnp.asarray(start), 0
    if problem.loss is not None:
        solved = levenberg_marquardt(eqx.tree_at(lambda p: p.loss.bound, problem, jnp.asarray(1e9)), u, max_steps)
        u, steps = solved.u, int(solved.steps)
    solved = levenberg_marquardt(problem, u, max_steps)
    return np.asarray(solved.u), steps + int(solved.steps), solved.result


def _polish(problem: Problem, u: np.ndarray, indices: list[np.ndarray], weight: np.ndarray, used: np.ndarray):
    """Gauss-Newton steps from a solution that is nearly reached, and everything at its end.

    Each step is an orthogonal decomposition of the weighted rows of the control points and the priors.

    **Returns:** the whitened unknowns; residuals (n, 2) in pixels and whitened; the weighted whitened derivatives of the control
    points (rows, unknowns); robust weights (n,); failure codes (n,).
    """
    prior = np.asarray(problem.prior) > 0

    def judge(u):
        after, rows, robust, unseen = (by_observation(part, indices, len(used)) for part in _evaluate(problem, jnp.asarray(u)))
        root = np.sqrt(robust[used])[:, None]
        return after, _whiten(weight, after), (root[:, :, None] * rows[used]).reshape(-1, len(u)), robust, unseen

    judged = judge(u)
    for _ in range(_POLISH):
        _, whitened, jac, robust, _ = judged
        rows = np.concatenate([jac, np.diag(prior.astype(float))[prior]])
        right = np.concatenate([(np.sqrt(robust[used])[:, None] * whitened[used]).ravel(), u[prior]])
        step = -np.linalg.lstsq(rows, right, rcond=None)[0]
        if not np.abs(step).max() < _NEAR:
            break
        u = u + step
        judged = judge(u)
    return u, *judged


def _raise(answer: Calibration) -> None:
    code = int(codes_of(answer.result))
    if code == 0:
        return
    named = ""
    if not answer.posterior.is_determined:
        lost = [x.name for x, s in zip(answer.unknowns, answer.posterior.sigma, strict=True) if not np.isfinite(s)]
        named = f": {', '.join(lost)}. Give them priors, or leave out all but one of each group that moves together"
    raise SensorError(f"calibrate: {message_of(code)}{named}")


def _pixels(problem: Problem, group: Group, u: Array) -> tuple[Array, Array]:
    """Residuals of a group in pixels (2, n), and the codes of observations that cannot have been made (n,)."""
    sensor = problem.put(u)
    camera, q = sensor.camera_at(group.shot), into_camera(sensor, group.shot, group.point)
    x, y = camera.pixel(q)
    result = first_failure(sensor.check(group.shot), camera.check_direction(q))
    code = jax.tree.leaves(result)[0] + jnp.zeros(x.shape, dtype=jnp.int32)
    return jnp.stack([group.pixel[0] - x, group.pixel[1] - y]), code


@eqx.filter_jit
def _prepare(problem: Problem, start: Array):
    """The baked problem; for each group the residuals in pixels, the 2x3 derivatives by the ground point, and failure codes.

    The links are checked before they are baked, because a baked pose does not know its time any more.
    """
    baked = problem.baked()
    before, follows, unseen = [], [], []
    for raw, group in zip(problem.groups, baked.groups, strict=True):
        residual, code = _pixels(baked, group, start)
        linked = jax.tree.leaves(problem.put(start).check(raw.shot))[0] + jnp.zeros_like(code)
        derivative = sweep(baked.put(start), group.shot, group.point).derivatives["earth"]
        before.append(residual)
        follows.append(jnp.stack([jnp.stack(jnp.broadcast_arrays(*row)) for row in derivative]))
        unseen.append(jnp.where(linked != 0, linked, code))
    return baked, before, follows, unseen


@eqx.filter_jit
def _evaluate(problem: Problem, u: Array):
    """For each group at the solution: residuals in pixels, whitened derivatives, robust weights, failure codes."""
    after, rows, robust, unseen = [], [], [], []
    for group in problem.groups:
        residual, code = _pixels(problem, group, u)
        value, derivative = jacobian(problem, group, u)
        z = value[0] ** 2 + value[1] ** 2
        after.append(residual)
        rows.append(derivative)
        robust.append(jnp.ones_like(z) if problem.loss is None else problem.loss.weight(z))
        unseen.append(code)
    return after, rows, robust, unseen


def refuse(codes: np.ndarray, observations: Observations) -> None:
    """**Raises:** `SensorError` naming the first observation that the sensor cannot have made, and how many there are."""
    if codes.any():
        i = int(np.argmax(codes != 0))
        more = f" ({int((codes != 0).sum())} of {len(codes)} observations fail)" if (codes != 0).sum() > 1 else ""
        raise SensorError(f"{observations.label(i)}: {message_of(int(codes[i]))}{more}")


def _weights(observations: Observations, follows: Float[np.ndarray, "n 2 3"]) -> Float[np.ndarray, "n 3"]:
    """Lower triangle (w00, w10, w11) of the inverse Cholesky factor of each observation's covariance.

    **Arguments:** `follows`: derivative of the pixel by the ground point, which carries the point's covariance into the image.
    """
    c00, c11 = observations.sigma_px.T**2
    c01 = np.zeros_like(c00)
    if observations.point_covariance_m2 is not None:
        extra = follows @ observations.point_covariance_m2 @ np.swapaxes(follows, -1, -2)
        c00, c01, c11 = c00 + extra[:, 0, 0], extra[:, 0, 1], c11 + extra[:, 1, 1]
    l00 = np.sqrt(c00)
    l10 = c01 / l00
    l11 = np.sqrt(c11 - l10**2)
    return np.stack([1 / l00, -l10 / (l00 * l11), 1 / l11], axis=-1)


def _whiten(weight: Float[np.ndarray, "n 3"], residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    w00, w10, w11 = weight.T
    x, y = residual_px.T
    return np.stack([w00 * x, w10 * x + w11 * y], axis=-1)
