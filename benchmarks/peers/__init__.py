"""The C++ peers, called with numpy arrays: the whiskbroom scanner of `flights.haian`, written for that one instrument.

Angles are in radians, points in ECEF metres, pixels (sample, offset across the line). Every array must be C-contiguous
float64 (int32 for swings): what is timed copies nothing.
"""

import ctypes
from collections.abc import Callable
from ctypes import POINTER, c_double, c_int, c_int32, c_int64
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from .build import MissingPeer, compiler_version, library, processor

__all__ = [
    "Baked",
    "Flight",
    "MissingPeer",
    "compiler_version",
    "gauss_newton",
    "ground_to_image",
    "image_to_ground",
    "prepared_gauss_newton",
    "processor",
]

_doubles = POINTER(c_double)


class _Times(ctypes.Structure):
    _fields_ = [("count", c_int64), ("time_s", _doubles), ("max_gap_s", c_double)]


class _Whiskbroom(ctypes.Structure):
    _fields_ = [
        ("pos", _Times),
        ("position_m", _doubles),
        ("quaternion_xyzw", _doubles),
        ("scan", _Times),
        ("scan_rad", _doubles),
        ("pitch", _Times),
        ("pitch_rad", _doubles),
        ("u_gps_m", c_double * 3),
        ("angles_pos_rad", c_double * 3),
        ("u_sen_m", c_double * 3),
        ("angles_sen_rad", c_double * 3),
        ("focal_px", c_double),
        ("swing", c_double),
    ]


class _Observations(ctypes.Structure):
    _fields_ = [
        ("lanes", c_int64),
        ("count", c_int64),
        ("ecef_from_platform", _doubles),
        ("antenna_m", _doubles),
        ("scan_sin_cos", _doubles),
        ("pitch_sin_cos", _doubles),
        ("right", POINTER(c_int32)),
        ("point_m", _doubles),
        ("pixel_px", _doubles),
        ("sigma_px", _doubles),
        ("focal_px", c_double),
    ]


def _pointer(array: np.ndarray, shape: tuple[int, ...], kind=c_double):
    """A pointer to an array that already has the layout C++ reads."""
    if array.shape != shape or array.dtype != np.dtype(kind) or not array.flags.c_contiguous:
        raise ValueError(f"expected a contiguous {np.dtype(kind)} array of shape {shape}, got {array.dtype} {array.shape}")
    return array.ctypes.data_as(POINTER(kind))


@dataclass(frozen=True)
class Flight:
    """The whiskbroom scanner during one swing.

    **Arguments**: pos_time_s (n,), position_m (n, 3) ECEF, quaternion_xyzw (n, 4) ecef_from_body (x forward, y right,
    z down); scan_time_s, scan_rad (m,); pitch_time_s, pitch_rad (k,); u_gps_m, angles_pos_rad (of this swing), u_sen_m,
    angles_sen_rad (3,); focal_px; swing +1 left, -1 right; max_gap_s: the longest interval that is interpolated.
    """

    pos_time_s: np.ndarray
    position_m: np.ndarray
    quaternion_xyzw: np.ndarray
    scan_time_s: np.ndarray
    scan_rad: np.ndarray
    pitch_time_s: np.ndarray
    pitch_rad: np.ndarray
    u_gps_m: np.ndarray
    angles_pos_rad: np.ndarray
    u_sen_m: np.ndarray
    angles_sen_rad: np.ndarray
    focal_px: float
    swing: int
    max_gap_s: float

    def _struct(self) -> _Whiskbroom:
        def times(time_s):
            return _Times(len(time_s), _pointer(time_s, (len(time_s),)), self.max_gap_s)

        def three(values):
            return (c_double * 3)(*values)

        n, scans, pitches = len(self.pos_time_s), len(self.scan_time_s), len(self.pitch_time_s)
        return _Whiskbroom(
            times(self.pos_time_s),
            _pointer(self.position_m, (n, 3)),
            _pointer(self.quaternion_xyzw, (n, 4)),
            times(self.scan_time_s),
            _pointer(self.scan_rad, (scans,)),
            times(self.pitch_time_s),
            _pointer(self.pitch_rad, (pitches,)),
            three(self.u_gps_m),
            three(self.angles_pos_rad),
            three(self.u_sen_m),
            three(self.angles_sen_rad),
            self.focal_px,
            self.swing,
        )


@dataclass(frozen=True)
class Baked:
    """Observations whose POS and encoders have been evaluated, for calibration; or lanes of them, (lanes, n, ...) in place of
    (n, ...), for as many calibrations.

    **Arguments**: ecef_from_platform (n, 3, 3), x forward, y left, z up; antenna_m (n, 3) ECEF; scan_sin_cos and
    pitch_sin_cos (n, 2); right (n,) int32, 0 left and 1 right swing; point_m (n, 3) ECEF; pixel_px and sigma_px (n, 2).
    """

    ecef_from_platform: np.ndarray
    antenna_m: np.ndarray
    scan_sin_cos: np.ndarray
    pitch_sin_cos: np.ndarray
    right: np.ndarray
    point_m: np.ndarray
    pixel_px: np.ndarray
    sigma_px: np.ndarray
    focal_px: float

    def each(self, change: Callable[[np.ndarray], np.ndarray]) -> "Baked":
        """The same with every array changed alike: lanes made or taken."""
        return replace(self, **{name: change(a) for name, a in vars(self).items() if isinstance(a, np.ndarray)})

    def _struct(self) -> _Observations:
        lead = self.right.shape
        lanes, n = lead if len(lead) == 2 else (1, *lead)
        struct = _Observations(
            lanes,
            n,
            _pointer(self.ecef_from_platform, (*lead, 3, 3)),
            _pointer(self.antenna_m, (*lead, 3)),
            _pointer(self.scan_sin_cos, (*lead, 2)),
            _pointer(self.pitch_sin_cos, (*lead, 2)),
            _pointer(self.right, lead, c_int32),
            _pointer(self.point_m, (*lead, 3)),
            _pointer(self.pixel_px, (*lead, 2)),
            _pointer(self.sigma_px, (*lead, 2)),
            self.focal_px,
        )
        struct.arrays = self  # it only points to them: they must live as long
        return struct


@cache
def _function(name: str, *argtypes):
    function = getattr(ctypes.CDLL(str(library(name))), name)
    function.argtypes, function.restype = argtypes, None
    return function


def image_to_ground(flight: Flight, time_s: np.ndarray, sample_px: np.ndarray, height_m: float) -> np.ndarray:
    """Where pixels of the detector line meet the surface of constant geodetic height.

    **Arguments**: time_s, sample_px (n,); height_m above the ellipsoid.
    **Returns**: (n, 3) ECEF, NaN where there is none.
    """
    n = len(time_s)
    point_m = np.empty((n, 3))
    call = _function("image_to_ground", POINTER(_Whiskbroom), c_int64, _doubles, _doubles, c_double, _doubles)
    args = _pointer(time_s, (n,)), _pointer(sample_px, (n,)), height_m, _pointer(point_m, (n, 3))
    call(flight._struct(), n, *args)
    return point_m


def ground_to_image(flight: Flight, point_m: np.ndarray, window_s: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """When points passed the detector line within a window of time, and at which sample.

    **Arguments**: point_m (n, 3) ECEF. **Returns**: time_s (n,) and sample_px (n,), NaN where the point was not seen.
    """
    n = len(point_m)
    time_s, sample_px = np.empty(n), np.empty(n)
    call = _function("ground_to_image", POINTER(_Whiskbroom), c_int64, _doubles, c_double, c_double, _doubles, _doubles)
    call(flight._struct(), n, _pointer(point_m, (n, 3)), *window_s, _pointer(time_s, (n,)), _pointer(sample_px, (n,)))
    return time_s, sample_px


def gauss_newton(observed: Baked, prior_mean: np.ndarray, prior_sigma: np.ndarray, steps: int) -> np.ndarray:
    """Calibrates 15 unknowns: u_gps, R_pos left, R_pos right, u_sen, R_sen, three components each, metres and radians.

    **Arguments**: prior_mean, which is also the start, and prior_sigma (15,), the same for all lanes. **Returns**: (15,), or
    (lanes, 15), after `steps` steps; NaN where a normal matrix was not positive definite.
    """
    return prepared_gauss_newton(observed, prior_mean, prior_sigma, steps)()


def prepared_gauss_newton(
    observed: Baked, prior_mean: np.ndarray, prior_sigma: np.ndarray, steps: int
) -> Callable[[], np.ndarray]:
    """`gauss_newton` as a call in which next to nothing but C++ runs: to make the pointers takes as long as to calibrate."""
    value = np.empty((*observed.right.shape[:-1], 15))
    call = _function("gauss_newton", POINTER(_Observations), _doubles, _doubles, c_int, _doubles)
    struct, mean, sigma = observed._struct(), _pointer(prior_mean, (15,)), _pointer(prior_sigma, (15,))
    out = _pointer(value, value.shape)

    def run() -> np.ndarray:
        call(struct, mean, sigma, steps, out)
        return value

    return run
