"""The filter of location.cpp by filterpy: a Python loop over runs and looks. The target stands still: no prediction is needed."""

from collections.abc import Callable
from math import cos, sin

import numpy as np

from . import MissingPeer
from .location import FOCAL_PX, Located, Recorded, Sigmas, Start
from .numpy_location import angles, camera_from_ecef, look_at, noise, platform

try:
    from filterpy.kalman import ExtendedKalmanFilter
except ModuleNotFoundError as error:
    raise MissingPeer("filterpy is not installed: pip install 'whiskjax[bench]'") from error


def prepared(recorded: Recorded, start: Start, sigmas: Sigmas, full: bool) -> Callable[[], Located]:
    """The filter as a call."""
    numbers = np.moveaxis(recorded.numbers(), 0, -1)
    registration = sigmas.pixel_px**2 * np.eye(2)
    guess = start.guess_ecef_m.tolist()

    def run() -> Located:
        found = [one(looks) for looks in numbers.tolist()]
        return np.array([x for x, _ in found]), np.array([P for _, P in found])

    def one(looks: list[list[float]]) -> Located:
        ekf = ExtendedKalmanFilter(dim_x=3, dim_z=2)
        ekf.x, ekf.P = np.zeros(3), start.covariance_m2
        for look in looks:
            *turns, beta = [(sin(angle), cos(angle)) for angle in angles(look)]
            rows = camera_from_ecef(*turns)
            position = platform(turns[0], turns[1], look[2])
            # The filter asks for the derivatives, the noise and the pixel at the same state: computed once.
            a, b, per_m, hm, hn = look_at(rows, [x - (p - g) for x, p, g in zip(ekf.x.tolist(), position, guess, strict=True)])
            R = registration
            if full:
                mm, mn, nn = noise(sigmas, turns[4], beta, a, b, per_m)
                R = np.array([[mm, mn], [mn, nn]])
            H, h = np.array([hm, hn]), np.array([FOCAL_PX * a, FOCAL_PX * b])
            ekf.update(np.array(look[8:]), HJacobian=lambda _, H=H: H, Hx=lambda _, h=h: h, R=R)
        return ekf.x, ekf.P

    return run
