"""Block adjustment: trajectory, mounts, cameras and points from the rays of control and tie points together."""

import dataclasses
from collections.abc import Sequence
from contextlib import nullcontext

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...chain.detector import refuse_pixels_without_direction
from ...chain.extremes import refuse_extremes
from ...chain.sensor import Sensor
from ...earth.surface import AbstractSurface, need_surface
from ...rules import Arrays, WhiskjaxError, arrays_of, need, need_flags, plain, require_x64
from ...rules.progress import tell
from ...rules.results import codes_of
from ..blunders import Blunders
from ..errors import FrameErrors
from ..given import Knowledge, given
from ..model_test import NOTHING
from ..variance_components import Reweigh
from . import weights
from .adjustment import Adjustment
from .answer import answer, is_fine, refuse
from .begin import begin
from .block import Block
from .connect import seen_once
from .crossing import at_crossing, refuse_unrecorded
from .derivative import followed, held
from .prepare import Prepared, State, prepare
from .solve import Solved, gauss_newton, reduce
from .station_errors import StationErrors, at_stations
from .wrong_ties import data_snooping


def adjust(
    sensor: Sensor,
    block: Block,
    unknowns: Knowledge = (),
    *,
    errors: Sequence[FrameErrors] = (),
    start_m: Float[np.ndarray, "points 3"] | None = None,
    blunders: Blunders | None = None,
    reweigh: Reweigh | None = None,
    retime: bool = True,
    surface: AbstractSurface | None = None,
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
      in the frame's axes or level ones; infinite sigmas are free poses. Without a statement the trajectory is kept as it is.
    - `start_m`: approximate coordinates, world frame, metres; by default the rays are intersected with the start values (of free
      poses, after the images are resected from control points).
    - `blunders`: find wrong rays, leave them out and name them (wrong_ties.py).
    - `reweigh`: `Reweigh()` finds the sigmas of tie rays and of surveyed points from the data, `Reweigh(priors=True)` those of
      recorded attitudes and positions too (weights.py). That they are not known exactly is in the covariances.
    - `retime`: of line cameras, evaluate rays where the fitted points cross the line, so that errors of the measured line are not
      taken for geometry (crossing.py); `Adjustment.block` is the block so timed. Off, the block is adjusted as it is.
    - `surface`: what is level, for errors in level axes; the ellipsoid by default.
    - `max_steps`: of each solution; blunders and weights take several.
    - `throw`: raise where the block cannot be solved; else look at `result`.

    **Returns:** `Adjustment`. Without control points the datum rests on POS, and a warning says so. Check and tie points that one
    ray alone sees are left out and listed.

    Under jit, vmap and derivatives nothing is raised, and the answer follows every array that goes in, to every order
    (derivative.py), forwards and in reverse. Blunders and weights are searched on the host.

    **Raises:** `WhiskjaxError` naming a ray or a strip, or where nothing remains; `SensorError` naming an image whose rays are
    wrong, points with parallel rays, a ray that the adjusted sensor cannot have made, or where the equations are singular.
    """
    require_x64("adjust")
    need("adjust", "sensor", sensor, Sensor)
    need("adjust", "block", block, Block)
    priors = given("adjust", "unknowns", unknowns)
    if blunders is not None:
        need("adjust", "blunders", blunders, Blunders)
    if reweigh is not None:
        need("adjust", "reweigh", reweigh, Reweigh)
        weights.refuse_groups(reweigh)
    need_flags("adjust", retime=retime, throw=throw)
    if surface is not None:
        need_surface("adjust", surface)
    # Statements that are known are the host's, whatever else is traced.
    with nullcontext() if arrays_of(errors) is jnp else jax.ensure_compile_time_eval():
        motions = at_stations("adjust", errors, sensor, block, surface)
    if not priors.unknowns and motions is None:
        raise WhiskjaxError("adjust: nothing but points is unknown; give unknowns or errors, or use intersect")
    traced = arrays_of((sensor, block, priors, start_m, errors)) is jnp
    if traced and (blunders is not None or reweigh is not None):
        raise WhiskjaxError("adjust: Blunders() and Reweigh() search on the host, and have no meaning under jit, vmap or grad")
    refuse_extremes(sensor, "adjust")
    sensor.refuse_aligned("adjust")
    lonely = seen_once(block)
    if not traced:
        refuse_pixels_without_direction("adjust", sensor, block.shots(), block.pixel_px, block.ray_label)
        refuse_unrecorded(sensor, block)
    tell(f"adjust: {len(block)} rays of {int(block.seen.sum())} points")
    if start_m is None:
        sensor, start_m = begin(sensor, block, motions)
    start_m = plain(Arrays("adjust").take("start_m", start_m, f"{len(block.role)} 3", absolute=True))
    if not traced:
        placed = np.isfinite(np.asarray(start_m)).all(axis=1)
        unplaced = np.flatnonzero(block.seen & ~lonely & (block.role != "control") & ~placed)
        if unplaced.size:
            raise WhiskjaxError(f"{block.point_label(int(unplaced[0]))}: start_m holds no finite coordinates of it")
    prepared = prepare(sensor, block, priors, motions, start_m)
    start_u = prepared.start.u
    solved = solve(prepared, max_steps)
    if retime and sensor.is_line and (traced or int(codes_of(solved.result)) == 0):
        prepared = retimed(prepared, solved.state, priors, motions)
        solved = solve(prepared, max_steps)
    if traced:
        solved = _followed(prepared, solved)
    used, found, uncertain = ~lonely[block.point], None, None
    for _ in range(2 if blunders is not None and reweigh is not None else 1):  # each is judged by the other
        if blunders is not None and is_fine(solved):
            prepared, solved, used = data_snooping(prepared, solved, used, blunders, max_steps)
        # Rays that were made with the model itself know nothing of sigmas.
        is_exact = not traced and float(solved.reduced.cost) < NOTHING * len(block)
        if reweigh is not None and is_fine(solved) and not is_exact:
            prepared, solved, found, uncertain = weights.reweigh(prepared, solved, used, reweigh, found, max_steps)
    adjustment = answer(prepared, solved, priors.unknowns, tuple(errors), start_u, used, found, uncertain)
    if throw and not traced:
        refuse(adjustment, motions)
    return adjustment


def solve(prepared: Prepared, max_steps: int) -> Solved:
    """The minimum, found by an iteration that nothing follows where it is traced."""
    return gauss_newton(held(prepared.ready), held(prepared.start), max_steps)


def _followed(prepared: Prepared, solved: Solved) -> Solved:
    """The solution with its derivatives, and the equations there."""
    state = followed(prepared.ready, solved.state)
    return eqx.tree_at(lambda s: (s.state, s.reduced), solved, (state, reduce(prepared.ready, state, True)[0]))


def retimed(prepared: Prepared, state: State, unknowns: Knowledge, motions: StationErrors | None) -> Prepared:
    """The block with every ray at the crossing of its fitted point, to be solved again from the state.

    The crossings are held: nothing follows them.
    """
    ready = prepared.ready
    point = prepared.point_m(state)
    given, lonely = prepared.block, seen_once(prepared.block)[prepared.block.point]
    block = at_crossing(held(ready.unknowns).put(held(ready.sensor), state.x, state.u), given, point)
    if lonely.any():  # a ray whose point has no place stays as it was measured
        math = arrays_of((block, given))
        time_s = math.where(lonely, given.key("time_s"), block.key("time_s"))
        pixel_px = math.where(lonely[:, None], given.pixel_px, block.pixel_px)
        block = dataclasses.replace(block, time_s=time_s, pixel_px=pixel_px)
    again = prepare(ready.sensor, block, unknowns, motions, point, prepared.plan)
    return dataclasses.replace(again, start=State(state.x, state.u, again.start.points))
