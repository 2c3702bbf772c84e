"""Block adjustment: trajectory, mounts, cameras and points from the rays of control and tie points together."""

import dataclasses
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Bool, Float, Int

from ...chain.detector import beside_detector, refuse_pixels_without_direction
from ...chain.extremes import refuse_extremes
from ...chain.sensor import Sensor
from ...rules import RESULTS, Arrays, SensorError, WhiskjaxError, first_failure, need, need_flags, require_x64
from ...rules.progress import tell
from ...rules.results import codes_of, message_of
from ..blunders import Blunders
from ..diagnosis import UNLIKELY, consistency, kinked
from ..errors import AXES, FrameErrors
from ..given import Knowledge, given
from ..unknown import Unknown
from ..variance_components import Components
from ..verdict import contradictions
from . import weights
from .adjustment import Adjustment, Trust
from .begin import begin
from .block import Block
from .check import checked
from .connect import connections, seen_once
from .covariance import covariances, evaluate
from .crossing import at_crossing, refuse_unrecorded
from .prepare import Prepared, Ready, State, prepare
from .solve import Solved, gauss_newton
from .station_errors import StationErrors, at_stations
from .wrong_ties import data_snooping

_NAMED = 10
_SINGULAR = 1e-13  # bound of the smallest eigenvalue of the normal matrix, scaled to unit diagonal; sound blocks have 1e-5


def adjust(
    sensor: Sensor,
    block: Block,
    unknowns: Knowledge = (),
    *,
    errors: Sequence[FrameErrors] = (),
    start_m: Float[np.ndarray, "points 3"] | None = None,
    blunders: Blunders | None = None,
    reweigh: bool = False,
    retime: bool = True,
    max_steps: int = 30,
    throw: bool = True,
) -> Adjustment:
    """Adjust a block by least squares: rays of control, check and tie points, POS, and priors of the unknowns.

    Points are eliminated (normal.py); what remains is solved by Gauss-Newton steps, damped where one would climb. For songshan,
    with orientation images, this is the block adjustment of Wang et al. (2018) with its equations (2) and (7), lever arm and
    boresight solved jointly.

    **Arguments:**

    - `sensor`: the chain with start values.
    - `unknowns`: lever arm, boresight, detector lines, drifts: numbers anywhere in the sensor but in the link of `errors`; an
      earlier answer, or its `Estimate`, is the joint prior of its numbers.
    - `errors`: how the record of one link errs whose motions at stations (orientation images, spline coefficients, images) are
      estimated: statements of it add, white or Ornstein-Uhlenbeck, drawn anew for each "strip" (segment of its nodes) or not;
      infinite sigmas are free poses. Without a statement the trajectory is kept as it is.
    - `start_m`: approximate coordinates, world frame, metres; by default the rays are intersected with the start values (of free
      poses, after the images are resected from control points).
    - `blunders`: find wrong rays, leave them out and name them (wrong_ties.py).
    - `reweigh`: sigmas of tie rays, control points, POS attitude and POS position from the data (weights.py).
    - `retime`: of line cameras, evaluate rays where the fitted points cross the line, so that errors of the measured line are not
      taken for geometry (crossing.py); `Adjustment.block` is the block so timed. Off, the block is adjusted as it is.
    - `max_steps`: of each solution; blunders and weights take several.
    - `throw`: raise where the block cannot be solved; else look at `result`.

    **Returns:** `Adjustment`. Without control points the datum rests on POS, and a warning says so. Check and tie points that one
    ray alone sees are left out and listed.

    **Raises:** `WhiskjaxError` naming a ray or a strip, or where nothing remains; `SensorError` naming points with parallel rays,
    a ray that the adjusted sensor cannot have made, or where the equations are singular.
    """
    require_x64("adjust")
    need("adjust", "sensor", sensor, Sensor)
    need("adjust", "block", block, Block)
    priors = given("adjust", "unknowns", unknowns)
    unknowns = priors.unknowns
    if blunders is not None:
        need("adjust", "blunders", blunders, Blunders)
    need("adjust", "reweigh", reweigh, (bool, np.bool_), "True; groups as of Reweigh() are for calibrate")
    need_flags("adjust", retime=retime, throw=throw)
    motions = at_stations("adjust", errors, sensor, block)
    if not unknowns and motions is None:
        raise WhiskjaxError("adjust: nothing but points is unknown; give unknowns or errors, or use intersect")
    refuse_extremes(sensor, "adjust")
    sensor.refuse_aligned("adjust")
    refuse_pixels_without_direction("adjust", sensor, block.shots(), block.pixel_px, block.ray_label)
    lonely = seen_once(block)
    refuse_unrecorded(sensor, block)
    tell(f"adjust: {len(block)} rays of {int(block.seen.sum())} points")
    if start_m is None:
        sensor, start_m = begin(sensor, block, motions)
    start_m = np.asarray(Arrays("adjust").take("start_m", start_m, f"{len(block.role)} 3", absolute=True))
    unplaced = np.flatnonzero(block.seen & ~lonely & (block.role != "control") & ~np.isfinite(start_m).all(axis=1))
    if unplaced.size:
        raise WhiskjaxError(f"{block.point_label(int(unplaced[0]))}: start_m holds no finite coordinates of it")
    prepared = prepare(sensor, block, priors, motions, start_m)
    start_u = np.asarray(prepared.start.u)
    solved = gauss_newton(prepared.ready, prepared.start, max_steps)
    if retime and sensor.is_line and int(codes_of(solved.result)) == 0:
        prepared = retimed(prepared, solved.state, priors, motions)
        solved = gauss_newton(prepared.ready, prepared.start, max_steps)
    used, found = ~lonely[block.point], None
    for _ in range(2 if blunders is not None and reweigh else 1):  # each is judged by the other
        if blunders is not None and _is_fine(solved):
            prepared, solved, used = data_snooping(prepared, solved, used, blunders, max_steps)
        if reweigh and _is_fine(solved):
            prepared, solved, more = weights.reweigh(prepared, solved, used, max_steps)
            found = more if found is None else more._replace(factor=found.factor * more.factor)
    return report(prepared, solved, unknowns, tuple(errors), motions, start_u, used, found, throw)


def _is_fine(solved: Solved) -> bool:
    """Whether there is a solution, and equations that determine it."""
    return int(codes_of(solved.result)) == 0 and _inverse(solved.reduced.matrix) is not None


def retimed(prepared: Prepared, state: State, unknowns: Knowledge, motions: StationErrors | None) -> Prepared:
    """The block with every ray at the crossing of its fitted point, to be solved again from the state."""
    ready = prepared.ready
    point = prepared.by_point(np.stack([np.asarray(c) for c in state.points], axis=-1))
    given, lonely = prepared.block, seen_once(prepared.block)[prepared.block.point]
    block = at_crossing(ready.unknowns.put(ready.sensor, state.x, state.u), given, point)
    if lonely.any():  # a ray whose point has no place stays as it was measured
        time_s = np.where(lonely, np.asarray(given.key("time_s")), np.asarray(block.key("time_s")))
        pixel_px = np.where(lonely[:, None], given.pixel_px, block.pixel_px)
        block = dataclasses.replace(block, shot=dataclasses.replace(block.shots(), time_s=time_s), pixel_px=pixel_px)
    again = prepare(ready.sensor, block, unknowns, motions, point, prepared.plan)
    return dataclasses.replace(again, start=State(state.x, state.u, again.start.points))


def report(
    prepared: Prepared,
    solved: Solved,
    unknowns: Sequence[Unknown],
    errors: tuple[FrameErrors, ...],
    motions: StationErrors | None,
    start_u: Float[np.ndarray, " q"],
    used: Bool[np.ndarray, " rays"],
    found: Components | None,
    throw: bool,
) -> Adjustment:
    """What people want to know of a solution."""
    ready, block = prepared.ready, prepared.block
    result = solved.result
    inverse = _inverse(solved.reduced.matrix)
    if inverse is None:
        result = first_failure(RESULTS.rank_deficient if np.isfinite(solved.reduced.cost) else RESULTS.nonfinite, result)
    if throw and int(codes_of(result)) != 0:
        raise SensorError(f"adjust: {message_of(int(codes_of(result)))}{_weak(prepared, solved, unknowns, motions)}")
    state = solved.state
    tell("adjust: residuals and covariances (the first time compiled)")
    residual, codes, point, covariance = _evaluated(prepared, state, inverse)
    codes = np.where(used, codes, 0)
    impossible = _impossible(block, codes)
    if impossible:
        if throw:
            raise SensorError(f"adjust: {impossible[0]}")
        worst = int(codes[codes != 0][0])
        result = first_failure(result, jax.tree.map(lambda _: np.int32(worst), RESULTS.successful))
    nowhere, lonely = prepared.lone(used), seen_once(block)
    point[nowhere], covariance[nowhere], residual[lonely[block.point]] = np.nan, np.nan, np.nan
    numbers = ready.unknowns
    size = state.x.size
    mean, scale = np.asarray(numbers.others.mean), np.asarray(numbers.others.scale)
    value = mean + scale * np.asarray(state.u)
    trust = _trust(ready, state, inverse)
    squared = np.where(used[:, None], (residual / block.sigma_px) ** 2, 0.0)
    control = (block.role == "control") & block.seen
    freedom = (
        2 * int(used.sum())
        + 3 * int(control.sum())
        + int((np.abs(np.asarray(ready.roots)).sum(axis=2) > 0).sum())
        + int((np.asarray(ready.unknowns.others.root) != 0).any(axis=1).sum())
        - size
        - len(value)
        - 3 * len(np.unique(block.point[used | control[block.point]]))
    )
    cost = float(solved.reduced.cost)
    factor, tail, sound = consistency(cost, freedom)
    check = checked(prepared, solved, used, point, covariance)
    solution = numbers.put(ready.sensor, state.x, state.u)
    return Adjustment(
        sensor=solution,
        unknowns=tuple(unknowns),
        value=value,
        start=mean + scale * start_u,
        trust=trust,
        block=block,
        errors=errors,
        motions=motions,
        point_m=point,
        covariance_m2=covariance,
        residual_px=residual,
        used=used,
        components=found,
        cost=cost,
        freedom=freedom,
        variance_factor=factor,
        tail_probability=tail,
        is_consistent=sound,
        steps=solved.steps,
        result=result,
        warnings=(
            *impossible,
            *contradictions(check, found),
            *beside_detector(solution, block.shots(), block.pixel_px, used, block.ray_label),
            *_warnings(block, used, lonely, motions, factor, tail, squared, trust, unknowns),
            *kinked(solution, unknowns),
        ),
        check=check,
        left_out=tuple(block.point_name(int(i)) for i in np.flatnonzero(lonely)),
    )


def _inverse(matrix: Array) -> Float[np.ndarray, "m m"] | None:
    """The inverse of the reduced normal matrix; None where it is not positive definite beyond rounding."""
    diagonal = np.diag(np.asarray(matrix))
    if not (np.isfinite(diagonal).all() and (diagonal > 0).all()):
        return None
    scale = 1 / np.sqrt(diagonal)
    scaled = np.asarray(matrix) * np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        return None
    inverse = np.asarray(cho_solve(cho_factor(scaled), np.eye(len(scaled))))
    # One over the norm is no larger than the smallest eigenvalue, and far cheaper.
    if not np.isfinite(inverse).all() or 1 / np.linalg.norm(inverse, 1) < _SINGULAR:
        return None
    return inverse * np.outer(scale, scale)


def _evaluated(
    prepared: Prepared, state: State, inverse: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Residuals in pixels and failure codes by ray, coordinates and their covariance by point."""
    seen = evaluate(prepared.ready, state)
    residuals, codes = prepared.by_ray(seen.residual_px), prepared.by_ray(seen.code).astype(int)
    point = prepared.by_point(np.stack([np.asarray(c) for c in state.points], axis=-1))
    if inverse is None:
        return residuals, codes, point, np.full((len(point), 3, 3), np.nan)
    covariance = prepared.by_point(covariances(prepared.ready, state, jnp.asarray(inverse)))
    return residuals, codes, point, covariance


def _impossible(block: Block, codes: Int[np.ndarray, " rays"]) -> list[str]:
    """What to say of rays that the sensor cannot have made as it was adjusted: the first by name, and how many there are."""
    if not codes.any():
        return []
    i, count = int(np.argmax(codes != 0)), int((codes != 0).sum())
    more = f" ({count} of {len(codes)} rays fail)" if count > 1 else ""
    hint = ", as in a mirrored block; start nearer" if message_of(int(codes[i])) == RESULTS[RESULTS.point_behind_camera] else ""
    return [f"where the adjustment ended, {block.ray_label(i)}: {message_of(int(codes[i]))}{more}{hint}"]


def _trust(ready: Ready, state: State, inverse: np.ndarray | None) -> Trust:
    """Covariances in the units of the fields."""
    q, size = len(state.u), state.x.size
    scale = np.asarray(ready.unknowns.others.scale)
    sigma = np.asarray(ready.unknowns.sigma)
    if inverse is None:
        inverse = np.full((size + q, size + q), np.nan)
    of_unknowns = inverse[size:, size:] * np.outer(scale, scale)
    of_stations = np.sqrt(np.diag(inverse)[:size]).reshape(state.x.shape) * sigma[:, None]
    has_prior = (np.asarray(ready.unknowns.others.root) != 0).any(axis=1)
    share = np.where(has_prior, 1 - np.diag(inverse)[size:], np.nan)
    return Trust(of_unknowns, np.sqrt(np.diag(of_unknowns)), of_stations.T, share)


def _weak(prepared: Prepared, solved: Solved, unknowns: Sequence[Unknown], motions: StationErrors | None) -> str:
    """Which unknowns take part in the weakest combination of a singular system."""
    matrix = np.asarray(solved.reduced.matrix)
    if not np.isfinite(matrix).all():
        return ": the normal equations hold values that are no numbers"
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > 1e-12 * values[-1]:
        return ""
    weak = np.abs(vectors[:, 0])
    stations = solved.state.x.shape[1]
    names = [f"{axis} of station {k}" for axis in AXES for k in range(stations)] + [x.name for x in unknowns]
    order = np.argsort(-weak)[:6]
    named = ", ".join(names[i] for i in order if weak[i] > 0.1 * weak[order[0]])
    hint = "" if motions is None or motions.observed else "; without POS a block needs three control points or more"
    return f": {named}. Give priors, or leave some of them out{hint}"


def _warnings(
    block: Block,
    used: Bool[np.ndarray, " rays"],
    lonely: Bool[np.ndarray, " points"],
    motions: StationErrors | None,
    factor: float,
    tail: float,
    squared: np.ndarray,
    trust: Trust,
    unknowns: Sequence[Unknown],
) -> list[str]:
    said = []
    if not ((block.role == "control") & block.seen).any():
        rests = "the priors" if motions is None else "POS" if motions.observed else "nothing"
        said.append(f"there is no control point: the datum of the block rests on {rests}")
    if math.isfinite(factor) and tail < UNLIKELY:
        said.append(
            f"residuals are larger than their sigmas say: variance factor {factor:.3g} (probability of a larger one {tail:.1e}); "
            "look for wrong tie points, or let the weights be estimated"
        )
    elif math.isfinite(factor) and factor < 0.5:
        said.append(f"residuals are smaller than their sigmas say: variance factor {factor:.3g}")
    if lonely.any():
        alone = np.flatnonzero(lonely)
        named = ", ".join(block.point_label(int(i)) for i in alone[:_NAMED])
        more = f", ... ({len(alone)} points)" if len(alone) > _NAMED else ""
        said.append(f"seen by one ray only, which determines no point, and left out: {named}{more}")
    wrong = ~used & ~lonely[block.point]
    if wrong.any():
        lost = np.setdiff1d(block.point[wrong], block.point[used]).size
        touched = len(np.unique(block.point[wrong]))
        said.append(f"{int(wrong.sum())} rays of {touched} points are wrong and left out; {lost} points lose all of their rays")
    groups = connections(block.keep(used)) if used.any() else []
    if len(groups) > 1:
        small = min(groups, key=len)
        said.append(f"no point ties {', '.join(small)} to the other images: only POS and control hold them together")
    prior_only = [x.name for x, share in zip(unknowns, trust.data_share, strict=True) if share < 0.05]
    if prior_only:
        said.append(f"fixed by their priors alone: {', '.join(prior_only)}")
    worst = int(np.argmax(np.nan_to_num(squared).max(axis=1)))
    if squared[worst].max() > 36:
        said.append(f"the largest residual, {math.sqrt(squared[worst].max()):.1f} sigma, is that of {block.ray_label(worst)}")
    return said
