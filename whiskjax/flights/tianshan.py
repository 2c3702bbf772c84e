"""Target location over the Tianshan: simulations of Liu et al. (2019).

Liu et al. (2019), Target location based on stereo imaging of airborne electro-optical camera, Acta Optica Sinica 39(11), 1112003.
A gimballed camera looks at one target many times; every look has recorded navigation and gimbal angles with errors of their own.
What the paper leaves out (focal length, path, spacing of looks) is chosen so that what it does print is reproduced.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..chain.camera import FrameCamera
from ..chain.mounts import Axes
from ..chain.pose import Motion
from ..chain.records import Records
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.trajectory import Trajectory
from ..chain.turn import Encoder, Readings, Turn
from ..earth.ellipsoid import ECCENTRICITY2, SEMI_MAJOR_M, geodetic_to_ecef
from ..estimate.errors import AXES, FrameErrors, draw_errors
from ..rules import WhiskjaxError, arrays_of, plain
from .flight import Flight, Image, Measurements, Points

FOCAL_PX = 1e5  # 10 urad a pixel
SPACING_M, SPACING_S = 500.0, 3.0
LEG_M = 20_000.0
_GAP = 1.2  # a longer interval between records than this many usual ones is a gap
AZIMUTH_RAD = np.radians(-44.0)  # of the first line of sight; on a straight path of that at broadside
PIXEL_SIGMA_PX = 2.0
_OFF_NADIR_RAD = np.radians(45.0)


class Place(NamedTuple):
    """A geodetic position, WGS-84: degrees and ellipsoidal metres."""

    lat_deg: float
    lon_deg: float
    height_m: float


TARGET = Place(43.3, 84.2, 1551.0)
FIRST_GUESS = Place(43.303653, 84.195190, 1000.0)  # printed in section 3.1
FLIGHT_TARGET = Place(26.217705, 105.889600, 1367.31)  # T1 of Table 2
GUESS_SIGMA_DEG_DEG_M = (0.015, 0.015, 1500.0)  # equation 19: latitude, longitude, height


class Errors(NamedTuple):
    """1-sigma of what is recorded: metres north, east, down; radians; pixels."""

    position_m: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    gimbal_roll_rad: float
    gimbal_pitch_rad: float
    pixel_px: float

    def scaled(self, factor: float) -> "Errors":
        """All of them, times a factor."""
        north, east, down = self.position_m
        return Errors((factor * north, factor * east, factor * down), *(factor * s for s in self[1:]))


_YAW_RAD, _ROLL_PITCH_RAD, _GIMBAL_RAD = np.radians([0.08, 0.03, 0.01]).tolist()
TABLE_1 = Errors((10.0, 10.0, 20.0), _YAW_RAD, _ROLL_PITCH_RAD, _ROLL_PITCH_RAD, _GIMBAL_RAD, _GIMBAL_RAD, PIXEL_SIGMA_PX)


@dataclasses.dataclass(frozen=True)
class Scene:
    """Who looks at what, from where.

    **Arguments:**

    - `path`: "orbit" at constant off-nadir angle, "race" along a 20 km leg that is flown to and fro with the target always on the
      right, "fly" straight and centred on broadside.
    - `off_nadir_rad`: at the platform; on straight paths at broadside.
    - `height_m`: of the platform, ellipsoidal.

    Angle and height may be traced, and the spacing, but of a race: so many looks make a leg.
    """

    path: str = "orbit"
    looks: int = 40
    off_nadir_rad: Any = _OFF_NADIR_RAD
    height_m: Any = 10_000.0
    target: Place = TARGET
    spacing_m: Any = SPACING_M


STANDARD = Scene()


class Recorded(eqx.Module):
    """Navigation and gimbal angles of looks, any batch shape; radians, ellipsoidal metres."""

    lat_rad: Float[Array, "..."]
    lon_rad: Float[Array, "..."]
    height_m: Float[Array, "..."]
    roll_rad: Float[Array, "..."]
    pitch_rad: Float[Array, "..."]
    heading_rad: Float[Array, "..."]
    gimbal_roll_rad: Float[Array, "..."]
    gimbal_pitch_rad: Float[Array, "..."]


def sensor(recorded: Recorded) -> Sensor:
    """The camera in its two-axis gimbal: u = Ry(alpha) Rx(beta) body_from_ned ned_from_ecef (x - platform), looking along z."""
    r = recorded
    return Sensor(
        {
            "body": Records(r.lat_rad, r.lon_rad, r.height_m, r.roll_rad, r.pitch_rad, r.heading_rad),
            "gimbal_roll": Turn("x", Readings(r.gimbal_roll_rad)),
            "gimbal_pitch": Turn("y", Readings(r.gimbal_pitch_rad)),
            "view": Axes("x -y -z"),
        },
        FrameCamera(FOCAL_PX, (0.0, 0.0)),
    )


def frame_errors(errors: Errors = TABLE_1, correlation_s: float = 0.0) -> tuple[FrameErrors, ...]:
    """The errors of the records, new at every look, or constant where `correlation_s` is infinite; the platform is level, so yaw
    turns about the body's z axis."""
    return (
        FrameErrors("body", (errors.roll_rad, errors.pitch_rad, errors.yaw_rad), errors.position_m, correlation_s),
        FrameErrors("gimbal_roll", (errors.gimbal_roll_rad, 0, 0), correlation_s=correlation_s),
        FrameErrors("gimbal_pitch", (0, errors.gimbal_pitch_rad, 0), correlation_s=correlation_s),
    )


def time_s(scene: Scene) -> Float[np.ndarray, " looks"]:
    """When the looks were made."""
    return SPACING_S * np.arange(scene.looks)


def curvature_radii(lat_rad: Any) -> tuple[Any, Any]:
    """Meridian and prime-vertical radius of curvature in metres."""
    xp = arrays_of(lat_rad)
    root = xp.sqrt(1 - ECCENTRICITY2 * xp.sin(lat_rad) ** 2)
    return SEMI_MAJOR_M * (1 - ECCENTRICITY2) / root**3, SEMI_MAJOR_M / root


def _way(scene: Scene) -> tuple[Any, Any, Any]:
    """Platform on a sphere around the target: north and east of it along the ground in radians of arc, and heading."""
    xp = arrays_of((scene.off_nadir_rad, scene.height_m, scene.spacing_m))
    radius = np.sqrt(np.prod(curvature_radii(np.radians(scene.target.lat_deg))))
    platform, target = radius + scene.height_m, radius + scene.target.height_m
    away = xp.arcsin(platform / target * xp.sin(scene.off_nadir_rad)) - scene.off_nadir_rad
    step = scene.spacing_m / platform
    k = np.arange(scene.looks, dtype=float)
    if scene.path == "orbit":
        sight = AZIMUTH_RAD + k * step / xp.sin(away)  # clockwise around the target, which stays on the right
        return -away * xp.cos(sight), -away * xp.sin(sight), sight - np.pi / 2
    along = step * (k - (scene.looks - 1) / 2)
    if scene.path == "race":
        leg = round(LEG_M / float(scene.spacing_m))  # looks
        along = step * (leg / 2 - np.abs(k % (2 * leg) - leg))
    course = AZIMUTH_RAD - np.pi / 2
    north = -away * np.cos(AZIMUTH_RAD) + along * np.cos(course)
    east = -away * np.sin(AZIMUTH_RAD) + along * np.sin(course)
    return north, east, np.full(scene.looks, course)


def true_records(scene: Scene) -> Recorded:
    """What error-free instruments would record: level platform, gimbal on the target; each (looks,)."""
    lat_t, lon_t = np.radians(scene.target.lat_deg), np.radians(scene.target.lon_deg)
    north, east, heading = _way(scene)
    xp = arrays_of((north, east))
    arc, bearing = xp.sqrt(north**2 + east**2), xp.arctan2(east, north)
    lat = xp.arcsin(np.sin(lat_t) * xp.cos(arc) + np.cos(lat_t) * xp.sin(arc) * xp.cos(bearing))
    lon = lon_t + xp.arctan2(xp.sin(bearing) * xp.sin(arc) * np.cos(lat_t), xp.cos(arc) - np.sin(lat_t) * xp.sin(lat))
    target, platform = _ecef(lat_t, lon_t, scene.target.height_m), _ecef(lat, lon, scene.height_m)
    sight = [t - p for t, p in zip(target, platform, strict=True)]
    s, c, sl, cl = xp.sin(lat), xp.cos(lat), xp.sin(lon), xp.cos(lon)
    outward = cl * sight[0] + sl * sight[1]
    n, e, d = c * sight[2] - s * outward, cl * sight[1] - sl * sight[0], -c * outward - s * sight[2]
    sh, ch = xp.sin(heading), xp.cos(heading)
    x, y = ch * n + sh * e, ch * e - sh * n
    zero, gimbal = np.zeros(scene.looks), (xp.arctan2(-y, d), xp.arctan2(x, xp.sqrt(y**2 + d**2)))
    return Recorded(*map(jnp.asarray, (lat, lon, scene.height_m + zero, zero, zero, heading, *gimbal)))


def _ecef(lat_rad: Any, lon_rad: Any, height_m: Any) -> tuple[Any, Any, Any]:
    xp, normal = arrays_of((lat_rad, lon_rad)), curvature_radii(lat_rad)[1]
    r = (normal + height_m) * xp.cos(lat_rad)
    return r * xp.cos(lon_rad), r * xp.sin(lon_rad), (normal * (1 - ECCENTRICITY2) + height_m) * xp.sin(lat_rad)


def draw(
    key: Array, scene: Scene = STANDARD, errors: Sequence[FrameErrors] = frame_errors(), sigma_px: Any = PIXEL_SIGMA_PX
) -> tuple[Recorded, Float[Any, "looks 2"]]:
    """Records and pixels of one run, a pure function for `jit`, `vmap` and derivatives.

    Recorded = true @ error, measured = imaged by the truth + noise. The truth keeps the target in the principal point, so the
    pixel is its noise alone.

    **Arguments:** `key`: of `jax.random`; `errors`: of the frames body, gimbal_roll and gimbal_pitch; `sigma_px`: of the pixels.

    **Returns:** the records, each (looks,), and the pixels.
    """
    return _draw(key, true_records(scene), time_s(scene), tuple(errors), sigma_px)


def draw_runs(
    scene: Scene, runs: int, seed: int, errors: Sequence[FrameErrors] = frame_errors(), sigma_px: Any = PIXEL_SIGMA_PX
) -> tuple[Recorded, Float[Any, "runs looks 2"]]:
    """`draw` for as many keys, split from the seed: records (runs, looks) and pixels (runs, looks, 2)."""
    keys = jax.random.split(jax.random.key(seed), runs)
    return _draw_each(keys, true_records(scene), time_s(scene), tuple(errors), jnp.asarray(sigma_px, dtype=float))


def _draw(
    key: Array, true: Recorded, stamp_s: Any, errors: tuple[FrameErrors, ...], sigma_px: Any
) -> tuple[Recorded, Float[Any, "looks 2"]]:
    for one in errors:
        read = {"body": range(6), "gimbal_roll": (0,), "gimbal_pitch": (1,)}.get(one.frame, ())
        if not set(one.acting) <= set(read):
            raise WhiskjaxError(f"tianshan: of {one.frame} no record holds {', '.join(AXES[k] for k in one.acting)}")
    of_frames, of_pixels = jax.random.split(key)
    motion = draw_errors(errors, of_frames, Shot(time_s=stamp_s))
    body, roll, pitch = (motion.get(frame, Motion()) for frame in ("body", "gimbal_roll", "gimbal_pitch"))
    (x, y, down), t = body.shift, jax.tree.map(plain, true)
    xp = arrays_of((t, motion))
    s, c = xp.sin(t.heading_rad), xp.cos(t.heading_rad)
    meridian, prime_vertical = curvature_radii(t.lat_rad)
    recorded = Recorded(
        t.lat_rad + (c * x - s * y) / (meridian + t.height_m),
        t.lon_rad + (s * x + c * y) / ((prime_vertical + t.height_m) * xp.cos(t.lat_rad)),
        t.height_m - down,
        t.roll_rad + body.turn[0],
        t.pitch_rad + body.turn[1],
        t.heading_rad + body.turn[2],
        t.gimbal_roll_rad + roll.turn[0],
        t.gimbal_pitch_rad + pitch.turn[1],
    )
    white = plain(jax.random.normal(of_pixels, (6, len(stamp_s)), float))  # of the shape that errors compiled
    return recorded, sigma_px * white[:2].T


_draw_each = eqx.filter_jit(eqx.filter_vmap(_draw, in_axes=(0, None, None, None, None)))


def in_time(recorded: Recorded, stamp_s: Float[np.ndarray, " looks"], late_s: float = 0.0) -> Sensor:
    """The same camera with its records in time, to be interpolated; POS is stamped `late_s` later than the gimbal."""
    r = jax.tree.map(np.asarray, recorded)
    gap = float(np.diff(stamp_s).max()) * _GAP
    body = Trajectory.from_geodetic(
        stamp_s + late_s,
        r.lat_rad,
        r.lon_rad,
        r.height_m,
        r.roll_rad,
        r.pitch_rad,
        np.mod(r.heading_rad, 2 * np.pi),
        max_gap_s=gap,
    )
    turns = {
        name: Turn(axis, Encoder(stamp_s, angle, gap, name))
        for name, axis, angle in (("gimbal_roll", "x", r.gimbal_roll_rad), ("gimbal_pitch", "y", r.gimbal_pitch_rad))
    }
    return Sensor({"body": body, **turns, "view": Axes("x -y -z")}, FrameCamera(FOCAL_PX, (0.0, 0.0)))


def simulate(seed: int, scene: Scene = STANDARD) -> Flight:
    """One run of looks with the errors of Table 1, as a flight that can be written and read.

    **Arguments:** `seed`: of the key of `draw`; `scene`: at least two looks.

    **Returns:** a frame image for each look, and the check point "target", which all of them saw. Records and readings are
    samples at the times of the looks; how they err the flight says.
    """
    recorded, pixel = draw(jax.random.key(seed), scene)
    time = time_s(scene)
    lat_deg, lon_deg, height_m = scene.target
    position = np.asarray(geodetic_to_ecef(np.radians(lat_deg), np.radians(lon_deg), height_m))
    sigma, looks = np.full(scene.looks, PIXEL_SIGMA_PX), np.arange(scene.looks)
    return Flight(
        name=f"tianshan, {scene.path} of {scene.looks} looks, seed {seed}",
        sensor=in_time(recorded, time),
        images=[Image(f"look-{i + 1}", time_s=t) for i, t in enumerate(time.tolist())],
        points=Points(["target"], position[None], np.zeros((1, 3)), ["check"]),
        measurements=Measurements(looks, 0 * looks, pixel[:, 1], pixel[:, 0], sigma, sigma),
        errors=frame_errors(),
        reference_point="camera",
        notes="Simulated after Liu et al. (2019): one target, seen by a gimballed camera from an aircraft.",
    )
