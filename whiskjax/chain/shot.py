"""What identifies one exposure."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..rules import is_traced
from .pose import Pose

KEYS = ("image", "swing", "view", "strip")


def _time(value: Any) -> Any:
    return value if value is None or is_traced(value) else jnp.asarray(value, dtype=float)


def _key(value: Any) -> Any:
    if value is None or isinstance(value, int) or is_traced(value):
        return value
    if isinstance(value, np.integer):
        return int(value)
    return jnp.asarray(value, dtype=jnp.int32)


class Shot(eqx.Module):
    """One exposure, or a batch of them: the time, and which image, swing, view and strip it belongs to.

    A key is the index of a name in the order in which the sensor lists it. A Python int says that the whole batch shares it:
    then the choice is made before tracing and costs nothing. None: this instrument does not record it.
    """

    time_s: Float[Array, "..."] | None = eqx.field(default=None, converter=_time)
    image: Int[Array, "..."] | int | None = eqx.field(default=None, converter=_key)
    swing: Int[Array, "..."] | int | None = eqx.field(default=None, converter=_key)
    view: Int[Array, "..."] | int | None = eqx.field(default=None, converter=_key)
    strip: Int[Array, "..."] | int | None = eqx.field(default=None, converter=_key)
    poses: tuple[Pose, ...] = ()  # filled by bake
