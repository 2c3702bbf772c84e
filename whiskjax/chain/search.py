"""Ground -> image: for a line camera, the time when a point is imaged on the detector line."""

import dataclasses
import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec3, total, unstack
from ..rules import RESULTS, Numbers, WhiskjaxError, first_failure, raise_failures
from ..rules.results import choose, failure_if
from .bracket import CLOSE, between, close
from .camera import AbstractCamera
from .imaging import begin, finish, finite, image, into_camera, take_point
from .one_way import goes_one_way
from .sensor import Sensor
from .shot import Shot
from .walk import BESIDE, NOTHING, Crossings, crossings

# From so many points on it pays to look first which way the line sweeps.
_MANY = 1000


class ImagePoint(NamedTuple):
    """Where and when a point is imaged: pixel (..., 2) and time (...) in seconds."""

    pixel_px: Float[Array, "... 2"]
    time_s: Float[Array, "..."]
    result: RESULTS


def _miss(sensor: Sensor, shot: Shot, point: Vec3, t: Component) -> Component:
    at = dataclasses.replace(shot, time_s=t)
    return sensor.camera_at(at).miss(into_camera(sensor, at, point))


def _offset(t: tuple[Component], sensor: Sensor, shot: Shot, point: Vec3) -> tuple[Component]:
    """What vanishes at the time of exposure: how far beside the line the point is imaged."""
    return (image(sensor, dataclasses.replace(shot, time_s=t[0]), point)[1],)


def exposure_time(
    sensor: Sensor, shot: Shot, point: Vec3, start_s: Component, stop_s: Component, clip: bool
) -> tuple[Component, RESULTS]:
    """The time in [start, stop] when a point is imaged on the detector line, as components.

    The derivative is implicit, by the line offset that vanishes there; the window has none.

    **Arguments:** `clip`: only on the detector.

    **Returns:** the time, also of a crossing that is none on the detector, in front of the camera, or while the chain is recorded
    (the caller asks, and says which it is); and whether the point crosses the line, and is seen only once.
    """
    t, result = _found(*jax.lax.stop_gradient((sensor, shot, point, start_s, stop_s)), clip)
    (t,) = implicit(_offset, (t,), sensor, shot, point)
    return t, result


def _chains(sensor: Sensor, shot: Shot, start_s: Component) -> float:
    """How many chains there are, one for each window and for each key; infinite where the detector has no ends."""

    def chain(t: Component) -> Any:
        at = dataclasses.replace(shot, time_s=t)
        return sensor.pose(at), sensor.camera_at(at).ends()

    found = jax.eval_shape(chain, start_s)
    return max(leaf.size for leaf in jax.tree.leaves(found)) if found[1] else math.inf


def _many(
    sensor: Sensor, shot: Shot, point: Vec3, start_s: Component, stop_s: Component, one_each: Array, clip: bool
) -> Crossings:
    """As `crossings`, sooner: where the line sweeps one way the two ends of a window enclose what there is.

    **Arguments:** `start_s`, `stop_s`: as they were given; `one_each`: zeros of the full batch shape.
    """

    def miss(t: Component) -> Component:
        return _miss(sensor, shot, point, t)

    once = one_each.astype(bool) | goes_one_way(sensor, shot, point, start_s, stop_s)
    start_s, stop_s = start_s + one_each, stop_s + one_each
    at_start, at_stop = miss(start_s), miss(stop_s)
    begins_there = jnp.abs(at_start) <= CLOSE
    enclosed = once & (begins_there | (at_start * at_stop <= 0))
    ends = (start_s, at_start), (stop_s, at_stop)
    far, near = (tuple(jnp.where(begins_there, a, b) for a, b in zip(*pair, strict=True)) for pair in (ends[::-1], ends))
    bracket = close(miss, between(*far, *near), enclosed)
    met = enclosed & (jnp.abs(bracket.near_value) <= CLOSE)
    direct = Crossings(
        jnp.where(met, BESIDE, NOTHING).astype(jnp.int32),
        met.astype(jnp.int32),
        bracket.near,
        enclosed & ~met & (jnp.abs(bracket.near_value) < 1),
    )

    def with_the_rest() -> Crossings:
        walked = crossings(sensor, shot, point, start_s, stop_s, clip, leave=once)
        return jax.tree.map(lambda a, b: jnp.where(once, a, b), direct, walked)

    return jax.lax.cond(jnp.all(once), lambda: direct, with_the_rest)


def _found(
    sensor: Sensor, shot: Shot, point: Vec3, start_s: Component, stop_s: Component, clip: bool
) -> tuple[Component, RESULTS]:
    start_s, stop_s = jnp.broadcast_arrays(start_s, stop_s)
    # A batch shape that holds the point, the window and the keys.
    one_each = total(jnp.zeros_like(c) for c in (*point, start_s, stop_s))
    one_each = jnp.zeros(jax.eval_shape(lambda t: _miss(sensor, shot, point, t), one_each).shape)
    start, stop = start_s + one_each, stop_s + one_each
    if one_each.size < _MANY * _chains(sensor, shot, start_s):
        found = crossings(sensor, shot, point, start, stop, clip)
    else:
        found = _many(sensor, shot, point, start_s, stop_s, one_each, clip)
    t, crosses = found.time_s, found.worth > NOTHING
    (value,), (rate,) = jax.jvp(lambda t: _offset((t,), sensor, shot, point), (t,), (jnp.ones_like(t),))
    step = value / jnp.where(rate == 0, 1.0, rate)
    t = jnp.clip(t - jnp.where(crosses & jnp.isfinite(step), step, 0.0), start, stop)
    missing = choose(found.is_lost, RESULTS.not_converged, RESULTS.outside_swath)
    often = failure_if((found.count > 1) & (found.worth > BESIDE), RESULTS.seen_more_than_once)
    return t, choose(crosses, often, missing)


@eqx.filter_jit
def _ground_to_image(
    sensor: Sensor, shot: Shot, point_m: Float[Array, "... 3"], window_s: tuple[Component, Component] | None, clip: bool
) -> ImagePoint:
    point = unstack(point_m)
    result = RESULTS.successful
    if window_s is not None:
        t, result = exposure_time(sensor, shot, point, *window_s, clip)
        start, stop = (sensor.check(dataclasses.replace(shot, time_s=w + jnp.zeros_like(t))) for w in window_s)
        result = first_failure(start, stop, result)
        shot = dataclasses.replace(shot, time_s=t)
    camera: AbstractCamera = sensor.camera_at(shot)
    q = into_camera(sensor, shot, point)
    pixel = camera.pixel(q)
    result = first_failure(result, sensor.check(shot), camera.check_direction(q), finite(*pixel))
    if clip:
        result = first_failure(result, failure_if(jnp.logical_not(camera.sees(pixel)), RESULTS.outside_swath))
    time = jnp.zeros_like(pixel[0]) if shot.time_s is None else shot.time_s + jnp.zeros_like(pixel[0])
    return ImagePoint(finish(pixel, result), finish((time,), result)[..., 0], result)


def ground_to_image(
    sensor: Sensor,
    shot: Shot,
    point_m: Float[Numbers, "... 3"],
    window_s: tuple[Float[Numbers, "..."], Float[Numbers, "..."]] | None = None,
    *,
    clip: bool = True,
    throw: bool = True,
) -> ImagePoint:
    """Where and when a ground point is imaged.

    A frame camera needs no window: the point is projected at the shot's time. For a line camera the time is searched between the
    two ends of the window (a swing, a strip, many scans of a mirror), which the trajectory has to cover. A point may cross the
    line often, but only once on the detector: where it is seen more than once, give the narrower window that is meant. What
    happens between two recorded samples is taken as even: two crossings between them are not told apart from none.

    **Arguments:**

    - `shot`: the keys (and, for frame cameras, the image or time); its fields broadcast against the points' batch shape.
    - `point_m`: world frame, metres, (..., 3).
    - `window_s`: first and last time in seconds, each () or (...); line cameras only.
    - `clip`: flag points that fall beside the detector; needs the detector's size in the camera.
    - `throw`: raise outside `jit` where a point fails; else look at `result`, and values are NaN.

    **Returns:** `ImagePoint`; the line offset of a line camera is zero up to rounding.

    **Raises:** `SensorError` (outside the swath, seen more than once, outside the trajectory, behind the camera); `WhiskjaxError`
    where a line camera has no window or a frame camera has one.
    """
    arrays = begin("ground_to_image", sensor, shot, clip=clip, throw=throw)
    point = take_point(arrays, point_m)
    is_line = sensor.is_line
    if is_line != (window_s is not None):
        raise WhiskjaxError(
            "a line camera needs the window of times to search: window_s=(start, stop)"
            if is_line
            else "a frame camera exposes the image at once: leave window_s out"
        )
    if window_s is not None:
        several = isinstance(window_s, tuple | list) or getattr(window_s, "ndim", 0) > 0
        if not several or len(window_s) != 2:
            arrays.refuse("window_s", f"is {window_s!r}; the first and the last time are expected, (start, stop)")
        start, stop = (arrays.take("window_s", w, "...", absolute=True) for w in window_s)
        window_s = jnp.asarray(start), jnp.asarray(stop)
    answer = _ground_to_image(sensor, shot, point, window_s, clip)
    if throw:
        raise_failures(answer.result, "ground_to_image")
    return answer
