"""Whether measured pixels can be measurements: on the detector, and where the camera has a direction for them.

A sample and a line that were exchanged, or -9999 for "not measured", are numbers like others, and are adjusted like them.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..algebra.vectors import Vec2, unstack
from ..rules import SensorError, plain
from ..rules.results import message_of
from .camera import AbstractCamera
from .sensor import Sensor
from .shot import Shot

# Of the detector's length: marks at the rim of an image, and what noise does to them, are measurements.
_BEYOND = 0.05


def is_beside(camera: AbstractCamera, pixel: Vec2) -> Bool[Array, "..."]:
    """Whether a pixel lies beside the detector by more than a twentieth of its length; not where that is not known."""
    beside, limits = jnp.zeros(pixel[0].shape, dtype=bool), camera.limits() or ()
    for number, low, high in zip(pixel, limits[::2], limits[1::2], strict=False):
        slack = _BEYOND * (high - low)
        beside = beside | (number < low - slack) | (number > high + slack)
    return beside


@eqx.filter_jit
def _beside(sensor: Sensor, shot: Shot, pixel_px: Float[Any, "n 2"]) -> Bool[Array, " n"]:
    return is_beside(sensor.camera_at(shot), unstack(pixel_px))


@eqx.filter_jit
def _codes(sensor: Sensor, shot: Shot, pixel_px: Float[Any, "n 2"]) -> Int[Array, " n"]:
    result = sensor.camera_at(shot).check_pixel(unstack(pixel_px))
    return jax.tree.leaves(result)[0] + jnp.zeros(pixel_px.shape[0], dtype=jnp.int32)


def lies_beside(sensor: Sensor, shot: Shot, pixel_px: Float[Any, "n 2"]) -> Bool[Any, " n"]:
    """Measurements that lie far beside the detector; traceable."""
    return plain(_beside(sensor, shot, plain(pixel_px)))


def refuse_pixels_without_direction(
    doing: str, sensor: Sensor, shot: Shot, pixel_px: Float[np.ndarray, "n 2"], label: Callable[[int], str]
) -> None:
    """**Arguments:** `doing`: what is about to use them, first word of the message; `label`: what the i-th of them is called.

    **Raises:** `SensorError` naming the first measurement that has no line of sight, and how many there are.
    """
    code = np.asarray(_codes(sensor, shot, np.asarray(pixel_px)))
    if code.any():
        i, count = int(np.argmax(code != 0)), int((code != 0).sum())
        place = ", ".join(f"{v:.6g}" for v in np.asarray(pixel_px)[i])
        more = f" ({count} of {len(code)} measurements fail)" if count > 1 else ""
        raise SensorError(f"{doing}: {label(i)}, measured at ({place}) px: {message_of(int(code[i]))}{more}")
