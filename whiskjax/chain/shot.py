"""What identifies one exposure."""

from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..rules import WhiskjaxError, is_traced

KEYS = ("image", "swing", "view", "strip")


def _time(value: Any) -> Any:
    return value if value is None or is_traced(value) else jnp.asarray(value, dtype=float)


def _key(name: str, value: Any) -> Any:
    if value is None or isinstance(value, int) or is_traced(value):
        return value
    if isinstance(value, np.integer):
        return int(value)
    if np.asarray(value).dtype.kind not in "iu":
        raise WhiskjaxError(f"the {name} of a shot is an index, a whole number, not {value!r}")
    return jnp.asarray(value, dtype=jnp.int32)


class Shot(eqx.Module):
    """One exposure, or a batch of them: the time, and which image, swing, view and strip it belongs to.

    A key is the index of a name in the order in which the sensor lists it. A Python int says that the whole batch shares it:
    then the choice is made before tracing and costs nothing. None: this instrument does not record it.
    """

    time_s: Float[Array, "..."] | None = eqx.field(default=None, converter=_time)
    image: Int[Array, "..."] | int | None = eqx.field(default=None, converter=partial(_key, "image"))
    swing: Int[Array, "..."] | int | None = eqx.field(default=None, converter=partial(_key, "swing"))
    view: Int[Array, "..."] | int | None = eqx.field(default=None, converter=partial(_key, "view"))
    strip: Int[Array, "..."] | int | None = eqx.field(default=None, converter=partial(_key, "strip"))
    poses: tuple[Any, ...] = ()  # filled by bake: poses, or links aligned with the shots that make them

    def need(self, field: str, why: str) -> Any:
        """The time or a key that somebody cannot do without.

        **Raises:** `WhiskjaxError` naming it, and why, where the shot does not have it.
        """
        value = getattr(self, field)
        if value is None:
            raise WhiskjaxError(f"the shot has no {field}, {why}: Shot({field}=...)")
        return value
