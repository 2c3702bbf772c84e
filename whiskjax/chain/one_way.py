"""Whether the detector line sweeps over the ground one way: then a point crosses it once, and two ends of a window enclose it.

A point at the distance r from the camera, imaged on the line, leaves it at the rate a + b / r: a by the turning of the camera,
b by its way. Where that has one sign for both ends of the detector behind every recorded sample of the window, and the camera
turns by less than half a turn in it, the line goes over no point twice. It costs one look at each sample, however many points
there are.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Vec3, apply, cross, matmul, norm, scale, transpose
from ..rules.results import is_successful
from .sensor import Sensor
from .shot import Shot

# Samples looked at in one go; how clear the sign of a rate must be, for what lies between the samples and between the detector's
# ends; and where in an interval it is looked at: behind its first sample, by more than rounding.
_CHUNK, _CLEAR, _BEHIND = 128, 0.05, 1e-3


class Sweeping(NamedTuple):
    """Between which distances the miss rises for every point on the line, and between which it falls; the greatest rates."""

    rises_m: tuple[Component, Component]
    falls_m: tuple[Component, Component]
    turn_radps: Component
    speed_mps: Component

    def goes_one_way(self, distance_m: Component, window_s: Component) -> Bool[Array, "..."]:
        """Whether the line does, over points at a distance from where the camera is at some time of the window."""
        way = self.speed_mps * window_s
        rises, falls = ((distance_m - way > low) & (distance_m + way < high) for low, high in (self.rises_m, self.falls_m))
        return (rises | falls) & (self.turn_radps * window_s < jnp.pi)

    @property
    def is_possible(self) -> Bool[Array, "..."]:
        """Whether there are such distances."""
        return (self.rises_m[0] < self.rises_m[1]) | (self.falls_m[0] < self.falls_m[1])

    def narrowed(self, other: "Sweeping") -> "Sweeping":
        """What holds for both."""
        rises, falls = (
            (jnp.maximum(a[0], b[0]), jnp.minimum(a[1], b[1]))
            for a, b in ((self.rises_m, other.rises_m), (self.falls_m, other.falls_m))
        )
        turn = jnp.maximum(self.turn_radps, other.turn_radps)
        return Sweeping(rises, falls, turn, jnp.maximum(self.speed_mps, other.speed_mps))


def sweeping(sensor: Sensor, shot: Shot, start_s: Component, stop_s: Component) -> Sweeping:
    """Look at every recorded sample between two times, each (); of the batch shape of sensor and shot.

    The camera is one whose detector has `ends`. What is not recorded at some time says nothing.
    """
    records = sensor.moves(shot).recorded
    ends = [[record.knots.locate(t + record.delay_s)[0] for record in records] for t in (start_s, stop_s)]
    first, last = (jnp.stack([*places, jnp.zeros((), dtype=jnp.int32)]) for places in ends)
    after = jnp.cumsum(last + 1 - first)  # the samples of all records, numbered through

    def time_of(k: Component) -> Component:
        """The time just behind a sample, or the start of the window where there is none."""
        t = start_s
        for i, record in enumerate(records):
            place = jnp.minimum(first[i] + k - (after[i - 1] if i else 0), last[i])
            sample, following = record.knots.time_s[place], record.knots.time_s[place + 1]
            is_here = (k < after[i]) & (k >= (after[i - 1] if i else 0))
            t = jnp.where(is_here, sample + _BEHIND * (following - sample) - record.delay_s, t)
        return jnp.clip(t, start_s, stop_s)

    def look(k: Component) -> Sweeping:
        return _at_once(sensor, dataclasses.replace(shot, time_s=time_of(k)))

    def goes_on(state: tuple[Component, Sweeping]) -> Bool[Array, ""]:
        k, seen = state
        return (k < after[-1]) & jnp.any(seen.is_possible)

    def chunk(state: tuple[Component, Sweeping]) -> tuple[Component, Sweeping]:
        k, seen = state
        found = jax.vmap(look)(k + jnp.arange(_CHUNK, dtype=jnp.int32))
        rises, falls = ((jnp.max(low, axis=0), jnp.min(high, axis=0)) for low, high in (found.rises_m, found.falls_m))
        greatest = jnp.max(found.turn_radps, axis=0), jnp.max(found.speed_mps, axis=0)
        return k + _CHUNK, seen.narrowed(Sweeping(rises, falls, *greatest))

    zero = jnp.zeros(jax.eval_shape(look, jnp.zeros((), dtype=jnp.int32)).turn_radps.shape)
    everywhere = zero, zero + jnp.inf
    unknown = Sweeping(everywhere, everywhere, zero, zero)
    return jax.lax.while_loop(goes_on, chunk, (jnp.zeros((), dtype=jnp.int32), unknown))[1]


def _at_once(sensor: Sensor, shot: Shot) -> Sweeping:
    """At one moment."""
    camera, recorded = sensor.camera_at(shot), is_successful(sensor.check(shot))
    turn, motion = _rates(sensor, shot)
    rises, falls = (0.0, jnp.inf), (0.0, jnp.inf)
    for end in camera.ends():
        q = camera.direction((end, jnp.zeros_like(end)))
        q = scale(1 / norm(q), q)
        a, b = _miss_rate(camera.miss, q, cross(q, turn)), _miss_rate(camera.miss, q, scale(-1, motion))
        rises, falls = (
            (jnp.maximum(limits[0], low), jnp.minimum(limits[1], high))
            for limits, (low, high) in ((rises, _positive(a, b)), (falls, _positive(-a, -b)))
        )
    rises, falls = ((jnp.where(recorded, low, 0.0), jnp.where(recorded, high, jnp.inf)) for low, high in (rises, falls))
    found = Sweeping(rises, falls, *(jnp.asarray(norm(v), dtype=float) for v in (turn, motion)))
    leaves, structure = jax.tree.flatten(found)
    return jax.tree.unflatten(structure, jnp.broadcast_arrays(*leaves))


def _rates(sensor: Sensor, shot: Shot) -> tuple[Vec3, Vec3]:
    """Angular velocity of the camera and velocity of its centre, both in the camera frame: [turn]x = R^T dR/dt."""

    def pose(t: Component):
        return sensor.pose(dataclasses.replace(shot, time_s=t))

    t = shot.need("time_s", "which a line camera needs")
    now, change = jax.jvp(pose, (t,), (jnp.ones_like(t),))
    change = jax.tree.map(lambda c: 0 if c.dtype == jax.dtypes.float0 else c, change)
    inwards = transpose(now.rotation)
    spin = matmul(inwards, change.rotation)
    return (spin[2][1], spin[0][2], spin[1][0]), apply(inwards, change.translation)


def _miss_rate(miss: Callable[[Vec3], Component], q: Vec3, motion: Vec3) -> Component:
    q, motion = ([jnp.asarray(c, dtype=float) for c in v] for v in (q, motion))
    q, motion = tuple(jnp.broadcast_arrays(*q, *motion)[:3]), tuple(jnp.broadcast_arrays(*q, *motion)[3:])
    return jax.jvp(lambda *q: miss(q), q, motion)[1]


def _positive(a: Component, b: Component) -> tuple[Component, Component]:
    """Between which distances r the rate a + b / r is clearly positive: a + b / r > _CLEAR (|a| + |b| / r)."""
    slope, rest = a - _CLEAR * jnp.abs(a), _CLEAR * jnp.abs(b) - b
    limit = rest / jnp.where(slope == 0, 1.0, slope)
    low = jnp.where(slope > 0, limit, jnp.where(rest < 0, 0.0, jnp.inf))
    return jnp.maximum(low, 0.0), jnp.where((slope < 0) & (rest < 0), limit, jnp.inf)
