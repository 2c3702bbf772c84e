"""Whether measured pixels can be measurements: on the detector, and where the camera has a direction for them.

A sample and a line that were exchanged, or -9999 for "not measured", are numbers like others, and would be adjusted like them.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..algebra.vectors import unstack
from ..rules import RESULTS, SensorError, first_failure, is_traced
from ..rules.results import failure_if, message_of
from .sensor import Sensor
from .shot import Shot

# Of the detector's length: marks at the rim of an image, and what noise does to them, are measurements.
_BEYOND = 0.05


@eqx.filter_jit
def _codes(sensor: Sensor, shot: Shot, pixel_px: Float[Array, "n 2"]) -> Int[Array, " n"]:
    camera, pixel = sensor.camera_at(shot), unstack(pixel_px)
    limits = camera.limits()
    beside = jnp.zeros(pixel[0].shape, dtype=bool)
    for number, low, high in zip(pixel, limits[::2], limits[1::2], strict=False):
        slack = _BEYOND * (high - low)
        beside = beside | (number < low - slack) | (number > high + slack)
    result = first_failure(failure_if(beside, RESULTS.beside_detector), camera.check_pixel(pixel))
    return jnp.where(jnp.isnan(pixel[0] + pixel[1]), 0, jax.tree.leaves(result)[0])


def refuse_impossible_pixels(
    doing: str, sensor: Sensor, shot: Shot, pixel_px: Float[Array, "n 2"] | Float[np.ndarray, "n 2"], label: Callable[[int], str]
) -> None:
    """Pixels that are not a number (looks without a measurement) are left alone, and so is what is traced.

    **Arguments:** `doing`: what is about to use them, first word of the message; `label`: what the i-th of them is called.

    **Raises:** `SensorError` naming the first measurement that the camera cannot have made, and how many there are.
    """
    if any(map(is_traced, jax.tree.leaves((sensor, shot, pixel_px)))):
        return
    code = np.asarray(_codes(sensor, shot, jnp.asarray(pixel_px)))
    if code.any():
        i, count = int(np.argmax(code != 0)), int((code != 0).sum())
        place = ", ".join(f"{v:.6g}" for v in np.asarray(pixel_px)[i])
        more = f" ({count} of {len(code)} measurements fail)" if count > 1 else ""
        raise SensorError(f"{doing}: {label(i)}, measured at ({place}) px: {message_of(int(code[i]))}{more}")
