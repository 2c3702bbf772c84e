"""The three-line camera over Songshan: a seeded simulation of Wang et al. (2018).

Wang et al. (2018), Investigation on GNSS lever arms and IMU boresight misalignment calibration of domestic airborne wide-field
three CCD camera, Acta Geodaetica et Cartographica Sinica 47(11), 1474-1486. Data set A has two pairs of crossing reciprocal
strips, data set B one pair. What the paper leaves out (view angles, noise, paths, how the detector lies) is chosen so that what
it does print is reproduced.

Local world, x east, y north, z up. Body x forward, y right, z down; camera x forward, y left, z up, in one focal plane for the
three lines; samples count to the left.
"""

import dataclasses
import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..chain.by import By
from ..chain.correction import Correction, Drift, OrientationImages, Spline
from ..chain.line_camera import LineCamera
from ..chain.lines import LineTimes
from ..chain.link import AbstractLink
from ..chain.search import ground_to_image
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.trajectory import Trajectory
from ..estimate.block.block import Block
from ..estimate.block.station_errors import at_stations
from ..estimate.errors import FrameErrors
from ..estimate.unknown import Unknown
from ..rules import WhiskjaxError
from ..rules.results import is_successful
from .flight import Flight, Image, Measurements, Points, World
from .songshan_draw import (
    ATTITUDE_CORRELATION_S,
    ATTITUDE_SIGMA_RAD,
    BORESIGHT_RAD,
    CENTRE_PX,
    DATA,
    FOCAL_PX,
    LEVER_ARM_M,
    LINE_PX,
    NOISE,
    POS_CORRELATION_S,
    POS_SIGMA_M,
    SPEED_MPS,
    STRIP_S,
    VIEW_RAD,
    DataSet,
    detector,
    fly,
    mounts,
    start_s,
    terrain_m,
    true_sensor,
)

VIEWS = tuple(VIEW_RAD)
LINE_S = 0.077 / SPEED_MPS
FIELD_M = 4_000.0  # half of the field's side
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


class Drawn(NamedTuple):
    """One simulated flight: what was measured, the sensor as recorded, the sensor that made the images, and true points.

    `truth["body"]` is where the platform was, at any time of the strips (of a "matching" scene: with its `pos_error`); the true
    points, in the order of the block, are (points, 3), world frame, metres.
    """

    block: Block
    sensor: Sensor
    truth: Sensor
    point_m: Float[np.ndarray, "points 3"]


def sensor(scene: Scene, body: Trajectory) -> Sensor:
    """The camera as the laboratory knows it behind recorded POS: no lever arm, boresight or deformation, zero corrections."""
    starts, strips = start_s(len(scene.data.strips)), scene.data.strips
    intervals = max(3, math.ceil(STRIP_S / scene.spacing_s))
    if scene.basis == "spline":  # it reaches from the second node to the last but one
        basis = Spline(starts - scene.spacing_s, scene.spacing_s, (intervals + 3,) * len(starts))
    else:
        basis = OrientationImages(starts, scene.spacing_s, (intervals + 1,) * len(starts))
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


def frame_errors(scene: Scene, white: bool = False, scale: float = 1.0) -> tuple[FrameErrors, ...]:
    """The errors of POS, anew in every strip: they wander, or are `white` at the nodes; sigmas are `scale` times the true ones.

    Vibration is left out: 0.0007 deg of 0.7 s, it passes between nodes and adds noise of 0.32 px to what is measured.
    """
    turn, shift = ((scale * sigma).tolist() for sigma in (ATTITUDE_SIGMA_RAD, POS_SIGMA_M))
    correlation = 0.0 if white else (*ATTITUDE_CORRELATION_S.tolist(), *POS_CORRELATION_S.tolist())
    return (FrameErrors("pos_error", turn, shift, correlation, anew="strip"),)


def draw(scene: Scene, seed: int) -> Drawn:
    """One flight over the field, with all of its rays.

    A point has three rays in each strip in whose swath it lies in all three views. The line is measured like the sample: its
    error of n lines moves the time of the shot by n line periods, and the line offset of the pixel is exactly zero. Nothing is
    hidden behind a mountain.

    **Arguments:** `seed`: of everything random; the same seed gives the same path, POS and points for any number of ties.
    """
    data, noise = scene.data, NOISE[scene.noise]
    ties = data.ties if scene.ties is None else scene.ties
    path, surveyed, field, tie_field, point_rays, tie_rays, roles = np.random.default_rng(seed).spawn(7)
    true, recorded = fly(path, data.strips, scene.pos_hz, noise.vibration)
    truth = true_sensor(true) if scene.truth == "rough" else _matching(scene, recorded, path)
    # More places than are needed: some lie in no strip, and few in several.
    tried = (field, 600), (tie_field, 2 * ties + 100)
    place = np.concatenate([rng.uniform(-FIELD_M, FIELD_M, (n, 2)) for rng, n in tried])
    ground = np.column_stack([place, terrain_m(*place.T)])
    sample, time, seen = _images(truth, ground, len(data.strips))

    count = seen.sum(axis=1)
    one, several = (np.flatnonzero(which[:600]) for which in (count == 1, count > 1))
    points = np.sort(np.concatenate([one[: data.points - data.several], several[: data.several]]))
    tied = 600 + np.flatnonzero(count[600:])[:ties]
    if len(points) < data.points or len(tied) < ties:
        raise WhiskjaxError(f"songshan {scene.name}, seed {seed}: too few places lie in strips; take another seed")
    role = np.where(np.isin(np.arange(data.points), roles.permutation(data.points)[: data.check]), "check", "control")

    chosen = np.concatenate([points, tied])
    shape = (len(data.strips), len(VIEWS), 2)
    drawn = (noise.point_px, point_rays, data.points), (noise.tie_px, tie_rays, ties)
    error = np.concatenate([px * rays.standard_normal((n, *shape)) for px, rays, n in drawn])
    point, strip, view = np.nonzero(np.broadcast_to(seen[chosen][..., None], error.shape[:-1]))
    error = error[point, strip, view]
    sigma = np.where(point < data.points, noise.point_px, noise.tie_px)
    known = ground[points] + surveyed.normal(0, 1, (data.points, 3)) * POINT_SIGMA_M
    names = [f"{s}-{v}" for s in data.strips for v in VIEWS]
    block = Block(
        shot=Shot(time_s=time[chosen][point, strip, view] + LINE_S * error[:, 1], view=view, strip=strip),
        pixel_px=np.column_stack([sample[chosen][point, strip, view] + error[:, 0], np.zeros(len(point))]),
        sigma_px=np.column_stack([sigma, sigma]),
        point=point,
        position_m=np.concatenate([known, np.full((ties, 3), np.nan)]),
        covariance_m2=np.broadcast_to(np.diag(POINT_SIGMA_M**2), (data.points + ties, 3, 3)),
        role=np.concatenate([role, np.full(ties, "tie")]),
        points=[f"P{i + 1}" for i in range(data.points)] + [f"T{i + 1}" for i in range(ties)],
        images=[names[i] for i in len(VIEWS) * strip + view],
        strips=list(data.strips),
    )
    return Drawn(block, sensor(scene, recorded), truth, ground[chosen])


def _matching(scene: Scene, recorded: Trajectory, rng: np.random.Generator) -> Sensor:
    """The sensor that makes the images where recorded poses err by a draw from what `frame_errors` says of the corrections."""
    laboratory = sensor(scene, recorded)
    errors = at_stations("songshan", frame_errors(scene), laboratory)
    assert errors is not None  # there is a statement
    roots = errors.roots(laboratory)
    white = rng.standard_normal(roots.shape[:2])
    drawn = errors.sigma * np.stack([np.linalg.solve(root, w) for root, w in zip(roots, white, strict=True)], axis=-1)
    correction = Correction(laboratory["pos_error"].basis, jnp.asarray(drawn[:, :3]), jnp.asarray(drawn[:, 3:]))
    lines = By("view", {view: detector(view, cubic=True) for view in VIEWS})
    return Sensor({"body": recorded, "pos_error": correction, **mounts(LEVER_ARM_M, BORESIGHT_RAD)}, lines)


def _images(truth: Sensor, ground_m: np.ndarray, strips: int) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, "points strips"]]:
    """Samples and times (points, strips, views), and whether all views of a strip see the point."""
    start = np.broadcast_to(start_s(strips)[None, :, None], (1, strips, len(VIEWS)))
    shot = Shot(view=np.arange(len(VIEWS))[None, None])
    found = ground_to_image(truth, shot, ground_m[:, None, None], (start, start + STRIP_S), throw=False)
    seen = np.logical_and.reduce(np.asarray(is_successful(found.result)), axis=-1)
    return np.asarray(found.pixel_px[..., 0]), np.asarray(found.time_s), seen


def simulate(scene: Scene = Scene(), seed: int = 0) -> Flight:
    """What `draw` draws, as a flight that can be written and read: one image for each strip and view."""
    block, recorded, _, _ = draw(scene, seed)
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
        errors=frame_errors(scene),
        world=World("local", ORIGIN),
        epoch="2017-05-23T02:00:00Z" if scene.name == "A" else "2017-05-25T02:00:00Z",
        reference_point="GNSS antenna phase centre",
        notes="Simulated after Wang et al. (2018); see whiskjax.flights.songshan.",
    )
