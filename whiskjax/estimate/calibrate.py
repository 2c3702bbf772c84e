"""Calibration: lever arms, boresight, interior and delays of any instrument from control points and priors."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..algebra.vectors import unstack
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface, need_surface
from ..rules import RESULTS, SensorError, WhiskjaxError, arrays_of, first_failure, is_traced, need, need_flags, plain, require_x64
from ..rules.progress import tell
from ..rules.results import codes_of, failure_if, is_successful, message_of
from .blunders import Blunders, data_snooping
from .calibration import BLUNDER, Calibration, Considered
from .checks import ended
from .error_effects import common_columns_px
from .errors import FrameErrors, need_errors
from .estimate import Estimate
from .given import Given, Knowledge, given
from .linearised import LeastSquares, Linearised, independent, linearise, prepare, refine, refuse, solve, weighted_rows
from .losses import AbstractLoss
from .model_test import NOTHING
from .observations import Observations
from .posterior import RANK_TOLERANCE, posterior
from .solution import NEAR, POLISH
from .unknown import Unknown, admit
from .variance_components import Components, Reweigh, data_of, decided, group, weighing
from .weight_uncertainty import Uncertain, of_least_squares

# Rounds of new weights and new blunders, until no factor changes by this.
_ROUNDS, _SAME_FACTOR = 10, 1e-3


def calibrate(
    sensor: Sensor,
    observations: Observations,
    unknowns: Knowledge,
    *,
    consider: Knowledge = (),
    errors: Sequence[FrameErrors] = (),
    surface: AbstractSurface | None = None,
    loss: AbstractLoss | None = None,
    blunders: Blunders | None = None,
    reweigh: Reweigh | None = None,
    max_steps: int = 100,
    throw: bool = True,
) -> Calibration:
    """Estimate unknowns of any instrument from control points and priors.

    Minimises the whitened squares of residuals and priors by Levenberg-Marquardt (Jin et al. 2024, equations 12 to 16,
    generalised: the pseudo-observations are the priors). Check points take no part and are reported apart. The sigmas of control
    point coordinates are propagated into the weights at the start: a point's survey is one error, however many rays see it.

    **Arguments:**

    - `sensor`: holds the start values.
    - `observations`: control and check points.
    - `unknowns`: what is to be estimated; all else stays as the sensor has it. An earlier answer, or its `Estimate`, is the joint
      prior of its numbers.
    - `consider`: numbers with a prior that are not estimated, but whose uncertainty counts in the covariance: POS biases at a
      joint, say, that the next flight will not share; or an earlier answer.
    - `errors`: how recorded frames err. What is new at every exposure weighs; what exposures have in common, a bias or one that
      wanders, is considered: the estimate does not know of it, the covariance and the model test do.
    - `surface`: what is level, for errors in level axes; the ellipsoid by default.
    - `loss`: `Huber(...)` or `Cauchy(...)`, which lets far observations pull less; None is least squares. It acts on residuals
      that are independent; where rays share a point, a gross error of one shows in the others as well, the more the less well
      the point is known, and `blunders` tells them apart better.
    - `blunders`: `Blunders()` finds gross errors, leaves them out and names them.
    - `reweigh`: `Reweigh()` finds the sigmas of images from the data, `Reweigh(priors=True)` those of priors too. That they are
      not known exactly is in the covariance (weight_uncertainty.py).
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
    errors = need_errors("calibrate", errors)
    if surface is not None:
        need_surface("calibrate", surface)
    for name, value, kind in (("loss", loss, AbstractLoss), ("blunders", blunders, Blunders), ("reweigh", reweigh, Reweigh)):
        if value is not None:
            need("calibrate", name, value, kind)
    control = observations.is_control
    if not is_traced(control) and not control.any():
        raise WhiskjaxError("calibrate: all points are check points; at least one control point is needed")
    if loss is not None and (blunders is not None or reweigh is not None):
        raise WhiskjaxError(
            "calibrate: a robust loss and Blunders() or Reweigh() answer the same question twice; give one of them"
        )
    if considered.unknowns or not priors.unknowns:
        admit(sensor, [*priors.unknowns, *considered.unknowns])  # a number is either estimated or considered
    traced = arrays_of((sensor, observations, priors, considered, errors)) is jnp
    if traced and (blunders is not None or reweigh is not None):
        raise WhiskjaxError("calibrate: Blunders() and Reweigh() search on the host, and have no meaning under jit, vmap or grad")
    if not traced:
        tell(
            f"calibrate: {len(priors.unknowns)} unknowns from {int(control.sum())} control observations, prepared (the first "
            "time compiled)"
        )
    ready = prepare(sensor, observations, priors, loss, errors=errors, surface=surface)
    if not traced:
        refuse(ready.unseen, observations)
        tell("calibrate: solved (the first time compiled)")
    u, steps, result = solve(ready, control, max_steps)
    if not traced and not np.isfinite(u).all():  # the result says so; what is told is told of the start
        u = ready.start
    here, used, found, uncertain, unknowns = linearise(ready, u), control, None, None, priors.unknowns
    if not traced:
        for _ in range(POLISH if loss is not None else 1):
            pull = _share(here if loss is None else independent(ready, here, control.astype(float)), control, loss)
            here = refine(ready, here, pull, 1 if loss is not None else POLISH, NEAR)
        # Measurements that were made with the model itself know nothing of sigmas.
        is_exact = here.squared[control].sum() < NOTHING * control.sum()
        weights = reweigh if bool(is_successful(result)) and not is_exact else None
        effect_px = None if weights is None else _effects_px(ready, here, considered, errors, surface)
        ready, here, used, unknowns, found, uncertain = _cleanse(ready, here, control, unknowns, blunders, weights, effect_px)
    here = independent(ready, here, used.astype(float))
    share = _share(here, used | ~control, loss)
    formal, is_determined = _formal(ready, here, share * used.astype(float))
    effect_px = _effects_px(ready, here, considered, errors, surface)
    moved = None if effect_px is None else Considered.of(ready, here, formal, share * used.astype(float), effect_px)
    answer = Calibration(
        sensor=ready.problem.unknowns.put(ready.sensor, here.u),
        unknowns=tuple(unknowns),
        start=ready.values(ready.start),
        estimate=_estimated(ready, here, used, formal, moved, uncertain, result, is_determined),
        used=used,
        components=found,
        steps=steps,
        _ready=ready,
        _here=here,
        _formal=formal,
        _considered=moved,
        _uncertain=uncertain,
        _share=share,
        _most=0.5 if blunders is None else blunders.most,
        _considered_places=tuple(x.places for x in considered.unknowns),
        _states_poses=bool(errors),
    )
    if throw and not traced:
        _raise(answer)
    return answer


def _share(here: Linearised, used: Bool[Any, " n"], loss: AbstractLoss | None) -> Float[Any, " n"]:
    """How much each observation pulls: 1, less under a robust loss, 0 where it takes no part."""
    if loss is None:
        return used.astype(float)
    return used.astype(float) * plain(loss.weight(jnp.asarray(here.squared)))


def _formal(ready: LeastSquares, here: Linearised, share: Float[Any, " n"]) -> tuple[Float[Any, "k k"], Any]:
    """Covariance of the whitened unknowns, considered numbers left out, and whether observations and priors determine them all.

    What nothing determines has the covariance zero here, so that the others keep theirs.
    """
    math, k = arrays_of((here.rows, ready.prior)), len(here.u)
    rows = math.concatenate([(math.sqrt(share)[:, None, None] * here.rows).reshape(-1, k), ready.prior])
    if math is np:
        trust = posterior(rows, np.ones(k), np.zeros((k, k)), ready.problem.unknowns.names)
        return np.nan_to_num(trust.covariance, posinf=0.0), trust.is_determined
    triangle = jnp.linalg.qr(rows, mode="r")
    length = jnp.linalg.norm(rows, axis=0)
    determined = (jnp.abs(jnp.diag(triangle)) > RANK_TOLERANCE * length).all() & jnp.isfinite(triangle).all()
    inverse = jax.scipy.linalg.solve_triangular(jnp.where(determined, triangle, jnp.eye(k)), jnp.eye(k))
    return jnp.where(determined, inverse @ inverse.T, 0.0), determined


def _estimated(
    ready: LeastSquares,
    here: Linearised,
    used: Bool[Any, " n"],
    formal: Float[Any, "k k"],
    moved: Considered | None,
    uncertain: Uncertain | None,
    result: RESULTS,
    is_determined: Any,
) -> Estimate:
    """The answer at a solution."""
    math, scale, pulled = arrays_of((here.rows, formal)), ready.scale, ready.prior @ here.u
    kept = used if ready.problem.loss is None else used & (here.squared <= BLUNDER**2)
    result = first_failure(
        failure_if(~math.asarray(is_determined), RESULTS.rank_deficient),  # also the cause where the iteration did not end
        result,
        _worst(math.where(used, ready.unseen, 0)),
        _worst(here.unseen),
    )
    variance = formal.diagonal()
    share_left = math.where(math.asarray(ready.has_prior), variance, math.nan)
    lost = ~(variance > 0)
    spread = formal if uncertain is None else uncertain.of(formal)
    covariance = spread * math.outer(scale, scale) + (0.0 if moved is None else moved.covariance(scale))
    cost = math.where(kept, here.squared, 0.0).sum() + pulled @ pulled
    covariance = math.where(lost[:, None] | lost[None, :], math.where(math.eye(len(scale)) > 0, math.inf, math.nan), covariance)
    return Estimate(
        value=ready.values(here.u),
        covariance=covariance,
        prior_share=share_left,
        cost=cost if moved is None else cost - moved.explains(ready, here, kept),
        freedom=2 * kept.sum() + ready.has_prior.sum() - len(scale),
        result=result,
        names=ready.problem.unknowns.names,
        places=ready.problem.unknowns.places,
    )


def _worst(codes: Any) -> RESULTS:
    """The first failure among codes of observations."""
    code = codes[arrays_of(codes).argmax(codes != 0)]
    return jax.tree.map(lambda _: code.astype(np.int32), RESULTS.successful)


def _cleanse(
    ready: LeastSquares,
    here: Linearised,
    control: Bool[np.ndarray, " n"],
    unknowns: Sequence[Unknown],
    blunders: Blunders | None,
    reweigh: Reweigh | None,
    considered_px: Float[np.ndarray, "n 2 c"] | None,
) -> tuple[LeastSquares, Linearised, Bool[np.ndarray, " n"], Sequence[Unknown], Components | None, Uncertain | None]:
    """Blunders and weights, in turn until neither changes: each is judged by the other."""
    used, found, given = control, None, ready
    if blunders is not None:
        here, used = data_snooping(ready, here, control, blunders)
    rows, _ = weighted_rows(ready, here, used.astype(float))
    if reweigh is None or np.linalg.matrix_rank(rows) < len(unknowns):  # what nothing determines has no weights either
        return ready, here, used, unknowns, None, None
    grouping = group(reweigh, ready.observations, unknowns)
    for i in range(_ROUNDS):
        tell(f"weights: round {i + 1}")
        last, (grouping, found) = found, decided(grouping, reweigh.spread, given, here, used, considered_px)
        observed, prior = weighing(grouping, found)
        ready = given.reweighed(observed, prior)
        here = refine(ready, linearise(ready, here.u), used.astype(float), steps=20)
        if blunders is not None:
            here, used = data_snooping(ready, here, control, blunders)
        settled = last is not None and last.names == found.names
        if settled and np.abs(np.log(found.factor / last.factor)).max(initial=0.0) < _SAME_FACTOR:
            break
    sigma = [None if x.sigma is None else x.sigma * float(factor) for x, factor in zip(unknowns, prior, strict=True)]
    unknowns = tuple(dataclasses.replace(x, sigma=s) for x, s in zip(unknowns, sigma, strict=True))
    assert found is not None
    uncertain = of_least_squares(found, data_of(grouping, reweigh.spread, given, here, used), len(unknowns))
    return ready, here, used, unknowns, found, uncertain


def _effects_px(
    ready: LeastSquares, here: Linearised, numbers: Given, errors: Sequence[FrameErrors], surface: AbstractSurface | None
) -> Float[Any, "n 2 c"] | None:
    """What is considered does to every residual in pixels at the solution, a column for one sigma of each; None for nothing.

    Numbers of the sensor with their joint prior, and what exposures have in common of the errors of recorded frames.
    """
    for x in numbers.unknowns:
        if x.sigma is None:
            raise WhiskjaxError(f"consider: {x.name} has no prior sigma; its uncertainty is what would be considered")
    wander = any(not one.is_white for one in errors)
    if not numbers.unknowns and not wander:
        return None
    solved = ready.problem.unknowns.put(ready.sensor, here.u)
    effects = []
    if numbers.unknowns:
        changed = prepare(solved, ready.observations, numbers, None).weighted(ready.weight)
        root = arrays_of(numbers.correlation).linalg.cholesky(numbers.correlation)
        effects.append(linearise(changed, changed.start).rows_px @ root)
    if wander:
        seen = ready.observations
        common, _ = common_columns_px(errors, solved, seen.shot, unstack(seen.point_m), surface)
        effects.append(-plain(common))  # of the residual: measured less projected from the pose as it was recorded
    return arrays_of(effects).concatenate(effects, axis=2)


def _raise(answer: Calibration) -> None:
    if (code := int(codes_of(answer.result))) == 0:
        return
    if answer.posterior.is_determined and answer._here.unseen.any():
        raise SensorError(f"calibrate: {ended(answer.evidence)}")
    named = ""
    if not answer.posterior.is_determined:
        told = list(zip([x.name for x in answer.unknowns], np.isfinite(answer.posterior.sigma), strict=True))
        lost, left = ([name for name, known in told if known == which] for which in (False, True))
        named = f": {', '.join(lost)}. Give them priors, or leave out all but one of each group that moves together"
        named += f". Determined are {', '.join(left)}" if left else ""
        named += f". The data determine {answer.posterior.rank} of {len(told)} combinations of the unknowns"
    raise SensorError(f"calibrate: {message_of(code)}{named}")
