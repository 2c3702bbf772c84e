"""`locate`: one target from many looks, by a filter or by all of them at once."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import stack, unstack, vadd
from ..chain.detector import is_beside
from ..chain.extremes import refuse_extremes
from ..chain.imaging import into_camera
from ..chain.sensor import Sensor, fit_sensor
from ..earth.surface import AbstractSurface, HeightSurface, need_surface
from ..estimate.checks import ended
from ..estimate.errors import FrameErrors, need_errors
from ..estimate.estimate import Estimate
from ..estimate.evidence import kinks, records
from ..estimate.given import Knowledge
from ..estimate.level import refuse_unknown_up
from ..rules import RESULTS, Arrays, Numbers, SensorError, WhiskjaxError, first_failure, is_traced, need, need_flags
from ..rules.progress import tell
from ..rules.results import choose, codes_of, failure_if, is_successful
from .all_looks import Solved, at_last, solve
from .filter import Step, run
from .fitted import Residuals
from .guess import Guess, first_guess, take_sigma
from .location import Location
from .look_by_look import LookByLook
from .looks import Looks
from .model import Model
from .motion import ConstantVelocity
from .nuisance import gather
from .problem import Problem, as_matrix
from .remembered import remember
from .verdict import convergence, has_diverged, weakest

_RELINEARISED = {"extended": 0, "iterated": 5}
_METHODS = (*_RELINEARISED, "batch")
_BATCH_STEPS, _CHECK_STEPS = 15, 5
_SETTLED_SIGMAS = 1e-3


def locate(
    sensor: Sensor,
    looks: Looks,
    *,
    guess: Guess | None = None,
    surface: AbstractSurface | None = None,
    sigma_enu_m: Float[Numbers, "3"] | None = None,
    errors: Sequence[FrameErrors] = (),
    method: str = "iterated",
    estimate: Knowledge = (),
    consider: Knowledge = (),
    motion: ConstantVelocity | None = None,
    gate: float | None = None,
    throw: bool = True,
) -> Location:
    """Locate a target that many looks have seen, without a range finder.

    Traceable: under `jit` and `vmap` nothing is raised; look at `result`.

    **Arguments:**

    - `looks`: measured pixels in the order of time; links may hold records aligned with them (`Records`, `Readings`).
    - `guess`: where the filter starts. Without one: the intersection of the first look with `surface`, known to `sigma_enu_m`.
    - `surface`: for the first guess, and for what is up at the target; the ellipsoid by default.
    - `errors`: how the recorded poses of frames err; without them R is that of the pixels alone, as in Liu et al. (2019). What is
      new at every look enters R; what looks have in common is estimated with the target, by a filter as states, by a batch as the
      covariance of all looks (innovations.py: a step takes time with the looks, covariances of residuals with their square).
    - `method`: "extended" (Liu et al. 2019, equations 13 to 18), "iterated" (each look linearised again at its own result), or
      "batch" (Gauss-Newton over all looks).
    - `estimate`: numbers of the sensor with priors, estimated with the target: a boresight, a bias at a joint, a delay.
    - `consider`: numbers that are not estimated but whose uncertainty counts (Schmidt 1966): unknowns with priors, or an earlier
      answer, whose posterior is handed on.
    - `motion`: for a target that moves; the result is its place at the last look.
    - `gate`: the share of good looks that may be lost, as 1e-3: a look whose NIS is exceeded by chance less often is left out and
      listed; None takes all.
    - `throw`: raise where there is no answer; else look at `result`.

    **Returns:** `Location`.

    **Raises:** `WhiskjaxError` for input that makes no sense; `SensorError` where a look cannot be imaged, the distance is not
    observable (the message gives the line), or the filter diverged.

    **Reference:** Liu et al. (2019); Bell and Cathey (1993) for the iterated filter; Schmidt (1966).
    """
    surface = HeightSurface(0.0) if surface is None else surface
    need("locate", "sensor", sensor, Sensor)
    need_flags("locate", throw=throw)
    need("locate", "looks", looks, Looks, "Looks(shot, pixel_px, sigma_px)")
    need_surface("locate", surface)
    for name, value, kind in (("guess", guess, Guess), ("motion", motion, ConstantVelocity)):
        if value is not None:
            need("locate", name, value, kind)
    if guess is not None and sigma_enu_m is not None:
        raise WhiskjaxError("locate: guess says where the target may be, and so does sigma_enu_m; give one of them")
    errors = need_errors("locate", errors)
    arrays = Arrays("locate")
    fit_sensor(arrays, sensor, looks.shot)
    arrays.fit("looks.pixel_px", looks.pixel_px.shape, "... 2")
    for i, one in enumerate(errors):
        for sigma in one.sigma:
            arrays.fit(f"errors[{i}]", np.shape(sigma), "...")
    if method not in _METHODS:
        raise WhiskjaxError(f"locate: method is one of {', '.join(_METHODS)}, not {method!r}")
    refuse_extremes(sensor, "locate")
    for one in errors:
        _refuse(one, sensor, looks, surface)
    common = remember(errors, looks.shot, len(looks))
    if gate is not None and not 0 < float(Arrays("locate").take("gate", gate, "")) < 1:
        raise WhiskjaxError(f"locate: gate is a probability between 0 and 1, not {gate!r}")
    if motion is not None:
        if method == "batch" and (is_traced(motion.acceleration_enu) or bool((np.asarray(motion.acceleration_enu) != 0).any())):
            raise WhiskjaxError('locate: a batch knows even motion only; set acceleration_enu to zero, or use method="iterated"')
    if not is_traced(looks.pixel_px) and np.isnan(np.asarray(looks.pixel_px)).any(axis=1).all():
        raise WhiskjaxError("locate: no look has a measurement")
    if guess is None:
        if sigma_enu_m is None:
            raise WhiskjaxError("locate: give a guess, or sigma_enu_m: how far the first look's place on the surface may be off")
        take_sigma(Arrays("locate"), sigma_enu_m)
        guess = first_guess(sensor, looks, surface, sigma_enu_m, throw=throw)
    sensor, nuisance = gather(sensor, estimate, consider)
    if not is_traced(looks.pixel_px):
        tell(f"locate: {len(looks)} looks, {method} (the first time compiled)")
    nis = None if gate is None else -2 * math.log(gate)
    answer = _solve(Problem(sensor, looks, guess, surface, errors, nuisance, motion, common), method, nis)
    if throw:
        _raise(answer)
    return answer


def _refuse(one: FrameErrors, sensor: Sensor, looks: Looks, surface: AbstractSurface) -> None:
    """**Raises:** `WhiskjaxError` for errors of which a target's covariance can know nothing."""
    one.check(sensor)
    one.refuse_free("locate")
    if one.axes == "level":
        refuse_unknown_up(one.frame, sensor.pose(looks.shot, one.frame).translation, surface)


@eqx.filter_jit
def _solve(problem: Problem, method: str, gate_nis: float | None) -> Location:
    model, prior = problem.pose()
    is_missed = problem.looks.is_missed
    poses = jax.tree.map(lambda code: code + jnp.zeros(is_missed.shape, jnp.int32), problem.sensor.check(problem.looks.shot))
    if method == "batch":
        found = solve(model, prior, at_last(model, prior)[0], _BATCH_STEPS, gate_nis)
        state, covariance, chi_square = found.state, found.covariance, found.cost
        looks = _of_batch(model, found, is_missed, poses, _at_end(model, state))
        lost = failure_if(~(found.step < _SETTLED_SIGMAS), RESULTS.not_converged)
    else:
        belief, steps = run(model, prior, _RELINEARISED[method], gate_nis)
        state, covariance, looks = (
            jnp.stack(belief.state),
            as_matrix(belief.covariance),
            _of_filter(model, steps, is_missed, poses, _at_end(model, jnp.stack(belief.state))),
        )
        chi_square = jnp.where(looks.is_used, looks.nis, 0.0).sum()
        taken = eqx.tree_at(lambda m: m.pixel_px, model, tuple(jnp.where(looks.is_used, z, jnp.nan) for z in model.pixel_px))
        found = solve(taken, prior, state, _CHECK_STEPS, None)
        lost = failure_if(has_diverged(model, state, covariance, looks.nis, looks.is_used, found), RESULTS.diverged)
    direction, line_sigma = weakest(model, prior, found)
    ended, kinematic = stack(model.anchor_m) + state[:3], model.kinematic
    sensor = model.nuisance.put(model.sensor, tuple(state[kinematic:]))
    away = jnp.stack([jnp.broadcast_to(c, looks.nis.shape) for c in sensor.pose(model.shots).translation], -1) - ended[None]
    distance = jnp.linalg.norm(away, axis=-1)
    nearest = jnp.where(looks.is_used, distance, jnp.inf).min()
    measured = ~is_missed & is_successful(looks.result)
    unseen = measured & ~looks.counts
    result = first_failure(
        failure_if(~(jnp.isfinite(ended).all() & jnp.isfinite(covariance).all()), RESULTS.nonfinite),
        choose(looks.counts.any(), RESULTS.successful, _first_code(looks.result)),
        failure_if(measured.any() & ~looks.counts.any(), RESULTS.point_behind_camera),
        failure_if((2 * unseen.sum() > measured.sum()) | (looks.counts.any() & ~looks.is_used.any()), RESULTS.diverged),
        failure_if(~(line_sigma < 0.5 * nearest), RESULTS.depth_unobservable),
        lost,
        _first_code(choose(looks.impossible, looks.at_end, RESULTS.successful)),
    )
    answered = is_successful(result)
    enu = as_matrix(problem.surface.level(unstack(ended)))
    level = enu.T[None] @ looks.covariance_enu_m2 @ enu[None]
    numbers = model.nuisance.numbers
    return Location(
        point_m=jnp.where(answered, ended, jnp.nan),
        covariance_enu_m2=jnp.where(answered, enu.T @ covariance[:3, :3] @ enu, jnp.nan),
        world_from_enu=enu,
        velocity_enu_mps=enu.T @ state[3:6] if kinematic == 6 else None,
        velocity_covariance_enu=enu.T @ covariance[3:6, 3:6] @ enu if kinematic == 6 else None,
        estimate=Estimate(
            value=numbers.value(state[kinematic:]),
            covariance=covariance[kinematic:, kinematic:] * jnp.outer(numbers.scale, numbers.scale),
            prior_share=jnp.diagonal(covariance)[kinematic:],
            cost=chi_square,
            freedom=2 * looks.is_used.sum(),
            result=result,
            names=numbers.names,
            places=numbers.places,
        ),
        looks=eqx.tree_at(lambda b: b.covariance_enu_m2, looks, level),
        convergence_rad=convergence(away / distance[:, None], looks.is_used),
        line_m=ended,
        line_direction=direction,
        line_sigma_m=line_sigma,
        result=result,
        shift=state[kinematic:],
        record=records(problem.looks.shot, problem.looks.pixel_px, problem.looks.sigma_px),
        _time_s=problem.looks.shot.time_s,
        _residuals=Residuals.of(model, prior, found),
        _sensor=problem.sensor,
        _pixel_px=jnp.nan_to_num(problem.looks.pixel_px),
        _shot=problem.looks.shot,
        _errors=problem.errors,
        _surface=problem.surface,
        is_estimated=tuple(share == 1 for share in model.nuisance.share),
        kinks=kinks(problem.sensor, numbers),
        method=method,
    )


def _at_end(model: Model, state: Float[Array, " n"]) -> RESULTS:
    """Of each look, whether it can have seen the target of a state of the last look; a target that moves did so evenly."""
    kinematic = model.kinematic
    moved = [0.0] * 3 if model.since_s is None else [model.since_s * state[3 + i] for i in range(3)]
    point = tuple(a + state[i] + moved[i] + jnp.zeros(model.pixel_px[0].shape) for i, a in enumerate(model.anchor_m))
    sensor = model.nuisance.put(model.sensor, tuple(state[kinematic:]))
    seen = sensor.camera_at(model.shots).check_direction(into_camera(sensor, model.shots, point))
    return jax.tree.map(lambda code: code + jnp.zeros(point[0].shape, jnp.int32), seen)


def _of_filter(model: Model, steps: Step, is_missed: Bool[Array, " looks"], result: RESULTS, at_end: RESULTS) -> LookByLook:
    (state, covariance), innovation = steps.belief, steps.innovation
    s00, s01, s11 = innovation.covariance
    residual, spread = _in_pixels(model, stack(innovation.residual), as_matrix(((s00, s01), (s01, s11))), is_missed)
    return LookByLook(
        point_m=stack(vadd(model.anchor_m, state[:3])),
        covariance_enu_m2=as_matrix(tuple(row[:3] for row in covariance[:3])),
        innovation_px=residual,
        innovation_covariance_px2=spread,
        nis=innovation.nis,
        is_missed=is_missed,
        result=result,
        counts=steps.counts,
        passes=jnp.broadcast_to(steps.passes, is_missed.shape),
        at_end=at_end,
        is_beside=_beside(model),
    )


def _of_batch(model: Model, found: Solved, is_missed: Bool[Array, " looks"], result: RESULTS, at_end: RESULTS) -> LookByLook:
    """A batch knows one answer; of a moving target it is where that was at each look."""
    looks = found.nis.shape[0]
    moved = 0.0 if model.since_s is None else model.since_s[:, None] * found.state[None, 3:6]
    residual, spread = _in_pixels(model, found.equations.residual, found.residual_covariance, is_missed)
    return LookByLook(
        point_m=jnp.broadcast_to(stack(model.anchor_m) + found.state[:3], (looks, 3)) + moved,
        covariance_enu_m2=jnp.broadcast_to(found.covariance[:3, :3], (looks, 3, 3)),
        innovation_px=residual,
        innovation_covariance_px2=spread,
        nis=found.nis,
        is_missed=is_missed,
        result=result,
        counts=found.equations.counts,
        passes=found.passes,
        at_end=at_end,
        is_beside=_beside(model),
    )


def _beside(model: Model) -> Bool[Array, " looks"]:
    """Looks that were measured far beside the detector."""
    return is_beside(model.sensor.camera_at(model.shots), model.pixel_px)


def _in_pixels(
    model: Model, residual: Float[Array, "looks 2"], covariance: Float[Array, "looks 2 2"], is_missed: Bool[Array, " looks"]
) -> tuple[Float[Array, "looks 2"], Float[Array, "looks 2 2"]]:
    """From sigmas of the pixel to pixels; a look that was missed has no residual."""
    sigma = jnp.broadcast_to(stack(model.sigma_px), residual.shape)
    return jnp.where(is_missed[:, None], jnp.nan, residual * sigma), covariance * sigma[:, :, None] * sigma[:, None, :]


def _first_code(of_looks: RESULTS) -> RESULTS:
    """The code of the first look that failed; success where none did."""
    return jax.tree.map(lambda code: code[jnp.argmax(code != 0)], of_looks)


def _raise(answer: Location) -> None:
    """The failure in words; where the distance is not observable, the line on which the target lies."""
    if answer.result.is_traced() or int(codes_of(answer.result)) == 0:
        return
    line = ""
    if bool(answer.result == RESULTS.depth_unobservable):
        point, direction = (np.asarray(v).round(6).tolist() for v in (answer.line_m, answer.line_direction))
        line = f". The line: through {point} m along {direction} (world frame)"
    raise SensorError(f"locate: {ended(answer.evidence)}{line}")
