"""The whiskbroom scanner with left and right swings over Haian: a simulation of Jin et al. (2024).

Jin et al. (2024), Geometric external calibration method for the airborne large-view-field infrared scanner considering different
effects of left and right pendulum directions, National Remote Sensing Bulletin 28(9), 2372-2382. What the paper leaves out (focal
length, geometry, noise) is chosen so that what it does print is reproduced.
"""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..chain.by import By
from ..chain.imaging import image_to_ground
from ..chain.line_camera import LineCamera
from ..chain.lines import LineTimes
from ..chain.link import AbstractLink
from ..chain.mounts import Axes, Mount
from ..chain.samples import ecef_from_ned_matrices
from ..chain.search import ground_to_image
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.trajectory import Trajectory
from ..chain.turn import Encoder, Turn
from ..earth.ellipsoid import ECCENTRICITY2, SEMI_MAJOR_M
from ..earth.surface import HeightSurface
from ..estimate.errors import FrameErrors, draw_errors
from ..estimate.observations import Observations
from ..estimate.unknown import Unknown
from ..rules import arrays_of, plain
from .flight import Flight, Image, Measurements, Points

FOCAL_PX = 10750.0
LAT_RAD, LON_RAD = np.radians(32.5), np.radians(120.5)
GROUND_M, GROUND_SPREAD_M, ABOVE_GROUND_M = 10.0, 2.0, 3000.0
SPEED_MPS, HEADING_RAD, PITCH_RAD = 70.0, np.radians(30.0), np.radians(0.5)
SWING_RAD, SWING_S, MARGIN_S, POS_HZ = np.radians(50.0), 3.0, 0.1, 200.0
HALF_LINE_PX = 1000.0
MAX_GAP_S = 0.02
LINES_HZ = FOCAL_PX * 2 * SWING_RAD / SWING_S  # one line a pixel

# Start (s), number of points, how many of them are check points, noise of x and y (px).
SCENES = {
    "L1": (0.0, 75, 10, 3.05, 2.20),
    "R1": (3.5, 75, 10, 1.50, 2.15),
    "L2": (60.0, 16, 16, 1.95, 2.10),
    "R2": (63.5, 22, 22, 1.95, 0.95),
    "L3": (900.0, 21, 21, 2.00, 1.25),
    "R3": (903.5, 22, 22, 2.00, 2.05),
}
# Drift of omega_pos, phi_pos, kappa_pos since the first pair.
DRIFT_RAD = {"L3": np.radians([0.0037, -0.0085, -0.012]), "R3": np.radians([0.0008, -0.0105, -0.062])}

POS_BIAS_M, POS_BIAS_RAD = 0.05, np.radians([0.0015, 0.0015, 0.003])
POS_JITTER_RAD = np.radians([0.002, 0.002, 0.003])
POINT_SIGMA_M = np.array([0.03, 0.03, 0.05])


class Truth(NamedTuple):
    """The calibration parameters, metres and radians: Jin et al. (2024), Table 4 by default."""

    gps_arm_m: np.ndarray
    left_rad: np.ndarray
    right_rad: np.ndarray
    sensor_arm_m: np.ndarray
    sensor_rad: np.ndarray


TABLE_4 = Truth(
    np.array([-0.0781331, 0.2358455, 0.9108226]),
    np.radians([2.7263512, 0.0023865, -0.1098404]),
    np.radians([2.6763542, -0.0052515, -0.0681410]),
    np.array([-0.0664281, -0.1090689, -2.0103571]),
    np.radians([0.0277391, -0.4715333, -0.0442568]),
)
PRIOR_SIGMA = Truth(
    np.array([0.2, 0.2, 1.0]),
    np.radians([5.0, 0.02, 0.5]),
    np.radians([5.0, 0.02, 0.5]),
    np.array([0.2, 0.2, 2.0]),
    np.radians([0.03, 5.0, 0.1]),
)
_ZERO = Truth(*(np.zeros(3) for _ in range(5)))
_NAMES = (
    ("u_gps", "v_gps", "w_gps"),
    ("omega_pos_left", "phi_pos_left", "kappa_pos_left"),
    ("omega_pos_right", "phi_pos_right", "kappa_pos_right"),
    ("u_sen", "v_sen", "w_sen"),
    ("omega_sen", "phi_sen", "kappa_sen"),
)
_PLACES = (
    "gps_arm.lever_arm_m",
    "platform.left.angles_rad",
    "platform.right.angles_rad",
    "sensor.lever_arm_m",
    "sensor.angles_rad",
)


def unknowns(mean: Truth = _ZERO, sigma: Truth = PRIOR_SIGMA) -> tuple[Unknown, ...]:
    """The 15 unknowns with the scenario's priors: u_gps and the camera mount are shared by both swings, R_pos is not."""
    return tuple(
        Unknown(name, f"{place}[{i}]", float(m[i]), float(s[i]))
        for names, place, m, s in zip(_NAMES, _PLACES, mean, sigma, strict=True)
        for i, name in enumerate(names)
    )


def sensor(
    body: AbstractLink,
    scan: Encoder,
    pitch: Encoder,
    values: Truth = _ZERO,
    platform: AbstractLink | None = None,
    scan_first: bool = True,
) -> Sensor:
    """The whiskbroom scanner: Jin et al. (2024), equation 5, with R_scan = Rx(scan) Ry(pitch), Ry Rx where `scan_first` is off.

    Body there is x forward, y left, z up; image y = s * camera y with s = +1 on the left and -1 on the right swing.
    """
    turns = {"scan": Turn("x", scan), "pitch": Turn("y", pitch)}
    if not scan_first:
        turns = dict(reversed(turns.items()))
    cameras = {
        swing: LineCamera(FOCAL_PX, across_sign=sign, samples_px=(-HALF_LINE_PX, HALF_LINE_PX))
        for swing, sign in (("left", 1.0), ("right", -1.0))
    }
    by_swing = By("swing", {"left": Mount(angles_rad=values.left_rad), "right": Mount(angles_rad=values.right_rad)})
    links: dict[str, AbstractLink] = {
        "body": body,
        "flu": Axes("x -y -z"),
        "gps_arm": Mount(lever_arm_m=values.gps_arm_m),
        "platform": by_swing if platform is None else platform,
        **turns,
        "sensor": Mount(lever_arm_m=values.sensor_arm_m, angles_rad=values.sensor_rad),
    }
    return Sensor(links, By("swing", cameras))


def frame_errors() -> tuple[FrameErrors, ...]:
    """How POS errs: a bias for each pair of images, and attitude jitter that is new at every exposure."""
    bias = FrameErrors("body", POS_BIAS_RAD.tolist(), (POS_BIAS_M,) * 3, correlation_s=np.inf, anew="strip")
    return bias, FrameErrors("body", POS_JITTER_RAD.tolist())


def draw_truth(key: Array, mean: Truth = _ZERO, sigma: Truth = PRIOR_SIGMA) -> Truth:
    """Calibration parameters drawn from their priors. Traceable."""
    white = plain(jax.random.normal(key, (len(sigma), 3), float))
    return Truth(*(m + s * w for m, s, w in zip(mean, sigma, white, strict=True)))


class Path(eqx.Module):
    """The flown path and the scan, as smooth functions of time. Every number may be traced.

    - `period_s`, `phase_rad`, `wave_rad`: of the waves of roll, pitch and heading, (3, waves) each.
    """

    period_s: Float[Array, "3 waves"]
    phase_rad: Float[Array, "3 waves"]
    wave_rad: Float[Array, "3 waves"]
    speed_mps: Any = SPEED_MPS
    heading_rad: Any = HEADING_RAD
    above_ground_m: Any = ABOVE_GROUND_M

    @classmethod
    def draw(cls, key: Array) -> "Path":
        """Four waves each."""
        share = _shares(key).ravel()[:36].reshape(3, 3, 4)
        return cls(0.8 * (5.0 / 0.8) ** share[0], 2 * np.pi * share[1], np.radians(0.05) + np.radians(0.10) * share[2])

    def navigation(self, t: np.ndarray, middle_s: np.ndarray) -> tuple[Any, ...]:
        """Latitude, longitude, height, roll, pitch, heading; over the centre of the field at `middle_s`."""
        math, root = arrays_of(self), np.sqrt(1 - ECCENTRICITY2 * np.sin(LAT_RAD) ** 2)
        prime_vertical = SEMI_MAJOR_M / root
        meridian = prime_vertical * (1 - ECCENTRICITY2) / root**2
        height, way = GROUND_M + self.above_ground_m, self.speed_mps * (t - middle_s)
        lat = LAT_RAD + way * math.cos(self.heading_rad) / (meridian + height)
        lon = LON_RAD + way * math.sin(self.heading_rad) / ((prime_vertical + height) * np.cos(LAT_RAD))
        angle = 2 * np.pi * t[None, :, None] / self.period_s[:, None, :] + self.phase_rad[:, None, :]
        wave = (self.wave_rad[:, None, :] * math.sin(angle)).sum(axis=-1)
        return lat, lon, height + 0 * t, wave[0], PITCH_RAD + wave[1], self.heading_rad + wave[2]

    def scan(self, t: np.ndarray, start_s: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, Any]:
        """Scan and pitch angle; the pitch holds the line across the track: tan(pitch) = V (t - t_mid) cos(scan) / H."""
        since_middle = t - start_s - SWING_S / 2
        theta = np.where(left, 1.0, -1.0) * since_middle * (2 * SWING_RAD / SWING_S)
        return theta, arrays_of(self).arctan(self.speed_mps * since_middle * np.cos(theta) / self.above_ground_m)

    def recorded(self, hz: float = POS_HZ) -> tuple[Trajectory, Encoder, Encoder]:
        """POS, scan and pitch as samples around each image."""
        ticks = np.arange(round((SWING_S + 2 * MARGIN_S) * hz) + 1) / hz - MARGIN_S
        start, left = (np.repeat(each, len(ticks)) for each in (_STARTS, ~_IS_RIGHT))
        time = np.tile(ticks, len(SCENES)) + start
        body = Trajectory.from_geodetic(time, *self.navigation(time, start + SWING_S / 2), max_gap_s=MAX_GAP_S)
        scan, pitch = self.scan(time, start, left)
        return body, Encoder(time, scan, MAX_GAP_S, "scan"), Encoder(time, pitch, MAX_GAP_S, "pitch")


class Drawn(NamedTuple):
    """One flight over n points, those of `SCENES` in this order; pixels are (sample, line).

    - `sensor`: as recorded, with parameters of zero; `truth`: as it was, the exposure of one point after the other.
    - `point_m`, `surveyed_m`: where the points are, and where they are said to be, (n, 3), ECEF.
    - `exact_px`, `pixel_px`: where they are imaged, and where they were measured, (n, 2).
    """

    sensor: Sensor
    truth: Sensor
    point_m: Float[Any, "n 3"]
    surveyed_m: Float[Any, "n 3"]
    exact_px: Float[Any, "n 2"]
    pixel_px: Float[Any, "n 2"]

    def observations(self) -> Observations:
        """What `calibrate` is given, with the names of images left out. Traceable."""
        time = _START_S + self.pixel_px[:, 1] / LINES_HZ
        covariance = np.broadcast_to(_ECEF_FROM_ENU * POINT_SIGMA_M**2 @ _ECEF_FROM_ENU.T, (len(_IMAGE), 3, 3))
        pixel = arrays_of(self.pixel_px).stack([self.pixel_px[:, 0], np.zeros(len(_IMAGE))], axis=-1)
        shot = Shot(time_s=time, image=_IMAGE, swing=_SWING, strip=_PAIR)
        return Observations(shot, self.surveyed_m, pixel, _SIGMA_PX, _ROLES == "control", covariance)


_STARTS = np.array([scene[0] for scene in SCENES.values()])
_IS_RIGHT = np.array([name[0] == "R" for name in SCENES])
_COUNTS = np.array([scene[1] for scene in SCENES.values()])
# Of each point: its image, and what that one is.
_IMAGE = np.repeat(np.arange(len(SCENES)), _COUNTS)
_START_S, _SWING, _PAIR = _STARTS[_IMAGE], _IS_RIGHT[_IMAGE].astype(int), _IMAGE // 2
_SIGMA_PX = np.array([scene[3:] for scene in SCENES.values()])[_IMAGE]
_DRIFTED_RAD = np.array([DRIFT_RAD.get(name, np.zeros(3)) for name in SCENES])[_IMAGE]
# Control first: strata are shuffled, so the last ones of an image are spread over it.
_NUMBER = np.concatenate([np.arange(count) for count in _COUNTS])
_ROLES = np.where(_NUMBER < np.array([count - check for _, count, check, *_ in SCENES.values()])[_IMAGE], "control", "check")
# East, north and up in the middle of the field; at its ends they are 5e-4 rad off.
_ECEF_FROM_ENU = ecef_from_ned_matrices(LAT_RAD, LON_RAD) @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def _shares(key: Array) -> Any:
    """Numbers from 0 to 1, (4, points): of one shape, since each that is drawn from takes 0.4 s to compile."""
    return plain(jax.random.uniform(key, (4, len(_IMAGE)), float))


def _look_at(key: Array) -> tuple[Any, Any, Any]:
    """For every point: time, sample, height; one point in each of equal strata of the scan angle."""
    order, share, sample, height = _shares(key)
    math = arrays_of(order)
    # Numbers of strata in the order of random numbers, image by image.
    stratum = math.argsort(math.argsort(_IMAGE.astype(float) + order)) - (np.cumsum(_COUNTS) - _COUNTS)[_IMAGE]
    # Measured lines scatter by a few pixels: a thousandth of the swing (19 lines) keeps them on the image.
    time = _START_S + SWING_S * (0.001 + 0.998 * (stratum.astype(float) + share) / _COUNTS[_IMAGE].astype(float))
    return time, 0.95 * HALF_LINE_PX * (2 * sample - 1), GROUND_M + GROUND_SPREAD_M * (2 * height - 1)


def draw(
    key: Array,
    path: Path | None = None,
    truth: Truth = TABLE_4,
    *,
    noise: bool = True,
    drift: bool = False,
    scan_first: bool = True,
    point_m: Float[Array, "n 3"] | None = None,
) -> Drawn:
    """One flight, a pure function of the key, the path, the truth and the points: for `jit`, `vmap` and derivatives.

    The record is the path; where the platform was at each exposure, the errors of `frame_errors` tell: recorded = true @ motion.

    **Arguments:**

    - `key`: of `jax.random`, of everything random.
    - `path`: drawn by default.
    - `noise`, `drift`, `truth`, `scan_first`: as of `simulate`.
    - `point_m`: where the points are; by default where the instrument looks at times and samples that are drawn.
    """
    of_path, of_points, of_pos, of_measuring = jax.random.split(key, 4)
    path = Path.draw(of_path) if path is None else path
    body, scan, pitch = path.recorded()
    math = arrays_of((truth, of_path))
    by_swing = math.where(_SWING[:, None] == 0, truth.left_rad, truth.right_rad) + _DRIFTED_RAD * drift
    exact = sensor(body, scan, pitch, truth, Mount(angles_rad=by_swing), scan_first)
    time, sample, height = _look_at(of_points)
    keys = Shot(swing=_SWING)
    if noise:
        motion = draw_errors(frame_errors(), of_pos, Shot(time_s=time, strip=_PAIR))["body"]
        turn, shift = (math.stack(part, axis=-1) for part in (motion.turn, motion.shift))
        exact = exact.after("body", "pos_error", Mount(lever_arm_m=-shift, angles_rad=-turn))
    point: Any = point_m
    if point is None:
        pixel = math.stack([sample, np.zeros(len(_IMAGE))], axis=-1)
        shot = dataclasses.replace(keys, time_s=time)
        point = plain(image_to_ground(exact, shot, pixel, HeightSurface(jnp.asarray(height))).point_m)
    if not (point_m is None and noise):
        # Also of points just looked at: rounding of their ECEF coordinates (1e-9 m) then is no measurement error.
        seen = ground_to_image(exact, keys, point, (_START_S, _START_S + SWING_S))
        time, sample = plain(seen.time_s), plain(seen.pixel_px)[:, 0]
    exact_px = math.stack([sample, (time - _START_S) * LINES_HZ], axis=-1)
    white = plain(jax.random.normal(of_measuring, (6, len(_IMAGE)), float)).T * float(noise)  # of the shape that errors compiled
    surveyed = point + white[:, :3] @ (np.diag(POINT_SIGMA_M) @ _ECEF_FROM_ENU.T)
    recorded = sensor(body, scan, pitch, scan_first=scan_first)
    return Drawn(recorded, exact, point, surveyed, exact_px, exact_px + white[:, 3:5] * _SIGMA_PX)


def simulate(seed: int, *, noise: bool = True, drift: bool = False, truth: Truth = TABLE_4, scan_first: bool = True) -> Flight:
    """One flight.

    **Arguments:**

    - `seed`: of everything random.
    - `noise`: off, the points are imaged exactly through the recorded POS, so that the truth reproduces every measurement to
      rounding; on, POS, points and image measurements carry the scenario's errors, which the flight states.
    - `drift`: whether the IMU boresight of L3 and R3 has drifted, as in the paper. Their check points then contradict whatever
      is calibrated from L1 and R1 alone.
    - `truth`: the parameters to be found; `draw_truth` draws some.
    - `scan_first`: the order of the two turns, which the paper leaves open: Rx(scan) Ry(pitch), or Ry(pitch) Rx(scan).

    **Returns:** a flight whose sensor holds the recorded POS and zero parameters, with the 15 unknowns and their priors.
    """
    drawn = draw(jax.random.key(seed), truth=truth, noise=noise, drift=drift, scan_first=scan_first)
    names, lines = list(SCENES), np.array([0.0, LINES_HZ * SWING_S])
    return Flight(
        name=f"haian, seed {seed}" + ("" if noise else ", noise-free"),
        sensor=drawn.sensor,
        images=[
            Image(
                name,
                lines=LineTimes(lines, start + np.array([0.0, SWING_S]), name),
                swing="left" if name[0] == "L" else "right",
                strip=f"pair_{name[1]}",
            )
            for name, (start, *_) in SCENES.items()
        ],
        points=Points(
            [f"{names[i]}-{k + 1:02d}" for i, k in zip(_IMAGE, _NUMBER, strict=True)],
            drawn.surveyed_m,
            np.broadcast_to(POINT_SIGMA_M, drawn.surveyed_m.shape),
            _ROLES.tolist(),
        ),
        measurements=Measurements(
            image=_IMAGE,
            point=np.arange(len(_IMAGE)),
            line_px=drawn.pixel_px[:, 1],
            sample_px=drawn.pixel_px[:, 0],
            sigma_line_px=_SIGMA_PX[:, 1],
            sigma_sample_px=_SIGMA_PX[:, 0],
        ),
        unknowns=unknowns(),
        errors=frame_errors() if noise else (),
        epoch="2018-10-20T02:00:00Z",
        reference_point="GNSS antenna phase centre",
        notes="Simulated after Jin et al. (2024); see whiskjax.flights.haian.",
    )
