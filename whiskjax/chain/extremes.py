"""Numbers that no instrument has: finite, but of a size whose squares and products float64 does not hold.

A focal length of 1e300 px is a number, and so is every residual that it makes; the sum of their squares is none.
"""

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..rules import WhiskjaxError, is_traced
from .by import By
from .sensor import Sensor

MOST, _LEAST_FOCAL_PX = 1e30, 1e-30


def refuse_extremes(sensor: Sensor, doing: str) -> None:
    """What is traced is not looked at. **Arguments:** `doing`: what is about to use the sensor, first word of the message.

    **Raises:** `WhiskjaxError` naming the first number of the sensor, and the place where it stands.
    """
    parts = [*zip(sensor.names, sensor.links, strict=True), ("camera", sensor.camera), ("refraction", sensor.refraction)]
    for name, part in parts:
        for place, node in _options(name, part):
            for path, leaf in jax.tree_util.tree_flatten_with_path(node)[0]:
                where = f"{place}{jax.tree_util.keystr(path)}"
                if not is_traced(leaf) and (eqx.is_array(leaf) or isinstance(leaf, float)):
                    _refuse(np.asarray(leaf), where, doing)


def _options(name: str, part: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(part, By):
        for option, node in zip(part.names, part.options, strict=True):
            yield from _options(f"{name}.{option}", node)
    else:
        yield name, part


def _refuse(values: np.ndarray, where: str, doing: str) -> None:
    if values.dtype.kind != "f":
        return
    size = np.abs(values)
    wrong = np.isfinite(size) & (size > MOST)
    if where.endswith("focal_px"):
        wrong |= (size < _LEAST_FOCAL_PX) | np.isinf(size)
    if wrong.any():
        i = tuple(int(k) for k in np.argwhere(wrong)[0])
        index = f"[{', '.join(map(str, i))}]" if i else ""
        raise WhiskjaxError(
            f"{doing}: {where}{index} is {values[i]:g}: no instrument has such a number; look at it and at its unit"
        )
