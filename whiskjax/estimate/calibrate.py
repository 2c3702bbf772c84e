"""Calibration: lever arms, boresight, interior and delays of any instrument from control points and priors."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.imaging import into_camera
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.sweep import sweep
from ..rules import RESULTS, SensorError, WhiskjaxError, first_failure, require_x64
from ..rules.results import codes_of, is_successful, message_of
from .diagnosis import consistency, warnings_of
from .least_squares import jacobian, levenberg_marquardt
from .losses import AbstractLoss
from .observations import Observations
from .posterior import Posterior, posterior
from .problem import Problem, pose_problem, stack_rows
from .unknown import Unknown


class Fit(NamedTuple):
    """How well the model meets the observations: chi-square over degrees of freedom, its tail probability, the verdict."""

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
    if not observations.is_control.any():
        raise WhiskjaxError("calibrate: all points are check points; at least one control point is needed")
    refuse_unseen(sensor, observations)
    weight = _weights(sensor, observations)
    used = observations.is_control
    problem, start, indices = pose_problem(sensor, observations, unknowns, np.where(used[:, None], weight, 0.0), loss)

    solved = levenberg_marquardt(problem, jnp.asarray(start), max_steps)
    u = np.asarray(solved.u)
    state = _evaluate(problem, jnp.asarray(start), solved.u)
    n = len(observations)
    before, after, rows, robust = (stack_rows(list(part), indices, n) for part in zip(*state, strict=True))
    robust = robust[:, 0]

    names = [x.name for x in unknowns]
    has_prior = np.array([x.sigma is not None for x in unknowns])
    scale = np.array([x.size for x in unknowns])
    jac = (np.sqrt(robust[used])[:, None, None] * rows[used]).reshape(-1, len(unknowns))
    trust = posterior(jac, scale, has_prior, names)
    whitened = _whiten(weight, after)[used]
    cost = float((robust[used][:, None] * whitened**2).sum() + (u[has_prior] ** 2).sum())
    freedom = round(float(2 * robust[used].sum())) + int(has_prior.sum()) - len(unknowns)
    factor, tail, sound = consistency(cost, freedom)
    result = solved.result
    if not trust.is_determined:
        result = first_failure(result, RESULTS.rank_deficient)
    value = np.asarray(problem.mean) + scale * u
    answer = Calibration(
        sensor=problem.put(solved.u),
        unknowns=tuple(unknowns),
        start=np.asarray(problem.mean) + scale * start,
        value=value,
        posterior=trust,
        fit=Fit(factor, tail, sound, freedom),
        residual_before_px=before,
        residual_after_px=after,
        observations=observations,
        robust_weight=robust,
        steps=int(solved.steps),
        result=result,
        warnings=tuple(warnings_of(unknowns, trust, factor, tail, np.where(has_prior, u, np.nan))),
    )
    if throw:
        _raise(answer)
    refuse_unseen(answer.sensor, observations)
    return answer


def _raise(answer: Calibration) -> None:
    code = int(codes_of(answer.result))
    if code == 0:
        return
    named = ""
    if not answer.posterior.is_determined:
        lost = [x.name for x, s in zip(answer.unknowns, answer.posterior.sigma, strict=True) if not np.isfinite(s)]
        named = f": {', '.join(lost)}. Give them priors, or leave out all but one of each group that moves together"
    raise SensorError(f"calibrate: {message_of(code)}{named}")


@eqx.filter_jit
def _evaluate(problem: Problem, start, u):
    """For each group: residuals in pixels before and after, whitened derivatives, and robust weights (padded)."""
    problem = problem.baked()
    out = []
    for group, (value, derivative) in zip(problem.groups, jacobian(problem, u), strict=True):
        pixels = []
        for at in (start, u):
            x, y = problem.put(at).camera_at(group.shot).pixel(into_camera(problem.put(at), group.shot, group.point))
            pixels.append(jnp.stack([group.pixel[0] - x, group.pixel[1] - y]))
        z = value[0] ** 2 + value[1] ** 2
        robust = jnp.ones_like(z) if problem.loss is None else problem.loss.weight(z)
        out.append((*pixels, derivative, jnp.stack([robust, robust])))
    return out


@eqx.filter_jit
def _unseen(sensor: Sensor, shot: Shot, point) -> RESULTS:
    return first_failure(sensor.check(shot), sensor.camera_at(shot).check_direction(into_camera(sensor, shot, point)))


def refuse_unseen(sensor: Sensor, observations: Observations) -> None:
    """**Raises:** `SensorError` naming the first observation that the sensor cannot have made, and how many there are."""
    result = _unseen(sensor, observations.shot, tuple(np.ascontiguousarray(c) for c in observations.point_m.T))
    codes = np.broadcast_to(codes_of(result), (len(observations),))
    if codes.any():
        i = int(np.argmax(codes != 0))
        more = f" ({int((codes != 0).sum())} of {len(codes)} observations fail)" if (codes != 0).sum() > 1 else ""
        raise SensorError(f"{observations.label(i)}: {message_of(int(codes[i]))}{more}")


@eqx.filter_jit
def _ground_derivative(sensor: Sensor, shot: Shot, point) -> tuple:
    return sweep(sensor, shot, point).derivatives["earth"]


def _weights(sensor: Sensor, observations: Observations) -> Float[np.ndarray, "n 3"]:
    """Lower triangle (w00, w10, w11) of the inverse Cholesky factor of each observation's covariance, point errors included."""
    c00, c11 = observations.sigma_px.T**2
    c01 = np.zeros_like(c00)
    if observations.point_covariance_m2 is not None and observations.point_covariance_m2.any():
        h = _ground_derivative(sensor, observations.shot, tuple(np.ascontiguousarray(c) for c in observations.point_m.T))
        rows = np.stack([np.stack([np.broadcast_to(np.asarray(e), c00.shape) for e in row], -1) for row in h], -2)
        extra = rows @ observations.point_covariance_m2 @ np.swapaxes(rows, -1, -2)
        c00, c01, c11 = c00 + extra[:, 0, 0], extra[:, 0, 1], c11 + extra[:, 1, 1]
    l00 = np.sqrt(c00)
    l10 = c01 / l00
    l11 = np.sqrt(c11 - l10**2)
    return np.stack([1 / l00, -l10 / (l00 * l11), 1 / l11], axis=-1)


def _whiten(weight: Float[np.ndarray, "n 3"], residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    w00, w10, w11 = weight.T
    x, y = residual_px.T
    return np.stack([w00 * x, w10 * x + w11 * y], axis=-1)
