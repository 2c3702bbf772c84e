"""When each line of an image was exposed."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..rules import Arrays, WhiskjaxError, require_x64


class LineTimes(eqx.Module):
    """Line numbers and their times, both strictly increasing, linear in between; times outside give NaN, never a guess."""

    line: Float[Array, " k"]
    time_s: Float[Array, " k"]

    def __init__(self, line: Any, time_s: Any, image: str = "LineTimes"):
        """**Raises:** `WhiskjaxError` where lines or times do not increase; `image` is named in the message."""
        require_x64("LineTimes")
        arrays = Arrays(image)
        line = np.asarray(arrays.take("line", line, "lines", absolute=True, finite=True))
        time = np.asarray(arrays.take("time_s", time_s, "lines", absolute=True, finite=True))
        if len(line) < 2:
            arrays.refuse("line", f"has shape {line.shape}; at least two lines with their times are needed")
        for name, value in (("lines", line), ("times", time)):
            if not (np.diff(value) > 0).all():
                raise WhiskjaxError(f"{image}: the {name} of its line table must increase")
        self.line, self.time_s = jnp.asarray(line), jnp.asarray(time)

    def time_at(self, line: Float[Array, "..."]) -> Float[Array, "..."]:
        """Time in seconds when a line was exposed."""
        line = Arrays("LineTimes.time_at").take("line", line, "...")
        return jnp.interp(line, self.line, self.time_s, left=jnp.nan, right=jnp.nan)

    def line_at(self, time_s: Float[Array, "..."]) -> Float[Array, "..."]:
        """Line that was exposed at a time."""
        time_s = Arrays("LineTimes.line_at").take("time_s", time_s, "...", absolute=True)
        return jnp.interp(time_s, self.time_s, self.line, left=jnp.nan, right=jnp.nan)

    def s_per_line(self, line: Float[ArrayLike, "..."]) -> Float[Array, "..."] | Float[np.ndarray, "..."]:
        """How long a line takes, in seconds: the slope of the table at a line; at a knot that of the lines after it.

        Numpy arrays give numpy arrays, for which nothing is compiled.
        """
        xp = np if isinstance(line, np.ndarray) else jnp
        line = Arrays("LineTimes.s_per_line").take("line", line, "...")
        lines, time = xp.asarray(self.line), xp.asarray(self.time_s)
        last = xp.clip(xp.searchsorted(lines, xp.asarray(line), side="right"), 1, len(lines) - 1)
        known = (line >= lines[0]) & (line <= lines[-1])
        return xp.where(known, (time[last] - time[last - 1]) / (lines[last] - lines[last - 1]), xp.nan)

    @property
    def window_s(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and last time: what `ground_to_image` searches."""
        return self.time_s[0], self.time_s[-1]
