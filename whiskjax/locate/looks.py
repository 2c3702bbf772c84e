"""What was measured: where one target was seen, look after look."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..chain.shot import KEYS, Shot, fit_shot
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced, need, require_x64
from ..rules.spread import refuse_sigmas, refuse_sizes


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
    pixel_px: Float[Array, "looks 2"] = eqx.field(converter=jnp.asarray)
    sigma_px: Float[Array, "*looks 2"] = eqx.field(converter=jnp.asarray)

    def __init__(self, shot: Shot, pixel_px: Float[Numbers, "looks 2"], sigma_px: Float[Numbers, "*looks 2"]):
        require_x64("Looks")
        need("Looks", "shot", shot, Shot, "Shot(time_s=...)")
        arrays = Arrays("Looks")
        self.shot, self.pixel_px = shot, arrays.take("pixel_px", pixel_px, "looks 2")
        shape = "2" if np.ndim(sigma_px) < 2 else "looks 2"
        self.sigma_px = arrays.take("sigma_px", sigma_px, shape, finite=True, above=0.0, meaning="or one pair for each look")
        fit_shot(arrays, shot, "looks")

    def __check_init__(self):
        pixel, sigma, time = self.pixel_px, self.sigma_px, self.shot.time_s
        if len(pixel) == 0:
            raise WhiskjaxError("looks: there is none; one look gives a line, two from different places a point")
        if time is not None:
            Arrays("Looks").fit("shot.time_s", time.shape, str(len(pixel)))
        if not is_traced(pixel) and np.isinf(np.asarray(pixel)).any():
            raise WhiskjaxError(f"looks: the pixel of look {int(np.argwhere(np.isinf(np.asarray(pixel)))[0, 0])} is infinite")
        if not is_traced(pixel):
            refuse_sizes(np.asarray(pixel), lambda i: f"looks: the pixel of look {i}")
        if not is_traced(sigma):
            each = sigma.ndim == 2
            refuse_sigmas(np.atleast_2d(np.asarray(sigma)), lambda i: f"looks: sigma_px{f' of look {i}' if each else ''}")
        if time is not None and not is_traced(time):
            _check_order(np.asarray(time))

    def __len__(self) -> int:
        return self.pixel_px.shape[0]

    @property
    def is_missed(self) -> Bool[Array, " looks"]:
        """Looks without a measurement."""
        return jnp.isnan(self.pixel_px).any(axis=-1)

    def repeats(self) -> Bool[Array, " looks"] | None:
        """Looks that repeat an earlier one to the last digit: its time, its keys and its pixel. None where no two can be one.

        They are counted once. Looks of one moment share all errors of its pose, and a pixel that comes out the same is the same
        reading: by counting it again sigmas would become smaller, and nothing be known better. Without times a pixel alone does
        not tell looks apart. Near-copies stay, and fail the answer: which of them is the measurement nobody can say.
        """
        time, pixel = self.shot.time_s, self.pixel_px
        if time is None or (not is_traced(time) and (np.diff(np.asarray(time)) > 0).all()):
            return None
        keys = [getattr(self.shot, key) for key in KEYS if getattr(self.shot, key) is not None]
        told = jnp.stack([jnp.broadcast_to(jnp.asarray(c, float), time.shape) for c in (*pixel.T, *keys, time)])
        order = jnp.lexsort(jax.lax.stop_gradient(told))  # which keeps the order of equal ones
        same = (told[:, order[1:]] == told[:, order[:-1]]).all(axis=0)
        return jnp.zeros(len(self), dtype=bool).at[order[1:]].set(same)


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
