"""When a point crosses the detector line.

Of a line camera the measured line is a time, and its error is one of time: the chain is evaluated at a moment that carries the
noise. Least squares then takes the noise for geometry, because a change of scale makes all line offsets smaller (errors in
variables): for songshan's lens scale and vertical lever arm that is a bias of several sigmas. The remedy is to evaluate every ray
when the *fitted* point crosses the line, a moment that is uncorrelated with the residual, and to keep the measurement as
the offset that it has there.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...algebra.vectors import unstack
from ...chain.image_scale import image_scale, scale_of_each
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...rules import SensorError, arrays_of, is_traced
from ...rules.results import codes_of, message_of
from ...rules.sizes import filled
from .block import Block


def at_crossing(sensor: Sensor, block: Block, point_m: Float[Any, "points 3"]) -> Block:
    """The same measurements, each at the time when the given point is imaged on its line.

    A ray measured at line offset m and time t becomes one at the crossing t0 with offset m + rate (t0 - t); rays whose crossing
    lies outside the recorded trajectory keep their time.

    **Arguments:** `sensor`: of line cameras, at the solution; `point_m`: of every point that is seen.
    """
    time, traced = block.key("time_s"), arrays_of((sensor, block, point_m)) is jnp
    if traced:
        found = jax.lax.stop_gradient(image_scale(sensor, block.shots(), unstack(jnp.asarray(point_m)[block.point])))
    else:
        found = scale_of_each(sensor, block.shots(), point_m[block.point])
    math = jnp if traced else np
    assert found.px_per_s is not None  # of line cameras
    offset, rate = found.pixel[1], found.px_per_s[1]
    moved = -offset / math.where(rate == 0, math.inf, rate)
    codes = _codes(sensor, dataclasses.replace(block, time_s=time + moved))
    crossing = time + math.where(codes == 0, moved, 0.0)
    if traced:
        crossing = jax.lax.stop_gradient(crossing)
    pixel = block.pixel_px + math.stack([math.zeros_like(rate), rate * (crossing - time)], axis=-1)
    return dataclasses.replace(block, time_s=crossing, pixel_px=pixel)


def refuse_unrecorded(sensor: Sensor, block: Block) -> None:
    """**Raises:** `SensorError` naming the first ray at whose time, or for whose keys, the sensor knows no pose."""
    codes = _codes(sensor, block)
    if codes.any():
        i = int(np.argmax(codes != 0))
        more = f" ({int((codes != 0).sum())} of {len(codes)} rays fail)" if (codes != 0).sum() > 1 else ""
        raise SensorError(f"{block.ray_label(i)}: {message_of(int(codes[i]))}{more}")


def _codes(sensor: Sensor, block: Block) -> Any:
    if is_traced(block.time_s) or any(map(is_traced, jax.tree.leaves(sensor))):
        return jnp.broadcast_to(jax.tree.leaves(_check(sensor, block.shots()))[0], (len(block),))
    rays = filled(len(block))
    return np.broadcast_to(codes_of(_check(sensor, block.shots(rays))), rays.shape)[: len(block)]


@eqx.filter_jit
def _check(sensor: Sensor, shot: Shot):
    return sensor.check(shot)
