"""location.cpp called with numpy arrays: a fixed target located from many looks by an extended Kalman filter.

What every peer of this problem is given, and what it returns: the target's offset from the first guess (runs, 3) in ECEF axes,
and its covariance (runs, 3, 3) in m^2. Angles are in radians. Preparing a peer puts the arrays in the order that suits it best.
"""

import ctypes
from collections.abc import Callable
from ctypes import POINTER, c_double, c_int, c_int64
from dataclasses import dataclass
from math import radians

import numpy as np

from . import _doubles, _function, _pointer

Located = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Recorded:
    """The looks of all runs, as recorded; angles as in the header of location.cpp, heights above the ellipsoid.

    **Arguments**: pixel_px (runs, looks, 2), everything else (runs, looks).
    """

    lat_rad: np.ndarray
    lon_rad: np.ndarray
    height_m: np.ndarray
    roll_rad: np.ndarray
    pitch_rad: np.ndarray
    heading_rad: np.ndarray
    beta_rad: np.ndarray
    alpha_rad: np.ndarray
    pixel_px: np.ndarray

    def numbers(self) -> np.ndarray:
        """Everything in the order of the arguments, (10, runs, looks)."""
        *arrays, pixel_px = vars(self).values()
        return np.stack([*arrays, *np.moveaxis(pixel_px, -1, 0)])


@dataclass(frozen=True)
class Start:
    """What is known before the first look, the same for all runs.

    **Arguments**: guess_ecef_m (3,); covariance_m2 (3, 3) in ECEF axes.
    """

    guess_ecef_m: np.ndarray
    covariance_m2: np.ndarray


@dataclass(frozen=True)
class Sigmas:
    """1 sigma of what is recorded: those of the paper's Table 1.

    **Arguments**: pixel_px: registration, in each coordinate; position_m (3,) along the body's axes; attitude_rad (3,) about
    them; gimbal_rad (2,): about x after Rx(beta), about y after Ry(alpha).
    """

    pixel_px: float = 2.0
    position_m: tuple[float, ...] = (10.0, 10.0, 20.0)
    attitude_rad: tuple[float, ...] = (radians(0.03), radians(0.03), radians(0.08))
    gimbal_rad: tuple[float, ...] = (radians(0.01), radians(0.01))


FOCAL_PX = 1e5


class _Looks(ctypes.Structure):
    _fields_ = [
        ("runs", c_int64),
        ("count", c_int64),
        ("look", _doubles),
        ("guess_m", c_double * 3),
        ("covariance_m2", c_double * 9),
        ("focal_px", c_double),
        ("pixel_sigma_px", c_double),
        ("position_sigma_m", c_double * 3),
        ("attitude_sigma_rad", c_double * 3),
        ("gimbal_sigma_rad", c_double * 2),
    ]


def prepared(recorded: Recorded, start: Start, sigmas: Sigmas, full: bool, threads: int = 1) -> Callable[[], Located]:
    """The filter as a call in which next to nothing but C++ runs; its results are overwritten by the next call.

    **Arguments**: full: whether the measurement covariance holds the errors of pose and gimbal, or registration alone.
    """
    look = np.ascontiguousarray(np.moveaxis(recorded.numbers(), 0, -1))
    runs, count, _ = look.shape
    struct = _Looks(
        runs,
        count,
        _pointer(look, look.shape),
        (c_double * 3)(*start.guess_ecef_m),
        (c_double * 9)(*start.covariance_m2.ravel()),
        FOCAL_PX,
        sigmas.pixel_px,
        (c_double * 3)(*sigmas.position_m),
        (c_double * 3)(*sigmas.attitude_rad),
        (c_double * 2)(*sigmas.gimbal_rad),
    )
    struct.array = look  # it only points to it
    offset_m, covariance_m2 = np.empty((runs, 3)), np.empty((runs, 3, 3))
    call = _function("location", POINTER(_Looks), c_int, c_int, _doubles, _doubles)
    out = _pointer(offset_m, (runs, 3)), _pointer(covariance_m2, (runs, 3, 3))

    def run() -> Located:
        call(struct, full, threads, *out)
        return offset_m, covariance_m2

    return run
