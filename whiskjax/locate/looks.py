"""What was measured: where one target was seen, look after look."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..chain.shot import Shot
from ..rules import WhiskjaxError, is_traced, require_x64


def _pixels(value: Any) -> Any:
    return value if is_traced(value) else jnp.asarray(value, dtype=jnp.float64)


class Looks(eqx.Module):
    """Image measurements of one target, in the order of time.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `shot`: time and keys of each look, (looks,).
    - `pixel_px`: measured (sample, line offset) or (column, row), (looks, 2). NaN is a look without a measurement: it is counted
      as missed and changes nothing.
    - `sigma_px`: 1-sigma of the measurement, (2,) or (looks, 2).

    **Raises:** `WhiskjaxError` where there is no look, shapes do not fit, a sigma is not positive, or times run backwards.
    """

    shot: Shot
    pixel_px: Float[Array, "looks 2"] = eqx.field(converter=_pixels)
    sigma_px: Float[Array, "*looks 2"] = eqx.field(converter=_pixels)

    def __check_init__(self):
        require_x64("Looks")
        pixel, sigma, time = self.pixel_px, self.sigma_px, self.shot.time_s
        if pixel.ndim != 2 or pixel.shape[1] != 2:
            raise WhiskjaxError(f"looks: pixel_px has shape {pixel.shape}, expected (looks, 2)")
        if len(pixel) == 0:
            raise WhiskjaxError("looks: there is none; one look gives a line, two from different places a point")
        if sigma.shape not in ((2,), pixel.shape):
            raise WhiskjaxError(f"looks: sigma_px has shape {sigma.shape}, expected (2,) or {pixel.shape}")
        if time is not None and time.shape != pixel.shape[:1]:
            raise WhiskjaxError(f"looks: {time.shape} times for {len(pixel)} pixels")
        if not is_traced(pixel) and np.isinf(np.asarray(pixel)).any():
            raise WhiskjaxError(f"looks: the pixel of look {int(np.argwhere(np.isinf(np.asarray(pixel)))[0, 0])} is infinite")
        if not is_traced(sigma) and not (np.asarray(sigma) > 0).all():
            raise WhiskjaxError("looks: sigma_px must be positive")
        if time is not None and not is_traced(time):
            _check_order(np.asarray(time))

    def __len__(self) -> int:
        return self.pixel_px.shape[0]

    @property
    def is_missed(self) -> Bool[Array, " looks"]:
        """Looks without a measurement."""
        return jnp.isnan(self.pixel_px).any(axis=-1)


def _check_order(time_s: Float[np.ndarray, " looks"]) -> None:
    if not np.isfinite(time_s).all():
        raise WhiskjaxError(f"looks: the time of look {int(np.argmin(np.isfinite(time_s)))} is not a finite number")
    back = np.flatnonzero(np.diff(time_s) < 0)
    if len(back):
        i = int(back[0])
        raise WhiskjaxError(
            f"looks: a filter follows the time, but look {i + 1} ({time_s[i + 1]!r} s) is earlier than look {i} "
            f"({time_s[i]!r} s); sort them, shots and pixels alike"
        )
