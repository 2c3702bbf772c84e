"""`locate`: one target from many looks, by a filter or by all of them at once."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..algebra.vectors import stack, unstack
from ..chain.extremes import refuse_extremes
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
from .all_looks import at_last, solve
from .filter import run
from .fitted import Residuals
from .ground import ground_seen
from .guess import Guess, first_guess, take_sigma
from .history import of_batch, of_filter
from .location import Location
from .looks import Looks
from .motion import ConstantVelocity
from .nuisance import gather
from .problem import Problem, as_matrix
from .remembered import remember
from .verdict import convergence, has_diverged, off_optimum, weakest

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
    surface_sigma_m: Float[Numbers, ""] | None = None,
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
    - `surface_sigma_m`: of a target that is known to lie on the surface, how well (1-sigma of its distance from it): an
      observation beside the looks, which alone need not know the distance then. None: nothing is known of its height.
    - `errors`: how the recorded poses of frames err; without them R is that of the pixels alone, as in Liu et al. (2019). What is
      new at every look enters R; what looks have in common is estimated with the target, by a filter as states, by a batch as the
      covariance of all looks (innovations.py: a step takes time with the looks, covariances of residuals with their square).
    - `method`: "extended" (Liu et al. 2019, equations 13 to 18), "iterated" (each look linearised again at its own result), or
      "batch" (Gauss-Newton over all looks).
    - `estimate`: numbers of the sensor with priors, estimated with the target: a boresight, a bias at a joint, a delay.
    - `consider`: numbers that are not estimated but whose uncertainty counts (Schmidt 1966): unknowns with priors, or an earlier
      answer, whose posterior is handed on.
    - `motion`: for a target that moves; the result is its place at the last look.
    - `gate`: the share of good looks that may be lost, as 1e-3: a look that lies where it would less often by chance is left out
      and listed; None takes all. It is judged beside the solution of all others, whatever their order, until the looks that pass
      are those that made it; where a target has accelerations by the filter, beside the looks before it.
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
    known_m = None
    if surface_sigma_m is not None:
        known_m = jnp.asarray(arrays.take("surface_sigma_m", surface_sigma_m, "", finite=True, above=0.0, meaning="metres"))
    if method not in _METHODS:
        raise WhiskjaxError(f"locate: method is one of {', '.join(_METHODS)}, not {method!r}")
    refuse_extremes(sensor, "locate")
    for one in errors:
        _refuse(one, sensor, looks, surface)
    common = remember(errors, looks.shot, len(looks))
    if gate is not None and not 0 < float(Arrays("locate").take("gate", gate, "")) < 1:
        raise WhiskjaxError(f"locate: gate is a probability between 0 and 1, not {gate!r}")
    is_even = motion is None or not (is_traced(motion.acceleration_enu) or bool((np.asarray(motion.acceleration_enu) != 0).any()))
    if method == "batch" and not is_even:
        raise WhiskjaxError('locate: a batch knows even motion only; set acceleration_enu to zero, or use method="iterated"')
    if not is_traced(looks.pixel_px) and np.isnan(np.asarray(looks.pixel_px)).any(axis=1).all():
        raise WhiskjaxError("locate: no look has a measurement")
    if guess is None:
        if sigma_enu_m is None:
            raise WhiskjaxError("locate: give a guess, or sigma_enu_m: how far the first look's place on the surface may be off")
        take_sigma(Arrays("locate"), sigma_enu_m)
        guess = first_guess(sensor, looks, surface, sigma_enu_m, throw=throw)
    ground = None if known_m is None else ground_seen(sensor, looks, surface, known_m)
    sensor, nuisance = gather(sensor, estimate, consider)
    if not is_traced(looks.pixel_px):
        tell(f"locate: {len(looks)} looks, {method} (the first time compiled)")
    nis = None if gate is None else -2 * math.log(gate)
    answer = _solve(
        Problem(sensor, looks, guess, surface, errors, nuisance, motion, common, looks.repeats(), ground), method, nis, is_even
    )
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
def _solve(problem: Problem, method: str, gate_nis: float | None, is_even: bool) -> Location:
    model, prior = problem.pose()
    standing, started = problem.standing(), at_last(model, prior)[0]
    if method == "batch":
        found = solve(model, prior, started, _BATCH_STEPS, gate_nis)
        state, covariance, chi_square = found.state, found.covariance, found.cost
        looks = of_batch(model, found, standing)
        lost, off = failure_if(~(found.step < _SETTLED_SIGMAS), RESULTS.not_converged), jnp.zeros(())
    else:
        # A filter's own gate depends on the order of the looks: which pass it is asked of all of them, if that can be.
        found = solve(model, prior, started, _BATCH_STEPS, gate_nis) if gate_nis is not None and is_even else None
        passes = None if found is None else found.passes
        belief, steps = run(model, prior, _RELINEARISED[method], gate_nis if found is None else None, passes)
        state, covariance = jnp.stack(belief.state), as_matrix(belief.covariance)
        looks = of_filter(model, steps, standing, state)
        chi_square = jnp.where(looks.is_used, looks.nis, 0.0).sum()
        if found is None:
            taken = eqx.tree_at(lambda m: m.pixel_px, model, tuple(jnp.where(looks.is_used, z, jnp.nan) for z in model.pixel_px))
            found = solve(taken, prior, state, _CHECK_STEPS, None)
        lost = failure_if(has_diverged(model, state, covariance, looks.nis, looks.is_used, found), RESULTS.diverged)
        off = off_optimum(model, state, found)
    direction, line_sigma = weakest(model, prior, found)
    known_sigma = line_sigma if problem.ground is None else weakest(model, prior, found, problem.ground)[1]
    ended, kinematic = stack(model.anchor_m) + state[:3], model.kinematic
    sensor = model.nuisance.put(model.sensor, tuple(state[kinematic:]))
    away = jnp.stack([jnp.broadcast_to(c, looks.nis.shape) for c in sensor.pose(model.shots).translation], -1) - ended[None]
    distance = jnp.linalg.norm(away, axis=-1)
    nearest = jnp.where(looks.is_used, distance, jnp.inf).min()
    measured = standing.is_measured
    unseen = measured & ~looks.counts
    result = first_failure(
        failure_if(~(jnp.isfinite(ended).all() & jnp.isfinite(covariance).all()), RESULTS.nonfinite),
        choose(looks.counts.any(), RESULTS.successful, _first_code(looks.result)),
        failure_if(measured.any() & ~looks.counts.any(), RESULTS.point_behind_camera),
        failure_if((2 * unseen.sum() > measured.sum()) | (looks.counts.any() & ~looks.is_used.any()), RESULTS.diverged),
        failure_if(~(known_sigma < 0.5 * nearest), RESULTS.depth_unobservable),
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
        off_optimum_sigmas=off,
        surface_sigma_m=None if problem.ground is None else problem.ground.sigma_m,
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
