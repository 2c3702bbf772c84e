"""Errors of recorded poses that are new at every look: white noise of a frame, carried into the image by the chain."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np

from ..algebra.vectors import Component, Vec2, Vec3, add, is_structural, mul
from ..chain.joints import JointDerivatives
from ..chain.pose import Motion
from ..chain.sensor import Sensor
from ..chain.turn import as_parameter
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced, need
from ..rules.spread import refuse_sigmas


def _sigmas(arrays: Arrays, name: str, values: Any, within_rad: float | None = None) -> Vec3:
    """Three components; what is exactly zero stays structural and costs nothing."""
    several = isinstance(values, tuple | list) or getattr(values, "ndim", 0) > 0
    if not several or len(values) != 3:
        arrays.refuse(name, f"is {values!r}; a sigma about or along each of three axes is needed")
    taken = tuple(arrays.take(name, v, "...", finite=True, least=0.0, within_rad=within_rad) for v in values)
    return tuple(0 if not is_traced(v) and np.ndim(v) == 0 and v == 0 else as_parameter(v) for v in taken)


class FrameNoise(eqx.Module):
    """How well the recorded pose of a frame is known at each look, independent from look to look and of other frames.

    A gyro's or an encoder's jitter turns the frame, a position error shifts it; both about and along the frame's own axes.

    **Arguments:**

    - `frame`: its name in the sensor.
    - `turn_sigma_rad`: 1-sigma about the frame's x, y, z; numbers, or arrays (looks,).
    - `shift_sigma_m`: 1-sigma along them.
    """

    frame: str = eqx.field(static=True)
    turn_sigma_rad: Vec3
    shift_sigma_m: Vec3

    def __init__(
        self,
        frame: str,
        turn_sigma_rad: Sequence[Numbers] | Numbers = (0, 0, 0),
        shift_sigma_m: Sequence[Numbers] | Numbers = (0, 0, 0),
    ):
        """**Raises:** `WhiskjaxError` where there are not three sigmas of each, or one is negative, not finite or in degrees."""
        need("FrameNoise", "frame", frame, str)
        arrays = Arrays("FrameNoise")
        self.frame = frame
        self.turn_sigma_rad = _sigmas(arrays, "turn_sigma_rad", turn_sigma_rad, within_rad=2 * np.pi)
        self.shift_sigma_m = _sigmas(arrays, "shift_sigma_m", shift_sigma_m)

    def check(self, sensor: Sensor) -> None:
        """**Raises:** `WhiskjaxError` where the sensor has no such frame, or a sigma is none that anything can be weighed by."""
        if self.frame not in sensor.names:
            raise WhiskjaxError(f"no frame named {self.frame!r}; there are {', '.join(sensor.names)}")
        for kind, sigmas in (("turn_sigma_rad", self.turn_sigma_rad), ("shift_sigma_m", self.shift_sigma_m)):
            for sigma in sigmas:
                if not is_traced(sigma):
                    refuse_sigmas(np.atleast_1d(sigma), lambda _, kind=kind: f"noise of {self.frame}: {kind}", zero=True)


_AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def variance_px2(noise: tuple[FrameNoise, ...], swept: JointDerivatives) -> Vec3:
    """What all frames' noise adds to the covariance (r00, r01, r11) of a pixel: the sum of sigma^2 g g^T over the small motions.

    One variance for each recorded quantity at its own joint; gathering them into one 6x6 would cost twice as much.
    """
    total: Vec3 = (0, 0, 0)
    for frame in noise:
        for kind, sigmas in (("turn", frame.turn_sigma_rad), ("shift", frame.shift_sigma_m)):
            for sigma, axis in zip(sigmas, _AXES, strict=True):
                if not is_structural(sigma, 0):
                    moved = swept.follows(frame.frame, Motion(**{kind: axis}))
                    total = tuple(add(t, o) for t, o in zip(total, _outer(sigma, moved), strict=True))
    return total


def _outer(sigma: Component, moved: Vec2) -> Vec3:
    x, y = (mul(sigma, c) for c in moved)
    return mul(x, x), mul(x, y), mul(y, y)
