"""The truth of the simulated block of Wang et al. (2018): terrain, detectors as they lie, mounts, strips, the path."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import ZERO, apply, cross, vadd, vsub
from ..chain.link import AbstractLink
from ..chain.look_table import LookTable
from ..chain.mounts import Axes, Mount
from ..chain.pose import Motion
from ..chain.rotations import quaternion_from_small_vector, quaternion_product, rotation_from_quaternion
from ..chain.samples import body_in_ned, quaternions_in_blocks
from ..chain.trajectory import Trajectory
from ..rules import arrays_of, plain

FOCAL_PX = 26_000.0  # 130 mm, 5 um
LINE_PX = 32_756
CENTRE_PX = (LINE_PX - 1) / 2  # also half the line: s = (sample - CENTRE_PX) / CENTRE_PX runs from -1 to 1
VIEW_RAD = {"forward": np.radians(27.0), "nadir": 0.0, "backward": np.radians(-14.0)}  # the angles are assumed
SPEED_MPS, HEIGHT_M, STRIP_M = 60.0, 2450.0, 11_400.0
STRIP_S, TURN_S = STRIP_M / SPEED_MPS, 300.0  # a strip, and the turn to the next one

# The mean of Table 3: (u, v, w) from the projection centre to the antenna, in the camera frame; R_c^b = Rx(ex) Ry(ey) Rz(ez).
LEVER_ARM_M = np.array([0.0075601137, 0.0059411685, -0.01626891418])
BORESIGHT_RAD = np.radians([-0.07614977683, -0.06546708276, -0.01759787143])


class Truth(NamedTuple):
    """The mounts, metres and radians: the mean of Table 3 by default."""

    lever_arm_m: Any
    boresight_rad: Any


TABLE_3 = Truth(LEVER_ARM_M, BORESIGHT_RAD)

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
    math = arrays_of((x_m, y_m))
    hills = 110 * math.sin(x_m / 900 + 0.3) * math.cos(y_m / 1100) + 80 * math.sin((x_m + 2 * y_m) / 700)
    high = 1150 * math.exp(-(((x_m + 2400) / 1500) ** 2) - ((y_m - 1300) / 1300) ** 2)
    low = 500 * math.exp(-(((x_m - 2500) / 1300) ** 2) - ((y_m + 1500) / 1200) ** 2)
    height = 290 + hills + high + low
    return math.where(height < 100, 100.0, math.where(height > 1500, 1500.0, height))


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


class Path(eqx.Module):
    """The flown path: straight strips, on which the platform sways by some tenths of a degree. Every number may be traced.

    - `period_s`, `phase_rad`, `wave_rad`: of the waves of roll, pitch and yaw, (3, waves) each.
    """

    period_s: Float[Array, "3 waves"]
    phase_rad: Float[Array, "3 waves"]
    wave_rad: Float[Array, "3 waves"]
    speed_mps: Any = SPEED_MPS
    height_m: Any = HEIGHT_M

    @classmethod
    def draw(cls, key: Array) -> "Path":
        """Three waves each."""
        share = plain(jax.random.uniform(key, (3, 3, 3), float))
        return cls(5.0 * 5.0 ** share[0], 2 * np.pi * share[1], np.radians(0.03) + np.radians(0.09) * share[2])

    def recorded(self, strips: Mapping[str, Strip], pos_hz: float) -> Trajectory:
        """The poses of the strips as samples; local world x east, y north, z up."""
        math, time = arrays_of(self), sample_s(len(strips), pos_hz)
        heading = np.radians([s.heading_deg for s in strips.values()])[:, None]
        way = self.speed_mps * (time[:1] - STRIP_S / 2)
        east = np.array([[s.x_m] for s in strips.values()]) + way * np.sin(heading)
        north = np.array([[s.y_m] for s in strips.values()]) + way * np.cos(heading)
        position = math.stack([math.ravel(c) for c in (east, north, self.height_m + 0 * east)], axis=-1)
        angle = 2 * np.pi * time.reshape(1, -1, 1) / self.period_s[:, None, :] + self.phase_rad[:, None, :]
        roll, pitch, yaw = (self.wave_rad[:, None, :] * math.sin(angle)).sum(axis=-1)
        yaw = yaw + np.repeat(heading[:, 0], time.shape[1])
        attitude = quaternions_in_blocks(lambda *a: quaternion_product(_NED_IN_ENU, body_in_ned(*a)), roll, pitch, yaw)
        return Trajectory(time.ravel(), position, attitude, max_gap_s=2 / pos_hz)


# Half a turn about the diagonal of x and y.
_NED_IN_ENU = (np.sqrt(0.5), np.sqrt(0.5), 0, 0)


def sample_s(strips: int, pos_hz: float) -> Float[np.ndarray, "strips samples"]:
    """When poses are sampled."""
    return start_s(strips)[:, None] + np.arange(round(STRIP_S * pos_hz) + 1) / pos_hz


def before(motion: Motion, recorded: Trajectory, time_s: Float[np.ndarray, " n"]) -> Trajectory:
    """The true poses at the samples of a record: recorded = true @ motion."""
    position, quaternion = (jax.tree.map(plain, each) for each in (recorded.position_m, recorded.quaternion))
    back = vsub(ZERO, vadd(motion.shift, cross(motion.shift, motion.turn)))
    position = vadd(position, apply(rotation_from_quaternion(quaternion), back))
    quaternion = quaternion_product(quaternion, quaternion_from_small_vector(vsub(ZERO, motion.turn)))
    math, gap = arrays_of((position, quaternion)), recorded.knots.max_gap_s
    return Trajectory(time_s, math.stack(position, axis=-1), math.stack(quaternion, axis=-1), max_gap_s=gap)
