"""The whiskbroom scanner with left and right swings over Haian: a seeded simulation of Jin et al. (2024).

Jin et al. (2024), Geometric external calibration method for the airborne large-view-field infrared scanner considering different
effects of left and right pendulum directions, National Remote Sensing Bulletin 28(9), 2372-2382. What the paper leaves out (focal
length, geometry, noise) is chosen so that what it does print is reproduced.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..chain.by import By
from ..chain.imaging import image_to_ground
from ..chain.line_camera import LineCamera
from ..chain.lines import LineTimes
from ..chain.link import AbstractLink
from ..chain.mounts import Axes, Mount
from ..chain.samples import ecef_samples
from ..chain.search import ground_to_image
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.trajectory import PosePerImage, Trajectory
from ..chain.turn import Encoder, Turn
from ..earth.ellipsoid import ECCENTRICITY2, SEMI_MAJOR_M, ecef_to_geodetic
from ..earth.frames import enu_rotation
from ..earth.surface import HeightSurface
from ..estimate.unknown import Unknown
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


class Path:
    """The flown path and the scan, as smooth functions of time; attitude waves are drawn once."""

    def __init__(self, rng: np.random.Generator):
        self.period_s = np.exp(rng.uniform(np.log(0.8), np.log(5.0), (3, 4)))
        self.phase_rad = rng.uniform(0, 2 * np.pi, (3, 4))
        self.wave_rad = np.radians(rng.uniform(0.05, 0.15, (3, 4)))

    def navigation(self, t: np.ndarray, middle_s: np.ndarray) -> tuple[np.ndarray, ...]:
        """Latitude, longitude, height, roll, pitch, heading; over the centre of the field at `middle_s`."""
        root = np.sqrt(1 - ECCENTRICITY2 * np.sin(LAT_RAD) ** 2)
        prime_vertical = SEMI_MAJOR_M / root
        meridian = prime_vertical * (1 - ECCENTRICITY2) / root**2
        height = GROUND_M + ABOVE_GROUND_M
        way = SPEED_MPS * (t - middle_s)
        lat = LAT_RAD + way * np.cos(HEADING_RAD) / (meridian + height)
        lon = LON_RAD + way * np.sin(HEADING_RAD) / ((prime_vertical + height) * np.cos(LAT_RAD))
        angle = 2 * np.pi * t[:, None] / self.period_s[:, None, :] + self.phase_rad[:, None, :]
        wave = np.sum(self.wave_rad[:, None, :] * np.sin(angle), axis=-1)
        return lat, lon, np.full_like(t, height), wave[0], PITCH_RAD + wave[1], HEADING_RAD + wave[2]

    @staticmethod
    def scan(t: np.ndarray, start_s: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scan and pitch angle; the pitch holds the line across the track: tan(pitch) = V (t - t_mid) cos(scan) / H."""
        since_middle = t - start_s - SWING_S / 2
        theta = np.where(left, 1.0, -1.0) * since_middle * (2 * SWING_RAD / SWING_S)
        return theta, np.arctan(SPEED_MPS * since_middle * np.cos(theta) / ABOVE_GROUND_M)


def _segments(hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample times of all images, with the start and swing of the image that each belongs to."""
    n = round((SWING_S + 2 * MARGIN_S) * hz) + 1
    ticks = np.arange(n) / hz - MARGIN_S
    time = np.concatenate([start + ticks for start, *_ in SCENES.values()])
    start = np.repeat([scene[0] for scene in SCENES.values()], n)
    left = np.repeat([name[0] == "L" for name in SCENES], n)
    return time, start, left


@functools.cache  # the scan is the same in every flight, and half of the time that building one takes
def _encoders(hz: float) -> tuple[Encoder, Encoder]:
    time, start, left = _segments(hz)
    scan, pitch = Path.scan(time, start, left)
    return Encoder(time, scan, MAX_GAP_S, "scan"), Encoder(time, pitch, MAX_GAP_S, "pitch")


def _recorded(path: Path, rng: np.random.Generator, noise: bool) -> Trajectory:
    """POS as recorded: 200 Hz around each image, with a bias for each pair and jitter for each sample."""
    time, start, _ = _segments(POS_HZ)
    lat, lon, height, *attitude = path.navigation(time, start + SWING_S / 2)
    samples = len(time) // len(SCENES)
    pairs = len(SCENES) // 2
    shift = np.repeat(rng.normal(0, POS_BIAS_M, (pairs, 3)), 2 * samples, axis=0) * noise
    turn = np.repeat(rng.normal(0, 1, (pairs, 3)) * POS_BIAS_RAD, 2 * samples, axis=0) * noise
    turn = turn + rng.normal(0, 1, (len(time), 3)) * POS_JITTER_RAD * noise
    # A shift of centimetres: the mean radius is exact enough.
    lat = lat + shift[:, 0] / SEMI_MAJOR_M
    lon = lon + shift[:, 1] / (SEMI_MAJOR_M * np.cos(LAT_RAD))
    roll, pitch, heading = (a + e for a, e in zip(attitude, turn.T, strict=True))
    return Trajectory.from_geodetic(time, lat, lon, height - shift[:, 2], roll, pitch, heading, max_gap_s=MAX_GAP_S)


def _exposures(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """For every point: image index, time, sample; one point in each of equal strata of the scan angle."""
    image, time, sample = [], [], []
    for i, (start, count, *_) in enumerate(SCENES.values()):
        # Measured lines scatter by a few pixels: a thousandth of the swing (19 lines) keeps them on the image.
        share = 0.001 + 0.998 * (rng.permutation(count) + rng.uniform(0, 1, count)) / count
        image.append(np.full(count, i))
        time.append(start + share * SWING_S)
        sample.append(rng.uniform(-0.95, 0.95, count) * HALF_LINE_PX)
    return np.concatenate(image), np.concatenate(time), np.concatenate(sample)


def simulate(seed: int, *, noise: bool = True, drift: bool = False, truth: Truth = TABLE_4, scan_first: bool = True) -> Flight:
    """One flight.

    **Arguments:**

    - `seed`: of everything random.
    - `noise`: off, the points are imaged exactly through the recorded POS, so that the truth reproduces every measurement to
      rounding; on, the truth is the smooth path, and POS, points and image measurements carry the scenario's errors.
    - `drift`: whether the IMU boresight of L3 and R3 has drifted, as in the paper. Their check points then contradict whatever
      is calibrated from L1 and R1 alone.
    - `truth`: the parameters to be found.
    - `scan_first`: the order of the two turns, which the paper leaves open: Rx(scan) Ry(pitch), or Ry(pitch) Rx(scan).

    **Returns:** a flight whose sensor holds the recorded POS and zero parameters, with the 15 unknowns and their priors.
    """
    rng = np.random.default_rng(seed)
    path = Path(rng)
    image, time, sample = _exposures(rng)
    height = GROUND_M + rng.uniform(-GROUND_SPREAD_M, GROUND_SPREAD_M, len(time))
    body = _recorded(path, rng, noise)
    scan, pitch = _encoders(POS_HZ)

    start = np.array([scene[0] for scene in SCENES.values()])[image]
    swing = np.array([int(name[0] == "R") for name in SCENES])[image]
    by_swing = np.where(swing[:, None] == 0, truth.left_rad, truth.right_rad)
    drifted = np.array([DRIFT_RAD.get(name, np.zeros(3)) for name in SCENES])[image] * drift
    if noise:
        # The smooth path itself, one pose for each exposure, and encoders ten times as dense.
        position, quaternion, _ = ecef_samples(*path.navigation(time, start + SWING_S / 2))
        true_body, true_encoders = PosePerImage(position, quaternion), _encoders(10 * POS_HZ)
    else:
        true_body, true_encoders = body, (scan, pitch)
    exact = sensor(true_body, *true_encoders, truth, Mount(angles_rad=by_swing + drifted), scan_first)
    keys = Shot(image=np.arange(len(time)), swing=swing)
    pixel = np.stack([sample, np.zeros(len(time))], -1)
    shot = dataclasses.replace(keys, time_s=time)
    points = np.asarray(image_to_ground(exact, shot, pixel, HeightSurface(jnp.asarray(height))).point_m)
    if not noise:
        # Image the points as they are stored: rounding of ECEF coordinates (1e-9 m) then is no measurement error.
        seen = ground_to_image(exact, keys, points, (start, start + SWING_S))
        time, sample = np.asarray(seen.time_s), np.asarray(seen.pixel_px[:, 0])

    sigma = np.array([scene[3:] for scene in SCENES.values()])[image]
    error = rng.normal(0, 1, (len(time), 2)) * sigma * noise
    lat, lon, _ = ecef_to_geodetic(jnp.asarray(points))
    to_ecef = np.asarray(enu_rotation(lat, lon))
    surveyed = points + np.einsum("nij,nj->ni", to_ecef, rng.normal(0, 1, points.shape) * POINT_SIGMA_M) * noise
    return Flight(
        name=f"haian, seed {seed}" + ("" if noise else ", noise-free"),
        sensor=sensor(body, scan, pitch, scan_first=scan_first),
        images=[
            Image(
                name,
                lines=LineTimes(np.array([0.0, LINES_HZ * SWING_S]), start + np.array([0.0, SWING_S]), name),
                swing=_swing(name),
                strip=f"pair_{name[1]}",
            )
            for name, (start, *_) in SCENES.items()
        ],
        points=Points(_point_names(image), surveyed, np.broadcast_to(POINT_SIGMA_M, points.shape), _roles()),
        measurements=Measurements(
            image=image,
            point=np.arange(len(time)),
            line_px=(time - start) * LINES_HZ + error[:, 1],
            sample_px=sample + error[:, 0],
            sigma_line_px=sigma[:, 1],
            sigma_sample_px=sigma[:, 0],
        ),
        unknowns=unknowns(),
        epoch="2018-10-20T02:00:00Z",
        reference_point="GNSS antenna phase centre",
        notes="Simulated after Jin et al. (2024); see whiskjax.flights.haian.",
    )


def _swing(name: str) -> str:
    return "left" if name[0] == "L" else "right"


def _point_names(image: np.ndarray) -> list[str]:
    names = list(SCENES)
    count = np.zeros(len(names), dtype=int)
    out = []
    for i in image:
        count[i] += 1
        out.append(f"{names[i]}-{count[i]:02d}")
    return out


def _roles() -> list[str]:
    """Control first: strata are shuffled, so the last ones of an image are spread over it."""
    return [role for _, count, check, *_ in SCENES.values() for role in ["control"] * (count - check) + ["check"] * check]
