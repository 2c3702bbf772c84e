"""Calibration: lever arms, boresight, interior and delays of any instrument from control points and priors."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..chain.detector import beside_detector
from ..chain.sensor import Sensor
from ..rules import RESULTS, SensorError, WhiskjaxError, first_failure, need, need_flags, require_x64
from ..rules.progress import tell
from ..rules.results import codes_of, is_successful, message_of
from .blunders import Blunders, data_snooping
from .diagnosis import consistency, kinked, lopsided, repeated, warnings_of
from .estimate import Estimate
from .given import Given, Knowledge, given
from .linearised import LeastSquares, Linearised, impossible, linearise, prepare, refine, refuse, solve, weighted_rows
from .losses import AbstractLoss
from .observations import Observations
from .posterior import Posterior, posterior
from .reliability import Reliability, log_density, of_common_points, reliability
from .unknown import Unknown, admit, assign
from .variance_components import Components, Reweigh, components, group, weighing
from .verdict import UNTESTED, CheckTest, check_test, contradictions, joint_chi_square, stretched

# Gauss-Newton steps after the solver, while they are this small (of a prior sigma or scale).
_POLISH, _NEAR = 3, 1e-2
# Under a robust loss, a residual of more sigmas than this is a blunder and does not count in the model test (chance: 3e-4).
_BLUNDER = 4.0
# Rounds of new weights and new blunders, until no factor changes by this.
_ROUNDS, _SAME_FACTOR = 10, 1e-3


class Fit(NamedTuple):
    """How well the model meets the observations: chi-square over degrees of freedom, its tail probability, the verdict.

    Blunders are left out; where they are, the verdict asks that most observations are none. `check` is what the check points say.
    """

    variance_factor: float
    tail_probability: float
    is_consistent: bool
    degrees_of_freedom: int
    check: CheckTest = UNTESTED


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A calibrated sensor, and what says how far to trust it.

    Values and sigmas are in the unit of the fields (m, rad, s, px); `Unknown.unit` shows them to people. Residuals are measured -
    projected in pixels, (n, 2) as (sample or column, line offset or row), for control and check points alike. Where weights were
    estimated, `unknowns` and `observations` carry the new sigmas, and `components` the factors; else it is None.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    `robust_weight` is 1 for a good observation, less under a robust loss, 0 for a blunder that was left out.
    `used` are the observations that decided: control points that are no blunders. `check_log_density` is the mean logarithm of
    the probability density, per pixel^2, that the calibration gave to each check point before looking (NaN without check points).
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
    used: Bool[np.ndarray, " n"]
    reliability: Reliability
    components: Components | None
    check_log_density: float
    steps: int
    result: RESULTS
    warnings: tuple[str, ...]

    @property
    def estimate(self) -> Estimate:
        """The unknowns with their joint covariance: knowledge for the next verb."""
        trust, fit = self.posterior, self.fit
        names, places = tuple(x.name for x in self.unknowns), tuple(x.places for x in self.unknowns)
        cost = np.asarray(fit.variance_factor * fit.degrees_of_freedom)
        share, freedom = 1 - trust.data_share, fit.degrees_of_freedom
        return Estimate(self.value, trust.covariance, share, cost, freedom, self.result, names, places)

    @property
    def is_sound(self) -> bool:
        """Converged, every unknown determined (by data or prior), consistent with its own sigmas and with the check points, and
        no sigma stretched beyond reason (verdict.py)."""
        solved = bool(is_successful(self.result)) and self.posterior.is_determined
        return solved and self.fit.is_consistent and self.fit.check.agrees and not stretched(self.components)

    @property
    def blunders(self) -> tuple[str, ...]:
        """Control observations that were left out, by name."""
        wrong = self.observations.is_control & ~self.used
        return tuple(self.observations.label(int(i)) for i in np.flatnonzero(wrong))


def calibrate(
    sensor: Sensor,
    observations: Observations,
    unknowns: Knowledge,
    *,
    consider: Knowledge = (),
    loss: AbstractLoss | None = None,
    blunders: Blunders | None = None,
    reweigh: Reweigh | None = None,
    max_steps: int = 100,
    throw: bool = True,
) -> Calibration:
    """Estimate unknowns of any instrument from control points and priors.

    Minimises the whitened squares of residuals and priors by Levenberg-Marquardt (Jin et al. 2024, equations 12 to 16,
    generalised: the pseudo-observations are the priors). Check points take no part and are reported apart. The sigmas of control
    point coordinates are propagated into the weights at the start.

    **Arguments:**

    - `sensor`: holds the start values.
    - `observations`: control and check points.
    - `unknowns`: what is to be estimated; all else stays as the sensor has it. An earlier answer, or its `Estimate`, is the joint
      prior of its numbers.
    - `consider`: numbers with a prior that are not estimated, but whose uncertainty counts in the covariance: POS biases at a
      joint, say, that the next flight will not share; or an earlier answer.
    - `loss`: `Huber(...)` or `Cauchy(...)`, which lets far observations pull less; None is least squares.
    - `blunders`: `Blunders()` finds gross errors, leaves them out and names them.
    - `reweigh`: `Reweigh()` finds the sigmas of images from the data, `Reweigh(priors=True)` those of priors too.
    - `throw`: raise where the solution did not converge or is not determined; else look at `result`.

    **Returns:** `Calibration`.

    **Raises:** `WhiskjaxError` for unknowns or observations that make no sense; `SensorError` naming the observation that cannot
    be imaged, or the unknowns that nothing determines.
    """
    require_x64("calibrate")
    need("calibrate", "sensor", sensor, Sensor)
    need("calibrate", "observations", observations, Observations)
    need_flags("calibrate", throw=throw)
    priors, considered = given("calibrate", "unknowns", unknowns), given("calibrate", "consider", consider)
    unknowns = priors.unknowns
    for name, value, kind in (("loss", loss, AbstractLoss), ("blunders", blunders, Blunders), ("reweigh", reweigh, Reweigh)):
        if value is not None:
            need("calibrate", name, value, kind)
    control = observations.is_control
    if not control.any():
        raise WhiskjaxError("calibrate: all points are check points; at least one control point is needed")
    if loss is not None and (blunders is not None or reweigh is not None):
        raise WhiskjaxError(
            "calibrate: a robust loss and Blunders() or Reweigh() answer the same question twice; give one of them"
        )
    admit(sensor, [*unknowns, *considered.unknowns])  # a number is either estimated or considered
    tell(
        f"calibrate: {len(unknowns)} unknowns from {int(control.sum())} control observations, prepared (the first time compiled)"
    )
    ready = prepare(sensor, observations, priors, loss)
    refuse(ready.unseen, observations)
    tell("calibrate: solved (the first time compiled)")
    u, steps, result = solve(ready, control, max_steps)
    if not np.isfinite(u).all():  # the result says so; what is told is told of the start
        u = ready.start
    here = linearise(ready, u)
    for _ in range(_POLISH if loss is not None else 1):
        here = refine(ready, here, _share(here, control, loss), 1 if loss is not None else _POLISH, _NEAR)
    converged = bool(is_successful(result))
    ready, here, used, unknowns, found = _cleanse(ready, here, control, unknowns, blunders, reweigh if converged else None)
    observations = ready.observations

    share = _share(here, used, loss)
    root = np.sqrt(share[used])[:, None, None]
    trust = posterior((root * here.rows[used]).reshape(-1, len(unknowns)), ready.scale, ready.prior, [x.name for x in unknowns])
    formal = np.nan_to_num(trust.covariance / np.outer(ready.scale, ready.scale), posinf=0.0)
    solution = assign(sensor, unknowns, ready.values(here.u))
    common = here.rows @ _root(formal)
    if considered.unknowns:
        effect, moved = _considered(solution, ready, here, formal, share, considered)
        trust = trust.widened(moved @ moved.T * np.outer(ready.scale, ready.scale))
        common = np.concatenate([common, effect - here.rows @ moved], axis=2)
    fit = _fit(ready, here, used if loss is None else used & (here.squared <= _BLUNDER**2), control, blunders)
    if trust.is_determined:
        fit = fit._replace(check=_checked(ready, here, common, ~control))
    if not trust.is_determined:
        result = RESULTS.rank_deficient  # also the cause where the iteration did not end
    lost = [] if not here.unseen.any() else [f"where the iteration ended, {impossible(here.unseen, observations)}"]
    if lost:
        if throw:
            raise SensorError(f"calibrate: {lost[0]}")
        first = here.unseen[np.argmax(here.unseen != 0)]
        result = first_failure(result, jax.tree.map(lambda _: first, RESULTS.successful))
    shift = np.where(ready.has_prior, here.u, np.nan)
    answer = Calibration(
        sensor=solution,
        unknowns=tuple(unknowns),
        start=ready.values(ready.start),
        value=ready.values(here.u),
        posterior=trust,
        fit=fit,
        residual_before_px=ready.before_px,
        residual_after_px=here.residual_px,
        observations=observations,
        robust_weight=_share(here, used | ~control, loss),
        used=used,
        reliability=reliability(ready, here, formal, used),
        components=found,
        check_log_density=log_density(ready, here, formal, ~control),
        steps=steps,
        result=result,
        warnings=(
            *lost,
            *contradictions(fit.check, found),
            *beside_detector(sensor, observations.shot, observations.pixel_px, used, observations.label),
            *repeated(observations, used),
            *lopsided(observations, used),
            *kinked(sensor, unknowns),
            *warnings_of(unknowns, trust, fit.variance_factor, fit.tail_probability, shift),
        ),
    )
    if throw:
        _raise(answer)
    return answer


def _share(here: Linearised, used: Bool[np.ndarray, " n"], loss: AbstractLoss | None) -> Float[np.ndarray, " n"]:
    """How much each observation pulls: 1, less under a robust loss, 0 where it takes no part."""
    return used.astype(float) if loss is None else used * np.asarray(loss.weight(jnp.asarray(here.squared)))


def _cleanse(
    ready: LeastSquares,
    here: Linearised,
    control: Bool[np.ndarray, " n"],
    unknowns: Sequence[Unknown],
    blunders: Blunders | None,
    reweigh: Reweigh | None,
) -> tuple[LeastSquares, Linearised, Bool[np.ndarray, " n"], Sequence[Unknown], Components | None]:
    """Blunders and weights, in turn until neither changes: each is judged by the other."""
    used, found, given = control, None, ready
    if blunders is not None:
        here, used = data_snooping(ready, here, control, blunders)
    rows, _ = weighted_rows(ready, here, used.astype(float))
    if reweigh is None or np.linalg.matrix_rank(rows) < len(unknowns):  # what nothing determines has no weights either
        return ready, here, used, unknowns, None
    grouping = group(reweigh, ready.observations, unknowns)
    for i in range(_ROUNDS):
        tell(f"weights: round {i + 1}")
        last, found = found, components(grouping, reweigh.spread, given, here, used)
        observed, prior = weighing(grouping, found)
        ready = given.reweighed(observed, prior)
        here = refine(ready, linearise(ready, here.u), used.astype(float), steps=20)
        if blunders is not None:
            here, used = data_snooping(ready, here, control, blunders)
        if last is not None and np.abs(np.log(found.factor / last.factor)).max() < _SAME_FACTOR:
            break
    sigma = [None if x.sigma is None else x.sigma * float(factor) for x, factor in zip(unknowns, prior, strict=True)]
    return ready, here, used, tuple(dataclasses.replace(x, sigma=s) for x, s in zip(unknowns, sigma, strict=True)), found


def _fit(
    ready: LeastSquares,
    here: Linearised,
    kept: Bool[np.ndarray, " n"],
    control: Bool[np.ndarray, " n"],
    blunders: Blunders | None,
) -> Fit:
    """The global model test over the observations that are no blunders."""
    pulled = (ready.prior @ here.u)[ready.has_prior]
    freedom = 2 * int(kept.sum()) + len(pulled) - len(here.u)
    factor, tail, sound = consistency(float(here.squared[kept].sum() + (pulled**2).sum()), freedom)
    most = 0.5 if blunders is None else blunders.most
    return Fit(factor, tail, sound and bool(kept.sum() > (1 - most) * control.sum()), freedom)


def _checked(
    ready: LeastSquares, here: Linearised, common: Float[np.ndarray, "n 2 m"], which: Bool[np.ndarray, " n"]
) -> CheckTest:
    """The check points beside their prediction.

    **Arguments:** `common`: how the errors of the answer (columns of variance 1) move every whitened residual.
    """
    if not which.any():
        return UNTESTED
    index = np.flatnonzero(which)
    difference, spread = here.whitened[index], common[index]
    covariance = np.eye(2) + spread @ spread.swapaxes(1, 2)
    own = np.einsum("ni,ni->n", difference, np.linalg.solve(covariance, difference[:, :, None])[..., 0])
    difference, spread = of_common_points(ready, index, difference, spread)
    together = joint_chi_square(difference.ravel(), spread.reshape(2 * len(index), -1))
    return check_test(together, own, 2, lambda i: ready.observations.label(int(index[i])))


def _root(covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """L with L L^T = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _considered(
    sensor: Sensor, ready: LeastSquares, here: Linearised, formal: np.ndarray, share: np.ndarray, considered: Given
) -> tuple[Float[np.ndarray, "n 2 c"], Float[np.ndarray, "k c"]]:
    """What numbers that were not estimated do, one sigma of each: to every whitened residual, and to the whitened unknowns.

    A change c of them moves the solution by -C J^T P H c (Schmidt 1966), with H the derivatives by them; the second result is
    that without its sign, so that its square widens the covariance.

    **Arguments:** `sensor`: at the solution; `formal`: covariance C of the whitened unknowns without them.
    """
    for x in considered.unknowns:
        if x.sigma is None:
            raise WhiskjaxError(f"consider: {x.name} has no prior sigma; its uncertainty is what would be considered")
    changed = prepare(sensor, ready.observations, considered, None).weighted(ready.weight)
    effect = linearise(changed, changed.start).rows @ np.linalg.cholesky(considered.correlation)
    return effect, formal @ np.einsum("n,nik,nij->kj", share, here.rows, effect)


def _raise(answer: Calibration) -> None:
    code = int(codes_of(answer.result))
    if code == 0:
        return
    named = ""
    if not answer.posterior.is_determined:
        told = list(zip([x.name for x in answer.unknowns], np.isfinite(answer.posterior.sigma), strict=True))
        lost, left = ([name for name, known in told if known == which] for which in (False, True))
        named = f": {', '.join(lost)}. Give them priors, or leave out all but one of each group that moves together"
        named += f". Determined are {', '.join(left)}" if left else ""
        named += f". The data determine {answer.posterior.rank} of {len(told)} combinations of the unknowns"
    raise SensorError(f"calibrate: {message_of(code)}{named}")
