"""How large a line and a pixel are where a point is seen: pixels to a line, metres to a pixel.

A line camera measures a line, that is a time; its chain answers in focal-plane pixels, of which the second counts the offset
across the detector line at one time. How many of them a line is depends on how fast the image of the ground moves across the
detector (the platform's speed over its height, the turning of a scan mirror) and on how long a line takes: lines of 6 m and
pixels of 1 m are 6 pixels to a line.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..algebra.vectors import Vec2, Vec3, dot, norm, transpose, unstack
from ..earth.surface import AbstractSurface, need_surface
from ..rules import RESULTS, Numbers, WhiskjaxError, first_failure, raise_failures
from ..rules.results import failure_if
from ..rules.sizes import filled
from .imaging import begin, finish, finite, image, take_point
from .joints import joint_derivatives
from .sensor import Sensor
from .shot import Shot

# A line of less than this across the detector does not say where a point lies: the mirror turns back, or nothing moves.
_STILL_PX = 0.01


class ImageScale(NamedTuple):
    """The image of points and how it moves, as components.

    - `pixel`: as `project` has it.
    - `px_per_s`: the change of both coordinates in time; None for a frame camera.
    - `px_per_m`: derivative of both coordinates by the ground point in the world frame, two rows of three.
    """

    pixel: Vec2
    px_per_s: Vec2 | None
    px_per_m: tuple[Vec3, ...]
    result: RESULTS


@eqx.filter_jit
def image_scale(sensor: Sensor, shot: Shot, point: Vec3) -> ImageScale:
    """Pixel, its rate, its derivative by the ground point (components), at the shot's own time."""
    swept = joint_derivatives(sensor, shot, point)
    in_camera = swept.points[sensor.names[-1]]
    result = first_failure(sensor.check(shot), sensor.camera_at(shot).check_direction(in_camera), finite(*swept.pixel))
    rate = None
    if sensor.is_line:
        time = shot.need("time_s", "which a line camera needs")
        moved = lambda t: image(sensor, dataclasses.replace(shot, time_s=t), point)
        _, rate = jax.jvp(moved, (time,), (jnp.ones_like(time),))
    like = jnp.zeros_like(swept.pixel[0])
    row = lambda r: tuple(c + like for c in r)
    return ImageScale(swept.pixel, rate, tuple(map(row, swept.derivatives["earth"])), result)


def scale_of_each(sensor: Sensor, shot: Shot, point_m: Float[np.ndarray, "n 3"]) -> ImageScale:
    """`image_scale` of n shots and points, on the host: components as numpy arrays (n,); compiled for rounded sizes only."""
    n = len(point_m)
    rays = filled(n)
    shots = jax.tree.map(lambda a: np.broadcast_to(np.asarray(a), (n,))[rays], shot)
    found = image_scale(sensor, shots, unstack(np.asarray(point_m, dtype=float)[rays]))
    return jax.tree.map(lambda a: np.broadcast_to(np.asarray(a), rays.shape)[:n], found)


@eqx.filter_jit
def line_in_image(scale: ImageScale, s_per_line: Float[ArrayLike, "..."]) -> tuple[Vec2, RESULTS]:
    """Residual (measured - projected, along and across the line, px) of a point that was measured one line too late.

    The image has gone on by then: minus the rate, times the time of a line.
    """
    if scale.px_per_s is None:
        raise WhiskjaxError("a frame camera has rows, not lines: one row is one pixel")
    along, across = (-rate * s_per_line for rate in scale.px_per_s)
    still = ~(abs(across) > _STILL_PX)
    return (along, across), first_failure(scale.result, finite(along, across), failure_if(still, RESULTS.line_stands_still))


@eqx.filter_jit
def _px_per_line(sensor: Sensor, shot: Shot, point: Vec3, s_per_line: Float[Array, "..."]) -> tuple[Array, RESULTS]:
    line, result = line_in_image(image_scale(sensor, shot, point), s_per_line)
    return finish(line, result), result


def px_per_line(
    sensor: Sensor,
    shot: Shot,
    point_m: Float[Numbers, "... 3"],
    s_per_line: Float[Numbers, "..."],
    *,
    throw: bool = True,
) -> Float[Array, "... 2"]:
    """How many focal-plane pixels one line of a line camera is, where and when points are seen: (along, across) the line.

    It is the residual (measured - projected) of a point whose line was measured one too late, so residuals across the line over
    the second entry are in lines, and errors in lines times both entries in pixels: a line measured to `sigma_lines` and a sample
    measured to `sigma_sample_px` have

        sigma_px = np.hypot([sigma_sample_px, 0.0], sigma_lines * np.asarray(px_per_line(...)))

    The first entry is zero where the image moves square to the detector. `adjust` evaluates rays where their points cross the
    line, so that errors of the line stay across it: there sigma_px is (sigma_sample_px, sigma_lines * abs(second entry)).

    **Arguments:**

    - `shot`: its time and keys broadcast against the points' batch shape.
    - `point_m`: world frame, metres, (..., 3).
    - `s_per_line`: how long a line takes, seconds: `LineTimes.s_per_line(line)`.
    - `throw`: raise outside `jit` where a point fails; else values are NaN.

    **Returns:** pixels to a line, (..., 2); negative where the offset across the line grows while the point passes.

    **Raises:** `SensorError` where a point cannot be seen, or its image does not move across the line; `WhiskjaxError` for a
    frame camera.
    """
    arrays = begin("px_per_line", sensor, shot)
    point = take_point(arrays, point_m)
    time = jnp.asarray(arrays.take("s_per_line", s_per_line, "...", absolute=True, above=0.0, meaning="seconds"))
    value, result = _px_per_line(sensor, shot, unstack(point), time)
    if throw:
        raise_failures(result, "px_per_line")
    return value


@eqx.filter_jit
def on_ground(px_per_m: tuple[Vec3, ...], east: Vec3, north: Vec3) -> tuple[Vec2, Vec2]:
    """Where a pixel along each image axis leads on the ground, with the other coordinate kept: (east, north) in metres, for both.

    A move (e, n) in the level plane through the point moves the image by G (e, n), G = px_per_m (east, north); these are the
    columns of inv(G). Infinite where the line of sight lies in that plane.
    """
    (a, b), (c, d) = ((dot(row, east), dot(row, north)) for row in px_per_m)
    area = a * d - b * c
    return (d / area, -c / area), (-b / area, a / area)


@eqx.filter_jit
def _m_per_px(sensor: Sensor, shot: Shot, point: Vec3, surface: AbstractSurface) -> tuple[Array, RESULTS]:
    scale = image_scale(sensor, shot, point)
    east, north, _ = transpose(surface.level(point))
    metres = tuple(map(norm, on_ground(scale.px_per_m, east, north)))
    return finish(metres, scale.result), scale.result


def m_per_px(
    sensor: Sensor, shot: Shot, point_m: Float[Numbers, "... 3"], surface: AbstractSurface, *, throw: bool = True
) -> Float[Array, "... 2"]:
    """How large a pixel is on the ground where points are seen (ground sample distance): metres along both image axes.

    Of a line camera that is along the line and across it; times the second entry of `px_per_line` it is metres to a line. The
    length is taken in the level plane through the point, with the other coordinate kept: g_x = (d, -c) / (a d - b c) and
    g_y = (-b, a) / (a d - b c) east and north, where (a, b) and (c, d) are the derivatives of the two coordinates by east and
    north. A nadir camera at height h has h / f; towards the horizon it grows without bound.

    **Arguments:**

    - `shot`: its fields broadcast against the points' batch shape.
    - `point_m`: world frame, metres, (..., 3).
    - `surface`: says what is level at a point: `HeightSurface(0.0)` in ECEF, `Plane((0, 0, 0), (0, 0, 1))` in a local world.
    - `throw`: raise outside `jit` where a point fails; else values are NaN.

    **Returns:** metres to a pixel, (..., 2).

    **Raises:** `SensorError` where a point cannot be seen.
    """
    arrays = begin("m_per_px", sensor, shot)
    need_surface("m_per_px", surface)
    point = take_point(arrays, point_m)
    value, result = _m_per_px(sensor, shot, unstack(point), surface)
    if throw:
        raise_failures(result, "m_per_px")
    return value
