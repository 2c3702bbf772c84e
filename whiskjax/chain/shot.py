"""What identifies one exposure."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..rules import Arrays, Numbers, WhiskjaxError, is_traced

KEYS = ("image", "swing", "view", "strip")


def _key(arrays: Arrays, name: str, value: Any) -> Any:
    if value is None or type(value) is int:
        return value
    index = arrays.take_whole(name, value, "...")
    if isinstance(value, np.integer):
        return int(value)
    return index if is_traced(index) else jnp.asarray(index, dtype=jnp.int32)


class Shot(eqx.Module):
    """One exposure, or a batch of them: the time, and which image, swing, view and strip it belongs to.

    A key is the index of a name in the order in which the sensor lists it. A Python int says that the whole batch shares it:
    then the choice is made before tracing and costs nothing. None: this instrument does not record it.
    """

    time_s: Float[Array, "..."] | None
    image: Int[Array, "..."] | int | None
    swing: Int[Array, "..."] | int | None
    view: Int[Array, "..."] | int | None
    strip: Int[Array, "..."] | int | None
    poses: tuple[Any, ...]  # filled by bake: poses, or links aligned with the shots that make them

    def __init__(
        self,
        time_s: Float[Numbers, "..."] | None = None,
        image: Int[Numbers, "..."] | None = None,
        swing: Int[Numbers, "..."] | None = None,
        view: Int[Numbers, "..."] | None = None,
        strip: Int[Numbers, "..."] | None = None,
        poses: tuple[Any, ...] = (),
    ):
        """**Raises:** `WhiskjaxError` for a time in float32, a key that is no whole number, shapes that do not broadcast."""
        arrays = Arrays("Shot")
        self.time_s = None if time_s is None else jnp.asarray(arrays.take("time_s", time_s, "...", absolute=True))
        self.image, self.swing = _key(arrays, "image", image), _key(arrays, "swing", swing)
        self.view, self.strip = _key(arrays, "view", view), _key(arrays, "strip", strip)
        self.poses = poses

    def need(self, field: str, why: str) -> Any:
        """The time or a key that somebody cannot do without.

        **Raises:** `WhiskjaxError` naming it, and why, where the shot does not have it.
        """
        value = getattr(self, field)
        if value is None:
            raise WhiskjaxError(f"the shot has no {field}, {why}: Shot({field}=...)")
        return value


def fit_shot(arrays: Arrays, shot: Shot, shape: str = "...") -> None:
    """Whether time and keys fit the other arguments of somebody; one number fits all of them.

    No method: equinox makes a module of each method that is asked for, which costs a door more than its check.

    **Raises:** `WhiskjaxError` naming the field.
    """
    for name in ("time_s", *KEYS):
        if (found := getattr(getattr(shot, name), "shape", ())) != ():
            arrays.fit(f"shot.{name}", found, shape)
