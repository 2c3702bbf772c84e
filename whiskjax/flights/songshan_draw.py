"""The truth of the simulated block of Wang et al. (2018): terrain, detectors as they lie, mounts, strips, POS errors."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..chain.by import By
from ..chain.line_camera import LookTable
from ..chain.link import AbstractLink
from ..chain.mounts import Axes, Mount
from ..chain.samples import ned_from_body_matrices, quaternions_from_matrices
from ..chain.sensor import Sensor
from ..chain.trajectory import Trajectory

FOCAL_PX = 26_000.0  # 130 mm, 5 um
LINE_PX = 32_756
CENTRE_PX = (LINE_PX - 1) / 2  # also half the line: s = (sample - CENTRE_PX) / CENTRE_PX runs from -1 to 1
VIEW_RAD = {"forward": np.radians(27.0), "nadir": 0.0, "backward": np.radians(-14.0)}  # the angles are assumed
SPEED_MPS, HEIGHT_M, STRIP_M = 60.0, 2450.0, 11_400.0
STRIP_S, TURN_S = STRIP_M / SPEED_MPS, 300.0  # a strip, and the turn to the next one

# The mean of Table 3: (u, v, w) from the projection centre to the antenna, in the camera frame; R_c^b = Rx(ex) Ry(ey) Rz(ez).
LEVER_ARM_M = np.array([0.0075601137, 0.0059411685, -0.01626891418])
BORESIGHT_RAD = np.radians([-0.07614977683, -0.06546708276, -0.01759787143])

# Errors of POS: 1-sigma and correlation time, x, y, z and roll, pitch, yaw.
POS_SIGMA_M, POS_CORRELATION_S = np.array([0.05, 0.05, 0.08]), np.full(3, 300.0)
ATTITUDE_SIGMA_RAD, ATTITUDE_CORRELATION_S = np.radians([0.005, 0.005, 0.010]), np.array([60.0, 60.0, 120.0])
VIBRATION_RAD, VIBRATION_S = np.radians(0.0007), 0.7

# The detector as it lies: cubics in s of each line, dx then dy, pixels; and what no cubic can follow.
CUBICS_PX = {
    "forward": ((5.0, 9.0, 4.0, -2.0), (-3.0, 3.0, 2.0, 1.5)),
    "nadir": ((0.0, 0.0, 3.0, 1.5), (0.0, 2.0, -2.0, 1.0)),
    "backward": ((-6.0, -8.0, -3.0, 2.0), (4.0, -3.0, 1.0, -1.5)),
}
SCALE, RADIUS_PX = (0.0030, 3.0e-4, -1.5e-4), 20_000.0
WAVE_PX, WAVELENGTH_PX = 0.25, 4_000.0
_LOOKS = 1025  # 32 px apart: linear between them, the wave is off by 1e-4 px


def terrain_m(x_m: Float[np.ndarray, "..."], y_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Height of the ground: hills of 190 m around 290 m, and two mountains."""
    hills = 110 * np.sin(x_m / 900 + 0.3) * np.cos(y_m / 1100) + 80 * np.sin((x_m + 2 * y_m) / 700)
    high = 1150 * np.exp(-(((x_m + 2400) / 1500) ** 2) - ((y_m - 1300) / 1300) ** 2)
    low = 500 * np.exp(-(((x_m - 2500) / 1300) ** 2) - ((y_m + 1500) / 1200) ** 2)
    return np.clip(290 + hills + high + low, 100, 1500)


def deformation_px(
    view: str, sample_px: Float[np.ndarray, " n"], cubic: bool = False
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """By how much detector elements lie beside their laboratory position: dx (across the line) and dy (along it) in pixels.

    The true position is the laboratory one, (f tan(view), sample - centre), plus this: a scale along the radius from the
    principal point that changes with the radius, the cubics of the line, and a wave of 0.25 px. Its wavelength, which nobody
    printed, is 4000 px here: eight waves on the line. Sine across the line, cosine along it. `cubic` leaves out the wave and the
    scale's last term: what is left is a cubic of each line.
    """
    x, y = FOCAL_PX * np.tan(VIEW_RAD[view]), sample_px - CENTRE_PX
    scale = np.polynomial.polynomial.polyval((x * x + y * y) / RADIUS_PX**2, SCALE[:2] if cubic else SCALE)
    cubic_x, cubic_y = (np.polynomial.polynomial.polyval(y / CENTRE_PX, c) for c in CUBICS_PX[view])
    phase, wave = 2 * np.pi * y / WAVELENGTH_PX, 0.0 if cubic else WAVE_PX
    return x * scale + cubic_x + wave * np.sin(phase), y * scale + cubic_y + wave * np.cos(phase)


def detector(view: str, cubic: bool = False) -> LookTable:
    """The line of a view as it really lies, or all of it that is `cubic`."""
    sample = np.linspace(0, LINE_PX - 1, _LOOKS)
    dx, dy = deformation_px(view, sample, cubic)
    x, y = FOCAL_PX * np.tan(VIEW_RAD[view]) + dx, sample - CENTRE_PX + dy
    return LookTable(sample, np.stack([x, y, np.full_like(x, -FOCAL_PX)], axis=-1))


def mounts(lever_arm_m: np.ndarray, boresight_rad: np.ndarray) -> dict[str, AbstractLink]:
    """X_S = X_A - R (u, v, w) (equation 9): the lever arm lies behind the boresight and leads back."""
    return {
        "imu": Axes("x -y -z"),
        "boresight": Mount(angles_rad=boresight_rad),
        "lever": Mount(lever_arm_m=lever_arm_m, lever_sign=-1),
    }


def true_sensor(body: Trajectory) -> Sensor:
    """The sensor that makes the images, behind the true poses."""
    return Sensor({"body": body, **mounts(LEVER_ARM_M, BORESIGHT_RAD)}, By("view", {view: detector(view) for view in VIEW_RAD}))


class Strip(NamedTuple):
    """One straight flight: over which point of the field its middle lies, and where it leads (clockwise from north)."""

    x_m: float
    y_m: float
    heading_deg: float


class DataSet(NamedTuple):
    """What was flown and measured: strips in the order of time, points, how many lie in several strips, check points, ties."""

    strips: Mapping[str, Strip]
    points: int
    several: int
    check: int
    ties: int


DATA = {
    "A": DataSet(
        {
            "east": Strip(0.0, 875.0, 90.0),
            "west": Strip(0.0, -875.0, 270.0),
            "north": Strip(-875.0, 0.0, 0.0),
            "south": Strip(875.0, 0.0, 180.0),
        },
        *(70, 21, 20, 14_157),
    ),
    "B": DataSet({"east": Strip(0.0, 1050.0, 90.0), "west": Strip(0.0, -1050.0, 270.0)}, *(54, 5, 14, 8_802)),
}


class Noise(NamedTuple):
    """1-sigma of image measurements, in sample and in line, and how many times the nominal vibration the platform has."""

    point_px: float
    tie_px: float
    vibration: float


NOISE = {"nominal": Noise(0.3, 0.5, 1.0), "paper-like": Noise(3.5, 2.0, 3.0)}


def start_s(strips: int) -> Float[np.ndarray, " strips"]:
    """When the strips begin."""
    return (STRIP_S + TURN_S) * np.arange(strips)


def ornstein_uhlenbeck(
    rng: np.random.Generator,
    time_s: Float[np.ndarray, "pieces n"],
    sigma: Float[np.ndarray, " k"],
    correlation_s: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "pieces n k"]:
    """Independent stationary processes with covariance sigma^2 exp(-|dt| / correlation_s), on through the gaps between pieces.

    x_i = a_i x_(i-1) + sqrt(1 - a_i^2) w_i with a_i = exp(-dt_i / correlation_s), exact for any step; divided by the product of
    the a_i, that is a cumulative sum. That product has to be a number: a piece is shorter than 700 correlation times.
    """
    step = np.diff(time_s.ravel(), prepend=-np.inf).reshape(*time_s.shape, 1)
    keep = np.exp(-step / correlation_s)
    fresh = np.sqrt(-np.expm1(-2 * step / correlation_s)) * rng.standard_normal(keep.shape)
    growth = np.exp((time_s - time_s[:, :1])[..., None] / correlation_s)
    out, last = np.empty(keep.shape), np.zeros(keep.shape[-1])
    for i in range(len(time_s)):
        out[i] = (keep[i, 0] * last + np.cumsum(fresh[i] * growth[i], axis=0)) / growth[i]
        last = out[i, -1]
    return sigma * out


def fly(rng: np.random.Generator, strips: Mapping[str, Strip], pos_hz: float, vibration: float) -> tuple[Trajectory, Trajectory]:
    """The poses of the strips as they were, and as POS records them; local world x east, y north, z up.

    The platform flies straight and sways by some tenths of a degree. It vibrates (`vibration` times 0.0007 deg on every axis),
    which POS does not see; what POS records errs by Ornstein-Uhlenbeck processes that go on through the turns.
    """
    tick = np.arange(round(STRIP_S * pos_hz) + 1) / pos_hz
    time = start_s(len(strips))[:, None] + tick
    centre = np.array([(s.x_m, s.y_m) for s in strips.values()])
    heading = np.radians([s.heading_deg for s in strips.values()])
    course = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    way = SPEED_MPS * (tick - STRIP_S / 2)
    ground = centre[:, None] + way[:, None] * course[:, None]
    position = np.concatenate([ground, np.full((*time.shape, 1), HEIGHT_M)], axis=-1)

    period_s, phase = np.exp(rng.uniform(np.log(5.0), np.log(25.0), (3, 3))), rng.uniform(0, 2 * np.pi, (3, 3))
    wave_rad = np.radians(rng.uniform(0.03, 0.12, (3, 3)))
    smooth = np.sum(wave_rad * np.sin(2 * np.pi * time[..., None, None] / period_s + phase), axis=-1)
    smooth[..., 2] += heading[:, None]
    sigma = np.concatenate([POS_SIGMA_M, ATTITUDE_SIGMA_RAD, np.full(3, vibration * VIBRATION_RAD)])
    correlation = np.concatenate([POS_CORRELATION_S, ATTITUDE_CORRELATION_S, np.full(3, VIBRATION_S)])
    shift, turn, shake = np.split(ornstein_uhlenbeck(rng, time, sigma, correlation), 3, axis=-1)
    true, recorded = (position, smooth + shake), (position + shift, smooth + turn)
    return _trajectory(time, *true, 2 / pos_hz), _trajectory(time, *recorded, 2 / pos_hz)


def _trajectory(time_s: np.ndarray, position_m: np.ndarray, angles_rad: np.ndarray, max_gap_s: float) -> Trajectory:
    ned = ned_from_body_matrices(*np.moveaxis(angles_rad.reshape(-1, 3), -1, 0))
    enu = np.stack([ned[:, 1], ned[:, 0], -ned[:, 2]], axis=1)
    return Trajectory(time_s.ravel(), position_m.reshape(-1, 3), quaternions_from_matrices(enu), max_gap_s=max_gap_s)
