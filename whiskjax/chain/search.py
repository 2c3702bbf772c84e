"""Ground -> image: for a line camera, the time when a point is imaged on the detector line."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec3, unstack
from ..rules import RESULTS, WhiskjaxError, first_failure, raise_failures
from ..rules.results import failure_if
from .camera import AbstractCamera
from .imaging import begin, finish, finite, image, into_camera, take_point
from .sensor import Sensor
from .shot import Shot

# Searching stops where the miss (tangent of half the angle beside the line) is this small, a few 1e-5 px; one Newton step with
# the exact derivative then squares what is left.
_CLOSE, _MOST_STEPS, _BISECT_EVERY = 1e-9, 80, 5


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


def exposure_time(sensor: Sensor, shot: Shot, point: Vec3, start_s: Component, stop_s: Component) -> tuple[Component, RESULTS]:
    """The time in [start, stop] when a point lies in the plane of the detector line, as components.

    Safeguarded secant inside a bracket (regula falsi with the weight of Anderson and Bjorck 1973, and a bisection where five
    steps have not brought the miss down to a sixteenth): Newton cycles at the kinks of linearly interpolated POS, and a strip
    flown in turbulence is far from a straight line. Points that have arrived stay; the loop ends when all have. The derivative
    is implicit, one Newton step from the solution: dt = -(d miss / d everything else) / (d miss / d t).
    """
    fixed_sensor, fixed_shot, fixed_point = jax.lax.stop_gradient((sensor, shot, point))

    def miss(t):
        return _miss(fixed_sensor, fixed_shot, fixed_point, t)

    # A batch shape that holds the point and the window.
    zero = sum((jnp.zeros_like(c) for c in fixed_point), jnp.zeros(()))
    a, b = jax.lax.stop_gradient((start_s + zero, stop_s + zero))
    fa, fb = miss(a), miss(b)
    crossed = fa * fb <= 0

    def searching(state):
        k, _, _, _, fb, _ = state
        return (k < _MOST_STEPS) & jnp.any(crossed & (jnp.abs(fb) > _CLOSE))

    def step(state):
        k, a, b, fa, fb, before = state  # a and b enclose the solution, b is the newest
        arrived = ~(jnp.abs(fb) > _CLOSE)
        slope = fb - fa
        t = b - fb * (b - a) / jnp.where(slope == 0, 1.0, slope)
        look_back = k % _BISECT_EVERY == _BISECT_EVERY - 1
        t = jnp.where(look_back & (jnp.abs(fb) > before / 16), 0.5 * (a + b), t)
        before = jnp.where(look_back, jnp.abs(fb), before)
        t = jnp.where(arrived, b, t)
        ft = jnp.where(arrived, fb, miss(t))
        other_side = ft * fb <= 0
        m = 1 - ft / jnp.where(fb == 0, 1.0, fb)
        weight = jnp.where(m > 0, m, 0.5)
        a, fa = jnp.where(other_side, b, a), jnp.where(arrived, fa, jnp.where(other_side, fb, weight * fa))
        return k + 1, a, t, fa, ft, before

    _, _, t, _, last, _ = jax.lax.while_loop(searching, step, (0, a, b, fa, fb, jnp.abs(fb)))
    value, rate = jax.jvp(miss, (t,), (jnp.ones_like(t),))
    t = t - jnp.where(crossed, value / jnp.where(rate == 0, 1.0, rate), 0.0)
    (t,) = implicit(_offset, (t,), sensor, shot, point)
    lost = failure_if(~(jnp.abs(last) <= _CLOSE), RESULTS.not_converged)
    return t, first_failure(failure_if(~crossed, RESULTS.outside_swath), lost)


@eqx.filter_jit
def _ground_to_image(
    sensor: Sensor, shot: Shot, point_m: Float[Array, "... 3"], window_s: tuple[Component, Component] | None, clip: bool
) -> ImagePoint:
    point = unstack(point_m)
    result = RESULTS.successful
    if window_s is not None:
        t, result = exposure_time(sensor, shot, point, *window_s)
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
    point_m: Float[ArrayLike, "... 3"],
    window_s: tuple[Float[ArrayLike, "..."], Float[ArrayLike, "..."]] | None = None,
    *,
    clip: bool = True,
    throw: bool = True,
) -> ImagePoint:
    """Where and when a ground point is imaged.

    A frame camera needs no window: the point is projected at the shot's time. For a line camera the time is searched between the
    two ends of the window (one swing, one strip), which the trajectory has to cover without a gap, and in which the point is seen
    once: one that crosses the line twice counts as outside the swath, so give a narrower window.

    **Arguments:**

    - `shot`: the keys (and, for frame cameras, the image or time); its fields broadcast against the points' batch shape.
    - `point_m`: world frame, metres, (..., 3).
    - `window_s`: first and last time in seconds, each () or (...); line cameras only.
    - `clip`: flag points that fall beside the detector; needs the detector's size in the camera.
    - `throw`: raise outside `jit` where a point fails; else look at `result`, and values are NaN.

    **Returns:** `ImagePoint`; the line offset of a line camera is zero up to rounding.

    **Raises:** `SensorError` (outside the swath, outside the trajectory, behind the camera); `WhiskjaxError` where a line camera
    has no window or a frame camera has one.
    """
    arrays = begin("ground_to_image", sensor, shot)
    point = take_point(arrays, point_m)
    is_line = sensor.is_line
    if is_line != (window_s is not None):
        raise WhiskjaxError(
            "a line camera needs the window of times to search: window_s=(start, stop)"
            if is_line
            else "a frame camera exposes the image at once: leave window_s out"
        )
    if window_s is not None:
        if np.ndim(window_s) == 0 or len(window_s) != 2:
            arrays.refuse("window_s", f"is {window_s!r}; the first and the last time are expected, (start, stop)")
        start, stop = (arrays.take("window_s", w, "...", absolute=True) for w in window_s)
        window_s = jnp.asarray(start), jnp.asarray(stop)
    answer = _ground_to_image(sensor, shot, point, window_s, clip)
    if throw:
        raise_failures(answer.result, "ground_to_image")
    return answer
