"""Where an adjustment begins: poses, and points from their rays."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...chain.sensor import Sensor
from ...rules import SensorError, arrays_of, is_traced
from ...rules.results import codes_of, message_of
from ..intersection import intersect
from .block import Block
from .connect import seen_once
from .derivative import held
from .prepare import prepare
from .solve import gauss_newton
from .station_errors import StationErrors
from .wrong_image import wrong_image


def begin(sensor: Sensor, block: Block, motions: StationErrors | None) -> tuple[Sensor, Float[Any, "points 3"]]:
    """A sensor and the approximate coordinates of every point that is seen.

    Control points lie where they are given; all others where their rays meet, and nowhere (NaN) with one ray. Without POS the
    poses may be far off: then the images are first resected from their control points.

    Traced, it is where the iteration begins, and nothing follows it.

    **Raises:** `SensorError` naming the image whose rays are wrong, or else the first point whose rays do not meet.
    """
    control = block.role == "control"
    math = arrays_of((sensor, block))
    point = math.where(control[:, None], block.position_m, math.nan)
    if motions is not None and not motions.observed and control[block.point].any():
        sensor = _resect(sensor, block.keep(control[block.point]), motions)
    rays = np.flatnonzero(~(control | seen_once(block))[block.point])
    if rays.size:
        others = block.keep(rays)
        seen, index = np.unique(others.point, return_inverse=True)
        met = intersect(sensor, others.shot, others.pixel_px, index, others.sigma_px, throw=False)
        if is_traced(met.point_m):  # by whatever of it: what is constant in a traced function is, too
            return sensor, jnp.asarray(point).at[seen].set(met.point_m)
        codes = codes_of(met.result)
        if codes.any():
            parted = np.zeros(len(block.role), dtype=bool)
            parted[seen[codes != 0]] = True
            if (wrong := wrong_image(sensor, others, parted)) is not None:
                raise SensorError(f"adjust: {wrong.text}")
            i = int(np.argmax(codes != 0))
            more = f" ({int((codes != 0).sum())} of {len(seen)} points fail)" if (codes != 0).sum() > 1 else ""
            raise SensorError(f"{block.point_label(int(seen[i]))}: its rays do not meet: {_why(int(codes[i]))}{more}")
        point[seen] = np.asarray(met.point_m)
    return sensor, point


def _resect(sensor: Sensor, seen: Block, motions: StationErrors) -> Sensor:
    """The poses from control points alone, held where nothing is seen by the sigmas that the start has."""
    prepared = prepare(sensor, seen, (), motions.known(), seen.position_m)
    solved = gauss_newton(held(prepared.ready), held(prepared.start))
    return prepared.ready.unknowns.put(prepared.ready.sensor, solved.state.x, solved.state.u)


def _why(code: int) -> str:
    """Rank deficient means parallel here."""
    message = message_of(code)
    return "they are parallel, or nearly so; leave the point out" if "do not determine" in message else message
