"""The three-line camera over Songshan: a simulation of Wang et al. (2018).

Wang et al. (2018), Investigation on GNSS lever arms and IMU boresight misalignment calibration of domestic airborne wide-field
three CCD camera, Acta Geodaetica et Cartographica Sinica 47(11), 1474-1486. Data set A has two pairs of crossing reciprocal
strips, data set B one pair. What the paper leaves out (view angles, noise, paths, how the detector lies) is chosen so that what
it does print is reproduced.

Local world, x east, y north, z up. Body x forward, y right, z down; camera x forward, y left, z up, in one focal plane for the
three lines; samples count to the left.
"""

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..chain.by import By
from ..chain.correction import Correction, Drift, OrientationImages, Spline
from ..chain.image_scale import line_in_image, scale_of_each
from ..chain.line_camera import LineCamera
from ..chain.lines import LineTimes
from ..chain.link import AbstractLink
from ..chain.search import ground_to_image
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.trajectory import Trajectory
from ..estimate.block.block import Block
from ..estimate.block.station_rows import dense
from ..estimate.errors import FrameErrors, draw_errors
from ..estimate.unknown import Unknown
from ..rules import WhiskjaxError, arrays_of, plain
from ..rules.results import is_successful
from .flight import Flight, Image, Measurements, Points, World
from .songshan_draw import (
    ATTITUDE_CORRELATION_S,
    ATTITUDE_SIGMA_RAD,
    CENTRE_PX,
    DATA,
    FOCAL_PX,
    LINE_PX,
    NOISE,
    POS_CORRELATION_S,
    POS_SIGMA_M,
    SPEED_MPS,
    STRIP_S,
    TABLE_3,
    VIBRATION_RAD,
    VIBRATION_S,
    VIEW_RAD,
    WAVE_PX,
    WAVELENGTH_PX,
    DataSet,
    Path,
    Truth,
    before,
    detector,
    mounts,
    sample_s,
    start_s,
    terrain_m,
)

VIEWS = tuple(VIEW_RAD)
LINE_S = 0.077 / SPEED_MPS
FIELD_M = 4_000.0  # half of the field's side
TRIED = 600  # places of which the points are chosen
ORIGIN = (34.45, 113.05, 0.0)
POINT_SIGMA_M = np.array([0.002, 0.002, 0.010])
LEVER_SIGMA_M, BORESIGHT_SIGMA_RAD, DEFORMATION_SIGMA_PX = 1.0, math.radians(1.0), 100.0
DRIFT_SIGMA_RAD = math.radians(0.02)
# One camera cannot tell its boresight from a shift and a turn of its detector: the nadir line's a0, b0 and a1 are zero.
GAUGE = ("a0_nadir", "b0_nadir", "a1_nadir")


@dataclasses.dataclass(frozen=True)
class Scene:
    """Which flight, and how it is adjusted.

    **Arguments:**

    - `name`: data set "A" or "B".
    - `noise`: "nominal" or "paper-like".
    - `ties`: number of tie points; None is as many as the paper has. Fewer leave everything else as it is.
    - `spacing_s`, `basis`: of the corrections of POS, "orientation images" or "spline", with nodes in every strip.
    - `drift`: whether every strip has a drift of attitude of its own (Wang et al. 2018, equation 6).
    - `pos_hz`: rate of the true and of the recorded poses.
    - `truth`: "rough" as flown, or "matching": detector lines are cubics and POS errors are what the corrections can follow, so
      that the adjustment knows all there is.
    """

    name: str = "A"
    noise: str = "nominal"
    ties: int | None = None
    spacing_s: float = 4.0
    basis: str = "orientation images"
    drift: bool = False
    pos_hz: float = 200.0
    truth: str = "rough"

    def __post_init__(self):
        bases, truths = ("orientation images", "spline"), ("rough", "matching")
        for field, known in (("name", DATA), ("noise", NOISE), ("basis", bases), ("truth", truths)):
            if getattr(self, field) not in known:
                raise WhiskjaxError(f"songshan: the {field} is one of {', '.join(known)}, not {getattr(self, field)!r}")

    @property
    def data(self) -> DataSet:
        """The data set."""
        return DATA[self.name]

    @property
    def tie_points(self) -> int:
        """How many."""
        return self.data.ties if self.ties is None else self.ties


class Drawn(NamedTuple):
    """One flight over many places, all of whose rays are told whether anybody sees them or not; pixels are (sample, line).

    - `sensor`: as recorded, with the mounts and detectors of the laboratory; `truth`: that made the images.
    - `point_m`, `surveyed_m`: where the points are, and where they are said to be, (points, 3), world frame.
    - `exact_px`, `pixel_px`: where they are imaged, and where they were measured, (points, strips, views, 2); a line is one
      period of the detector since the strip began. NaN where a point is not seen.
    - `is_seen`: whether all views of a strip see the point, (points, strips).
    """

    sensor: Sensor
    truth: Sensor
    point_m: Float[Any, "points 3"]
    surveyed_m: Float[Any, "points 3"]
    exact_px: Float[Any, "points strips views 2"]
    pixel_px: Float[Any, "points strips views 2"]
    is_seen: Bool[Any, "points strips"]


class Simulated(NamedTuple):
    """One simulated block: what was measured, the sensor as recorded, the sensor that made the images, and true points.

    `truth["body"]` is where the platform was, at any time of the strips (of a "matching" scene: with its `pos_error`); the true
    points, in the order of the block, are (points, 3), world frame, metres.
    """

    block: Block
    sensor: Sensor
    truth: Sensor
    point_m: Float[np.ndarray, "points 3"]


def corrections(scene: Scene) -> Spline | OrientationImages:
    """The nodes of the corrections of POS."""
    starts, intervals = start_s(len(scene.data.strips)), max(3, math.ceil(STRIP_S / scene.spacing_s))
    if scene.basis == "spline":  # it reaches from the second node to the last but one
        return Spline(starts - scene.spacing_s, scene.spacing_s, (intervals + 3,) * len(starts))
    return OrientationImages(starts, scene.spacing_s, (intervals + 1,) * len(starts))


def sensor(scene: Scene, body: Trajectory) -> Sensor:
    """The camera as the laboratory knows it behind recorded POS: no lever arm, boresight or deformation, zero corrections."""
    starts, strips = start_s(len(scene.data.strips)), scene.data.strips
    basis = corrections(scene)
    zero = jnp.zeros((basis.size, 3))
    links: dict[str, AbstractLink] = {"body": body, "pos_error": Correction(basis, zero, zero)}
    if scene.drift:
        # From the middle of a strip, half a strip on: value and rate are then hardly correlated.
        middle = zip(strips, starts + STRIP_S / 2, strict=True)
        links["drift"] = By("strip", {name: Correction(Drift(t, STRIP_S / 2), jnp.zeros((2, 3))) for name, t in middle})
    links |= mounts(np.zeros(3), np.zeros(3))
    laboratory = {
        view: LineCamera(
            focal_px=FOCAL_PX,
            principal_sample_px=CENTRE_PX,
            offset_px=FOCAL_PX * np.tan(angle),
            half_width_px=CENTRE_PX,
            samples_px=(0.0, LINE_PX - 1.0),
            along="y",
            wavelength_px=WAVELENGTH_PX,
        )
        for view, angle in VIEW_RAD.items()
    }
    return Sensor(links, By("view", laboratory))


def unknowns(scene: Scene) -> tuple[Unknown, ...]:
    """Lever arm, boresight and deformation of the three lines with loose priors, and drifts where the scene has them.

    a0 to a3 move a line across itself (dx), b0 to b3 along itself (dy), as cubics in s from -1 to 1. The `GAUGE` is left out.
    """
    found = [Unknown(name, f"lever.lever_arm_m[{i}]", 0.0, LEVER_SIGMA_M) for i, name in enumerate("uvw")]
    found += [Unknown(f"e{x}", f"boresight.angles_rad[{i}]", 0.0, BORESIGHT_SIGMA_RAD) for i, x in enumerate("xyz")]
    for view in VIEWS:
        for letter, row in (("a", 1), ("b", 0)):
            for power in range(4):
                place = f"camera.{view}.deformation_px[{row},{power}]"
                found.append(Unknown(f"{letter}{power}_{view}", place, 0.0, DEFORMATION_SIGMA_PX))
    if scene.drift:
        for strip in scene.data.strips:
            for row, kind in enumerate("ab"):
                for i, x in enumerate(("roll", "pitch", "yaw")):
                    place = f"drift.{strip}.turn_rad[{row},{i}]"
                    found.append(Unknown(f"drift_{kind}_{x}_{strip}", place, 0.0, DRIFT_SIGMA_RAD))
    return tuple(unknown for unknown in found if unknown.name not in GAUGE)


def wave_unknowns() -> tuple[Unknown, ...]:
    """The wave of each line, which the paper's model lacks, as errors of the camera that all rays of a sample share.

    Known beforehand is its length, and that it is as large as 0.25 px: sine (s) and cosine (c) across the line and along it.
    """
    return tuple(
        Unknown(f"wave_{letter}{phase}_{view}", f"camera.{view}.wave_px[{row},{i}]", 0.0, WAVE_PX)
        for view in VIEWS
        for letter, row in (("a", 1), ("b", 0))
        for i, phase in enumerate("sc")
    )


def frame_errors(scene: Scene, white: bool = False, scale: float = 1.0) -> tuple[FrameErrors, ...]:
    """The errors of POS, anew in every strip: they wander, or are `white` at the nodes; sigmas are `scale` times the true ones.

    Vibration is left out: 0.0007 deg of 0.7 s, it passes between nodes and adds noise of 0.32 px to what is measured.
    """
    turn, shift = ((scale * sigma).tolist() for sigma in (ATTITUDE_SIGMA_RAD, POS_SIGMA_M))
    correlation = 0.0 if white else (*ATTITUDE_CORRELATION_S.tolist(), *POS_CORRELATION_S.tolist())
    return (FrameErrors("pos_error", turn, shift, correlation, anew="strip"),)


def all_errors(scene: Scene) -> tuple[FrameErrors, ...]:
    """All that recorded poses err by: where they are "rough", vibration that POS does not see beside the errors of POS."""
    if scene.truth == "matching":
        return frame_errors(scene)
    vibration = (NOISE[scene.noise].vibration * VIBRATION_RAD,) * 3
    return *frame_errors(scene), FrameErrors("pos_error", vibration, correlation_s=VIBRATION_S, anew="strip")


def draw_truth(key: Array) -> Truth:
    """Lever arm and boresight drawn from their priors. Traceable."""
    white = plain(jax.random.normal(key, (2, 3), float))
    return Truth(LEVER_SIGMA_M * white[0], BORESIGHT_SIGMA_RAD * white[1])


def draw(
    key: Array,
    scene: Scene = Scene(),
    path: Path | None = None,
    truth: Truth = TABLE_3,
    point_m: Float[Array, "points 3"] | None = None,
) -> Drawn:
    """One flight over the field with all of its rays, a pure function for `jit`, `vmap` and derivatives.

    The record is the path; where the platform was, `all_errors` tell: recorded = true @ motion. The line is measured like the
    sample. Nothing is hidden behind a mountain.

    **Arguments:**

    - `key`: of `jax.random`, of everything random; path and POS errors, and each point and its rays are the same however many
      points there are.
    - `path`: drawn by default.
    - `point_m`: where the points are; drawn by default, more than are needed, since some lie in no strip, and few in several.
      The first 600 are measured as points, the others as ties.
    """
    of_path, of_pos, of_points = jax.random.split(key, 3)
    strips, noise = len(scene.data.strips), NOISE[scene.noise]
    recorded = (Path.draw(of_path) if path is None else path).recorded(scene.data.strips, scene.pos_hz)
    exact = _true_sensor(scene, recorded, truth, of_pos)
    point: Any = point_m
    count = TRIED + 2 * scene.tie_points + 100 if point is None else len(point)
    white = plain(_each(of_points, count, 5 + 2 * strips * len(VIEWS)))
    if point is None:
        place = FIELD_M * (2 * plain(jax.scipy.special.ndtr(white[:, :2])) - 1).T  # even over the field
        point = arrays_of(place).stack([*place, terrain_m(*place)], axis=-1)
    start = np.broadcast_to(start_s(strips)[None, :, None], (1, strips, len(VIEWS)))
    shot = Shot(view=np.arange(len(VIEWS))[None, None])
    found = ground_to_image(exact, shot, point[:, None, None], (start, start + STRIP_S), throw=False)
    line = (plain(found.time_s) - start) / LINE_S
    exact_px = arrays_of(line).stack([plain(found.pixel_px)[..., 0], line], axis=-1)
    sigma_px = np.where(np.arange(count) < TRIED, noise.point_px, noise.tie_px)[:, None, None, None]
    return Drawn(
        sensor(scene, recorded),
        exact,
        point,
        point + white[:, 2:5] @ np.diag(POINT_SIGMA_M),
        exact_px,
        exact_px + sigma_px * white[:, 5:].reshape(*line.shape, 2),
        plain(is_successful(found.result)).all(axis=-1),
    )


@functools.partial(jax.jit, static_argnums=(1, 2))
def _each(key: Array, count: int, size: int) -> Array:
    """So many normal numbers for each of so many, (count, size): the first ones are the same for any count."""
    return jax.vmap(lambda i: jax.random.normal(jax.random.fold_in(key, i), (size,), float))(jnp.arange(count))


def _true_sensor(scene: Scene, recorded: Trajectory, truth: Truth, key: Array) -> Sensor:
    """The sensor that makes the images: POS errs by a draw at its samples, if "matching" by one that corrections follow."""
    strips, links = len(scene.data.strips), mounts(truth.lever_arm_m, truth.boresight_rad)
    lines = By("view", {view: detector(view, cubic=scene.truth == "matching") for view in VIEWS})
    if scene.truth == "rough":
        time = sample_s(strips, scene.pos_hz)
        shot = Shot(time_s=time.ravel(), strip=np.repeat(np.arange(strips), time.shape[1]))
        motion = draw_errors(all_errors(scene), key, shot)["pos_error"]
        return Sensor({"body": before(motion, recorded, time.ravel()), **links}, lines)
    with jax.ensure_compile_time_eval():
        basis = corrections(scene)
        shot, rows = Shot(time_s=basis.epoch_s, strip=np.repeat(np.arange(strips), basis.nodes)), dense(basis)
    motion = draw_errors(all_errors(scene), key, shot)["pos_error"]
    xp = arrays_of(motion)
    turn, shift = (xp.linalg.solve(rows, -xp.stack(part, axis=-1)) for part in (motion.turn, motion.shift))
    return Sensor({"body": recorded, "pos_error": Correction(basis, turn, shift), **links}, lines)


def simulate_block(scene: Scene, seed: int, truth: Truth = TABLE_3) -> Simulated:
    """What `draw` draws by the key of a seed, as a block: points and ties in the numbers of the paper.

    A point has three rays in each strip in whose swath it lies in all three views. The error of a line moves the time of the
    shot, and the line offset of the pixel is exactly zero. Measured to so many lines, a ray is known to as many times the local
    rate in pixels across the line: 0.9 px to a line over the plain, 2 px over the mountain.

    **Arguments:** the same seed gives the same path, POS and points for any number of ties.

    **Raises:** `WhiskjaxError` where too few places lie in strips.
    """
    data, noise, ties = scene.data, NOISE[scene.noise], scene.tie_points
    drawn = draw(jax.random.key(seed), scene, truth=truth)
    count = np.asarray(drawn.is_seen).sum(axis=1)
    one, several = (np.flatnonzero(which[:TRIED]) for which in (count == 1, count > 1))
    points = np.sort(np.concatenate([one[: data.points - data.several], several[: data.several]]))
    tied = TRIED + np.flatnonzero(count[TRIED:])[:ties]
    if len(points) < data.points or len(tied) < ties:
        raise WhiskjaxError(f"songshan {scene.name}, seed {seed}: too few places lie in strips; take another seed")
    # Check points evenly among places that are in no order.
    role = np.where(np.diff(np.arange(data.points + 1) * data.check // data.points) > 0, "check", "control")

    chosen = np.concatenate([points, tied])
    point, strip, view = np.nonzero(np.broadcast_to(drawn.is_seen[chosen][..., None], drawn.pixel_px[chosen].shape[:-1]))
    sample, line = drawn.pixel_px[chosen][point, strip, view].T
    sigma = np.where(point < data.points, noise.point_px, noise.tie_px)
    shot = Shot(time_s=start_s(len(data.strips))[strip] + LINE_S * line, view=view, strip=strip)
    (_, px_per_line), _ = line_in_image(scale_of_each(drawn.sensor, shot, drawn.point_m[chosen][point]), LINE_S)
    names = [f"{s}-{v}" for s in data.strips for v in VIEWS]
    block = Block(
        shot=shot,
        pixel_px=np.column_stack([sample, np.zeros(len(point))]),
        sigma_px=np.column_stack([sigma, sigma * np.abs(px_per_line)]),
        point=point,
        position_m=np.concatenate([drawn.surveyed_m[points], np.full((ties, 3), np.nan)]),
        covariance_m2=np.broadcast_to(np.diag(POINT_SIGMA_M**2), (data.points + ties, 3, 3)),
        role=np.concatenate([role, np.full(ties, "tie")]),
        points=[f"P{i + 1}" for i in range(data.points)] + [f"T{i + 1}" for i in range(ties)],
        images=[names[i] for i in len(VIEWS) * strip + view],
        strips=list(data.strips),
    )
    return Simulated(block, drawn.sensor, drawn.truth, drawn.point_m[chosen])


def simulate(scene: Scene = Scene(), seed: int = 0, truth: Truth = TABLE_3) -> Flight:
    """`simulate_block` as a flight that can be written and read: one image for each strip and view."""
    block, recorded, _, _ = simulate_block(scene, seed, truth)
    time, strip, view = (np.asarray(block.key(name)) for name in ("time_s", "strip", "view"))
    starts = start_s(len(scene.data.strips))
    images = [
        Image(
            f"{name}-{v}",
            lines=LineTimes(np.array([0.0, STRIP_S / LINE_S]), start + np.array([0.0, STRIP_S]), f"{name}-{v}"),
            view=v,
            strip=name,
        )
        for name, start in zip(scene.data.strips, starts, strict=True)
        for v in VIEWS
    ]
    return Flight(
        name=f"songshan {scene.name}, {scene.noise}, seed {seed}",
        sensor=recorded,
        images=images,
        points=Points(
            block.points, block.position_m, np.broadcast_to(POINT_SIGMA_M, block.position_m.shape), block.role.tolist()
        ),
        measurements=Measurements(
            image=len(VIEWS) * strip + view,
            point=block.point,
            line_px=(time - starts[strip]) / LINE_S,
            sample_px=block.pixel_px[:, 0],
            sigma_line_px=block.sigma_px[:, 1],
            sigma_sample_px=block.sigma_px[:, 0],
        ),
        unknowns=unknowns(scene),
        errors=all_errors(scene),
        world=World("local", ORIGIN),
        epoch="2017-05-23T02:00:00Z" if scene.name == "A" else "2017-05-25T02:00:00Z",
        reference_point="GNSS antenna phase centre",
        notes="Simulated after Wang et al. (2018); see whiskjax.flights.songshan.",
    )
