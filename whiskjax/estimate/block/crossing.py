"""When a point crosses the detector line.

Of a line camera the measured line is a time, and its error is one of time: the chain is evaluated at a moment that carries the
noise. Least squares then takes the noise for geometry, because a change of scale makes all line offsets smaller (errors in
variables): for songshan's lens scale and vertical lever arm that is a bias of several sigmas. The remedy is to evaluate every ray
when the *fitted* point crosses the line, a moment that is uncorrelated with the residual, and to keep the measurement as
the offset that it has there.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...chain.image_scale import scale_of_each
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...rules import SensorError
from ...rules.results import codes_of, message_of
from ...rules.sizes import filled
from .block import Block


def at_crossing(sensor: Sensor, block: Block, point_m: Float[np.ndarray, "points 3"]) -> Block:
    """The same measurements, each at the time when the given point is imaged on its line.

    A ray measured at line offset m and time t becomes one at the crossing t0 with offset m + rate (t0 - t); rays whose crossing
    lies outside the recorded trajectory keep their time.

    **Arguments:** `sensor`: of line cameras, at the solution; `point_m`: of every point that is seen.
    """
    time = np.asarray(block.key("time_s"), dtype=float)
    found = scale_of_each(sensor, block.shots(), point_m[block.point])
    assert found.px_per_s is not None  # of line cameras
    offset, rate = found.pixel[1], found.px_per_s[1]
    moved = -offset / np.where(rate == 0, np.inf, rate)
    shot = dataclasses.replace(block.shots(), time_s=time + moved)
    moved = np.where(_codes(sensor, dataclasses.replace(block, shot=shot)) == 0, moved, 0.0)
    pixel = block.pixel_px + np.stack([np.zeros_like(moved), rate * moved], axis=-1)
    return dataclasses.replace(block, shot=dataclasses.replace(shot, time_s=jnp.asarray(time + moved)), pixel_px=pixel)


def refuse_unrecorded(sensor: Sensor, block: Block) -> None:
    """**Raises:** `SensorError` naming the first ray at whose time, or for whose keys, the sensor knows no pose."""
    codes = _codes(sensor, block)
    if codes.any():
        i = int(np.argmax(codes != 0))
        more = f" ({int((codes != 0).sum())} of {len(codes)} rays fail)" if (codes != 0).sum() > 1 else ""
        raise SensorError(f"{block.ray_label(i)}: {message_of(int(codes[i]))}{more}")


def _codes(sensor: Sensor, block: Block) -> np.ndarray:
    rays = filled(len(block))
    return np.broadcast_to(codes_of(_check(sensor, block.shots(rays))), rays.shape)[: len(block)]


@eqx.filter_jit
def _check(sensor: Sensor, shot: Shot):
    return sensor.check(shot)
