"""Whether the detector line sweeps over the ground one way: then a point is on it once, and the ends of a window enclose it.

A point at the distance r from the camera, imaged on the line, leaves it at the rate a + b / r: a by the turning of the camera,
b by its way. Where that has one sign all along the detector, behind every recorded sample of the window, and the camera turns by
less than half a turn in it, the line goes over no point twice. It costs one look at each sample, however many points there are.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Vec3, apply, cross, dot, matmul, norm, scale, transpose, vsub
from ..rules.results import is_successful
from .camera import AbstractCamera
from .imaging import centre
from .pose import Pose
from .sensor import Sensor
from .shot import Shot

# Samples looked at in one go; how clear the sign of a rate must be, for what lies between the samples and along the detector; and
# where in an interval it is looked at: behind its first sample, by more than rounding.
_CHUNK, _CLEAR, _BEHIND = 128, 0.05, 1e-3


class Sweeping(NamedTuple):
    """Between which distances the miss rises for every point on the detector, and between which it falls; and what is greatest.

    `off_m`: how far the camera is off its straight way; `along`: cosine of the angle between that way and a line of sight.
    """

    rises_m: tuple[Component, Component]
    falls_m: tuple[Component, Component]
    turn_radps: Component
    off_m: Component
    along: Component

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
        return Sweeping(rises, falls, *map(jnp.maximum, self[2:], other[2:]))


def goes_one_way(sensor: Sensor, shot: Shot, point: Vec3, start_s: Component, stop_s: Component) -> Bool[Array, "..."]:
    """Whether the line goes over each point at most once within a window.

    At which distance a point is on the detector follows from its distance from the straight way between the ends of the window,
    and from the angle between that way and the line of sight.

    **Arguments:** `start_s`, `stop_s`: of any shape that fits, best of few elements: each window costs a look at its samples.
    """
    first, way = _way(sensor, shot, start_s, stop_s)
    seen = sweeping(sensor, shot, start_s, stop_s)
    aside = norm(cross(vsub(point, first), way))
    near, far = aside - seen.off_m, (aside + seen.off_m) / jnp.sqrt(jnp.maximum(1 - seen.along * seen.along, 1e-9))
    rises, falls = ((near > low) & (far < high) for low, high in (seen.rises_m, seen.falls_m))
    return (rises | falls) & (seen.turn_radps * (stop_s - start_s) < jnp.pi)


def _way(sensor: Sensor, shot: Shot, start_s: Component, stop_s: Component) -> tuple[Vec3, Vec3]:
    """Where the camera is first, and the direction from there to where it is last; a camera that hovers has some direction."""
    first, last = (centre(sensor, dataclasses.replace(shot, time_s=t)) for t in (start_s, stop_s))
    way = tuple(jnp.asarray(c, dtype=float) for c in vsub(last, first))
    hovers = norm(way) == 0
    return first, scale(1 / jnp.where(hovers, 1.0, norm(way)), (jnp.where(hovers, 1.0, way[0]), way[1], way[2]))


def sweeping(sensor: Sensor, shot: Shot, start_s: Component, stop_s: Component) -> Sweeping:
    """Look at every recorded sample between two times; of the batch shape of sensor, shot and times.

    The camera is one whose detector has `ends`. What is not recorded at some time says nothing.
    """
    line = _way(sensor, shot, start_s, stop_s)
    records = sensor.moves(shot).recorded
    none = jnp.zeros(jnp.shape(start_s), dtype=jnp.int32)
    ends = [[record.knots.locate(t + record.delay_s)[0] for record in records] for t in (start_s, stop_s)]
    first, last = (jnp.stack([*places, none]) for places in ends)
    after = jnp.cumsum(last + 1 - first, axis=0)  # the samples of all records, numbered through

    def time_of(k: Component) -> Component:
        """The time just behind a sample, or the start of the window where there is none."""
        t = start_s
        for i, record in enumerate(records):
            before = after[i - 1] if i else none
            place = jnp.clip(first[i] + k - before, first[i], last[i])
            sample, following = record.knots.time_s[place], record.knots.time_s[place + 1]
            behind = sample + _BEHIND * (following - sample) - record.delay_s
            # What begins where the window stops, a gap perhaps, is no part of it.
            is_here = (k >= before) & (k < after[i]) & (behind < stop_s)
            t = jnp.where(is_here, behind, t)
        return jnp.clip(t, start_s, stop_s)

    def look(k: Component) -> Sweeping:
        return _at_once(sensor, dataclasses.replace(shot, time_s=time_of(k)), *line)

    def goes_on(state: tuple[Component, Sweeping]) -> Bool[Array, ""]:
        k, seen = state
        return jnp.any(k < after[-1]) & jnp.any(seen.is_possible)

    def chunk(state: tuple[Component, Sweeping]) -> tuple[Component, Sweeping]:
        k, seen = state
        found = jax.vmap(look)(k + jnp.arange(_CHUNK, dtype=jnp.int32))
        rises, falls = ((jnp.max(low, axis=0), jnp.min(high, axis=0)) for low, high in (found.rises_m, found.falls_m))
        return k + _CHUNK, seen.narrowed(Sweeping(rises, falls, *(jnp.max(value, axis=0) for value in found[2:])))

    start = jnp.zeros((), dtype=jnp.int32)
    zero = jnp.zeros(jax.eval_shape(look, start).turn_radps.shape)
    everywhere = zero, zero + jnp.inf
    return jax.lax.while_loop(goes_on, chunk, (start, Sweeping(everywhere, everywhere, zero, zero, zero)))[1]


def _at_once(sensor: Sensor, shot: Shot, start: Vec3, way: Vec3) -> Sweeping:
    """At one moment: at both ends of the detector and in the middle; the way from a start in a direction."""
    camera, recorded = sensor.camera_at(shot), is_successful(sensor.check(shot))
    pose, turn, motion = _rates(sensor, shot)

    def look(sample: Component) -> tuple[Component, ...]:
        q = camera.direction((sample, jnp.zeros_like(sample)))
        q = scale(1 / norm(q), q)
        a, b = _offset_rates(camera, q, cross(q, turn), scale(-1, motion))
        return *_positive(a, b), *_positive(-a, -b), jnp.abs(dot(pose.direction(q), way))

    first, last = camera.ends()
    found = jax.vmap(look)(jnp.stack([first, (first + last) / 2, last]))
    lows, highs, along = (jnp.max(found[i], axis=0) for i in (0, 2)), (jnp.min(found[i], axis=0) for i in (1, 3)), found[4]
    rises, falls = zip(lows, highs, strict=True)
    off = norm(cross(vsub(pose.translation, start), way))
    greatest = (jnp.asarray(c, dtype=float) for c in (norm(turn), off, jnp.max(along, axis=0)))
    # What is not recorded demands nothing.
    found = Sweeping(rises, falls, *greatest)
    anything = Sweeping((0.0, jnp.inf), (0.0, jnp.inf), 0.0, 0.0, 0.0)
    leaves, structure = jax.tree.flatten(jax.tree.map(lambda c, free: jnp.where(recorded, c, free), found, anything))
    return jax.tree.unflatten(structure, jnp.broadcast_arrays(*leaves))


def _rates(sensor: Sensor, shot: Shot) -> tuple[Pose, Vec3, Vec3]:
    """Pose, angular velocity of the camera and velocity of its centre, both in the camera frame: [turn]x = R^T dR/dt."""

    def pose(t: Component):
        return sensor.pose(dataclasses.replace(shot, time_s=t))

    t = shot.need("time_s", "which a line camera needs")
    now, change = jax.jvp(pose, (t,), (jnp.ones_like(t),))
    change = jax.tree.map(lambda c: 0 if c.dtype == jax.dtypes.float0 else c, change)
    inwards = transpose(now.rotation)
    spin = matmul(inwards, change.rotation)
    return now, (spin[2][1], spin[0][2], spin[1][0]), apply(inwards, change.translation)


def _offset_rates(camera: AbstractCamera, q: Vec3, *motions: Vec3) -> list[Component]:
    """How fast the line offset of a direction on the line changes, for each of several motions: to the side of its miss."""
    shape = jnp.broadcast_shapes(*(jnp.shape(c) for v in (q, *motions) for c in v))
    place, *ways = ([jnp.broadcast_to(jnp.asarray(c, dtype=float), shape) for c in v] for v in (q, *motions))
    _, rate = jax.linearize(lambda *q: camera.pixel(q)[1], *place)
    return [rate(*way) for way in ways]


def _positive(a: Component, b: Component) -> tuple[Component, Component]:
    """Between which distances r the rate a + b / r is clearly positive: a + b / r > _CLEAR (|a| + |b| / r)."""
    slope, rest = a - _CLEAR * jnp.abs(a), _CLEAR * jnp.abs(b) - b
    limit = rest / jnp.where(slope == 0, 1.0, slope)
    low = jnp.where(slope > 0, limit, jnp.where(rest < 0, 0.0, jnp.inf))
    return jnp.maximum(low, 0.0), jnp.where((slope < 0) & (rest < 0), limit, jnp.inf)
