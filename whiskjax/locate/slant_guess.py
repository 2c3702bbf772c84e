"""Where the filter starts when nobody says how far off that may be: how slant the first look is tells it."""

import numpy as np

from ..algebra.vectors import unstack
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface
from .guess import Guess, first_guess
from .looks import Looks

_SIGMA_UP_M = 1500.0  # Liu et al. (2019), equation 19 ...
_SHARE_OF_HEIGHT = 1 / 3  # ... or of the platform's height above the guess, if that is less
_LEAST_SLANT = 0.2


def slant_guess(sensor: Sensor, looks: Looks, surface: AbstractSurface) -> tuple[Guess, float]:
    """Where the first look that has a measurement meets a surface, with sigmas that follow from how slant that look is.

    A height that is wrong by one sigma moves the place by that times the tangent of the angle between the ray and the vertical.

    **Returns:** the guess, and that angle in radians.

    **Raises:** as `first_guess`.
    """
    point = first_guess(sensor, looks, surface, np.ones(3)).point_m
    first = int(np.argmin(np.asarray(looks.is_missed)))
    platform = [np.broadcast_to(np.asarray(c), len(looks))[first] for c in sensor.pose(looks.shot).translation]
    away = np.array(platform) - np.asarray(point)
    up = np.array([float(row[2]) for row in surface.level(unstack(point))])
    rise = float(abs(away @ up))
    slant = float(np.linalg.norm(away - (away @ up) * up)) / rise
    sigma_up = min(_SIGMA_UP_M, _SHARE_OF_HEIGHT * rise)
    # Two digits are enough for what is known so badly.
    across, sigma_up = (float(f"{s:.2g}") for s in (sigma_up * max(slant, _LEAST_SLANT), sigma_up))
    return Guess.around(point, np.array([across, across, sigma_up])), float(np.arctan(slant))
