"""The two-step loop of Wang et al. (2018), and why it is alternating minimisation of the joint cost.

Step one adjusts the block with lever arm and boresight held (orientation images, detector lines, points). Step two holds the
exterior orientation that came out and fits lever arm and boresight to POS (equations (3) and (8)); the trajectory is then
corrected so that the exterior orientation stays (equations (9) and (10)), and step one begins again.

With y the exterior orientation at the stations (and the detector lines) and z the mounts, the rays depend on y alone and only POS
sees both. Each step minimises the one cost over its part, so the loop goes to the joint solution, with a linear rate: the largest
eigenvalue of Nyy^-1 Nyz Nzz^-1 Nzy. White POS errors make it slow; a step that is small then says nothing of the distance left.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...chain.address import put, read
from ...chain.detector import refuse_pixels_without_direction
from ...chain.extremes import refuse_extremes
from ...chain.pose import Pose
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...earth.surface import AbstractSurface, need_surface
from ...rules import WhiskjaxError, need, need_flags
from ..errors import FrameErrors
from ..unknown import Unknown, admit, assign, need_unknowns
from .adjust import retimed
from .adjustment import Adjustment
from .answer import answer, refuse
from .begin import begin
from .block import Block
from .connect import seen_once
from .crossing import refuse_unrecorded
from .prepare import Prepared, State, prepare
from .solve import Reduced, gauss_newton
from .station_errors import StationErrors, at_stations

_EARLY = 1e-2  # of a predicted sigma: the step at which an impatient loop stops


@dataclasses.dataclass(frozen=True)
class TwoStep:
    """How the loop went.

    - `mounts`: names of the numbers of step two; `values`: after each round, (rounds + 1, mounts), in the units of their fields.
    - `rate`: by which the distance to the joint solution shrinks in a round, from the equations; `observed_rate`: of the last
      steps.
    - `early`: the round at which a rule that only looks at the step would have stopped; None where it never would.
    - `has_converged`: step * rate / (1 - rate), the distance that is left, is below the tolerance.
    - `adjustment`: step one of the last round.
    """

    mounts: tuple[str, ...]
    values: Float[np.ndarray, "rounds+1 mounts"]
    rate: float
    observed_rate: float
    early: int | None
    has_converged: bool
    adjustment: Adjustment

    def rounds_needed(self, share: float) -> int:
        """Rounds after which a `share` of the first distance is left, by the rate."""
        return int(np.ceil(np.log(share) / np.log(self.rate))) if 0 < self.rate < 1 else 1


def two_step(
    sensor: Sensor,
    block: Block,
    unknowns: Sequence[Unknown],
    *,
    errors: Sequence[FrameErrors],
    mounts: Sequence[str],
    tolerance: float = 1e-6,
    retime: bool = True,
    surface: AbstractSurface | None = None,
    max_rounds: int = 100,
) -> TwoStep:
    """The paper's loop, to the end.

    **Arguments:**

    - `unknowns`: as for `adjust`; `mounts`: names of those that step two fits (lever arm, boresight, drifts).
    - `tolerance`: distance left to the joint solution, in predicted sigmas of the mounts, at which the loop ends.
    - `retime`: as for `adjust`, once, at the first solution. To compare with a joint solution give its `Adjustment.block`, and
      turn this off: then both adjust the same numbers.
    - `surface`: what is level, for errors in level axes; the ellipsoid by default.

    **Raises:** as `adjust`; `WhiskjaxError` where a name is no unknown, or POS observed nothing.
    """
    need("two_step", "sensor", sensor, Sensor)
    need("two_step", "block", block, Block)
    need_unknowns("two_step", "unknowns", unknowns)
    need_flags("two_step", retime=retime)
    if surface is not None:
        need_surface("two_step", surface)
    motions = at_stations("two_step", errors, sensor, block, surface)
    sensor.refuse_aligned("two_step")
    refuse_pixels_without_direction("two_step", sensor, block.shots(), block.pixel_px, block.ray_label)
    names = [x.name for x in unknowns]
    lost = [name for name in mounts if name not in names]
    if lost or not mounts:
        raise WhiskjaxError(f"two_step: {', '.join(lost) or 'no mount'} is not among the unknowns {', '.join(names)}")
    refuse_extremes(sensor, "two_step")
    refuse_unrecorded(sensor, block)
    if motions is None or not motions.observed:
        raise WhiskjaxError(
            "two_step: step two fits the mounts to the motions that POS observed, but "
            + ("no errors of it are given" if motions is None else f"the poses of {motions.link} are free")
        )
    second = [x for x in unknowns if x.name in mounts]
    first = [x for x in unknowns if x.name not in mounts]
    sensor, start_m = begin(admit(sensor, unknowns), block, motions)
    prepared = prepare(sensor, block, first, motions, start_m)
    start_u = np.asarray(prepared.start.u)
    state, value = prepared.start, np.array([float(read(sensor, x.places[0])) for x in second])
    mean = np.array([v if x.mean is None else x.mean for x, v in zip(second, value, strict=True)])
    prior = np.array([0.0 if x.sigma is None else 1 / x.sigma for x in second])
    if retime and sensor.is_line:
        solved = gauss_newton(prepared.ready, state)
        prepared = retimed(prepared, solved.state, first, motions)
        state = prepared.start

    values, steps, early = [value], [], None
    sigma, rate = np.ones(len(second)), 1.0
    has_converged = False
    for k in range(max_rounds):
        held = dataclasses.replace(prepared, ready=eqx.tree_at(lambda r: r.sensor, prepared.ready, assign(sensor, second, value)))
        solved = gauss_newton(held.ready, state)
        effect = _effects(held, solved.state, second, motions)
        if k == 0:
            rate, sigma = _rate(held, solved.reduced, effect, prior)
        step, state = _fit_mounts(held, solved.state, effect, prior, mean - value)
        value = value + step
        values.append(value)
        steps.append(float(np.abs(step / sigma).max()))
        if early is None and steps[-1] < _EARLY:
            early = k + 1
        if rate < 1 and steps[-1] * rate / (1 - rate) < tolerance:
            has_converged = True
            break
    last = assign(sensor, second, value)
    held = dataclasses.replace(prepared, ready=eqx.tree_at(lambda r: r.sensor, prepared.ready, last))
    solved = gauss_newton(held.ready, state)
    adjustment = answer(held, solved, first, tuple(errors), start_u, ~seen_once(block)[block.point], None)
    refuse(adjustment, motions)
    tail = steps[-4:]
    observed = (tail[-1] / tail[0]) ** (1 / (len(tail) - 1)) if len(tail) > 1 and tail[0] > 0 else float("nan")
    return TwoStep(tuple(x.name for x in second), np.array(values), rate, observed, early, has_converged, adjustment)


def _effects(
    prepared: Prepared, state: State, mounts: Sequence[Unknown], motions: StationErrors
) -> Float[np.ndarray, "mounts 6 stations"]:
    """The change of the motions, at every station, that images as one unit of each mount does; whitened by the POS sigmas."""
    sensor = prepared.ready.sensor
    link = motions.stations(sensor)
    node_s = link.node_s
    if node_s is not None:
        time = np.asarray(prepared.block.key("time_s"))
        nearest = np.array([int(np.argmin(np.abs(time - t))) for t in node_s])  # its strip, or view, is the node's
        shot = dataclasses.replace(prepared.block.shots(nearest), time_s=jnp.asarray(node_s))
    else:
        shot = Shot(image=np.arange(link.stations))
    names = list(sensor.names)
    begins = names.index(motions.link) + 1
    sigma = np.asarray(prepared.ready.unknowns.sigma)
    here = (sigma[:3, None] * np.asarray(state.x)[:3]).T
    found = []
    for x in mounts:
        reach = [names.index(place.link) if place.link in names else -1 for place in x.places]
        if min(reach) < begins:
            raise WhiskjaxError(f"two_step: {x.name} lies in no link behind {motions.link}, so no motion of it images alike")
        parts = _motion(sensor, x, names[begins : max(reach) + 1], shot)
        turn, shift = (np.stack([np.broadcast_to(np.asarray(c), (link.stations,)) for c in part], axis=-1) for part in parts)
        # Behind a motion m that is there already: exp(m) exp(turn) = exp(m + turn + m x turn / 2 + ...), and m turns the shift.
        once = np.cross(here, turn), np.cross(here, shift)
        turn = turn + once[0] / 2 + np.cross(here, once[0]) / 12
        shift = shift + once[1] + np.cross(here, once[1]) / 2
        motion = np.concatenate([turn, shift], axis=-1).T
        found.append(np.divide(motion, sigma[:, None], out=np.zeros_like(motion), where=sigma[:, None] > 0))
    return np.stack(found)


def _motion(sensor: Sensor, unknown: Unknown, links: Sequence[str], shot: Shot):
    """The small motion (turn, shift) of the frame outside of `links` by one unit of an unknown inside of them."""

    def pose(value):
        changed = put(sensor, list(unknown.places), [value] * len(unknown.places))
        whole = Pose()
        for name in links:
            whole = whole @ changed[name].pose(shot)
        array = lambda c: jnp.asarray(c, dtype=float)
        return Pose(tuple(tuple(map(array, row)) for row in whole.rotation), tuple(map(array, whole.translation)))

    value = read(sensor, unknown.places[0])
    here, moved = jax.jvp(pose, (value,), (jnp.ones_like(value),))
    # In the outer frame: [turn]x = dR R^T, shift = dt - turn x t.
    r, d = here.rotation, moved.rotation
    spin = [[sum(d[i][k] * r[j][k] for k in range(3)) for j in range(3)] for i in range(3)]
    turn = (spin[2][1], spin[0][2], spin[1][0])
    t, dt = here.translation, moved.translation
    crossed = (turn[1] * t[2] - turn[2] * t[1], turn[2] * t[0] - turn[0] * t[2], turn[0] * t[1] - turn[1] * t[0])
    return turn, tuple(a - b for a, b in zip(dt, crossed, strict=True))


def _fit_mounts(
    prepared: Prepared, state: State, effect: np.ndarray, prior: np.ndarray, to_mean: np.ndarray
) -> tuple[np.ndarray, State]:
    """Step two: the change of the mounts that leaves the least of the motions, and what is left of them."""
    roots = np.asarray(prepared.ready.roots)
    x = np.asarray(state.x)
    rows = np.einsum("aek,mak->aem", roots, effect.reshape(-1, *roots.shape[::2])).reshape(-1, len(effect))
    right = np.asarray(prepared.ready.recorded(state.x)).ravel()
    step = np.linalg.lstsq(np.concatenate([rows, np.diag(prior)]), np.concatenate([right, prior * to_mean]), rcond=None)[0]
    return step, State(jnp.asarray(x - np.einsum("mak,m->ak", effect, step)), state.u, state.points)


def _rate(
    prepared: Prepared, reduced: Reduced, effect: np.ndarray, prior: np.ndarray
) -> tuple[float, Float[np.ndarray, " mounts"]]:
    """The contraction rate, and the mounts' predicted sigmas in the joint solution."""
    roots = np.asarray(prepared.ready.roots)
    m = len(effect)
    yy = np.asarray(reduced.matrix)
    information = np.einsum("aei,aej->aij", roots, roots)
    size, effect = effect[0].size, effect.reshape(m, *roots.shape[::2])
    yz = np.zeros((len(yy), m))
    # POS sees x = y - A z, and only POS sees z.
    yz[:size] = -np.einsum("aij,maj->aim", information, effect).reshape(size, m)
    zz = np.einsum("mai,aij,naj->mn", effect, information, effect) + np.diag(prior**2)
    inner = np.linalg.solve(yy, yz)
    rate = float(np.abs(np.linalg.eigvals(np.linalg.solve(zz, yz.T @ inner))).max())
    return rate, np.sqrt(np.diag(np.linalg.inv(zz - yz.T @ inner)))
