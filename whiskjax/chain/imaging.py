"""Imaging, written once for every instrument: ray (pixel -> line of sight) and project (ground point -> pixel).

`sight` and `image` are the chain itself, on components. `ray`, `project` and `image_to_ground` are the doors: arrays in, arrays
and a result code out. `ground_to_image` stands in search.py, because a line camera has to look for the time.

The chain is straight. A sensor with refraction images, in place of a ground point, the `apparent` one, which lies on the ray as
it leaves the camera.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import ZERO, Component, Vec2, Vec3, norm, scale, stack, total, unstack
from ..earth.ellipsoid import height_and_up
from ..earth.refraction import Refraction
from ..earth.surface import AbstractSurface, need_surface
from ..rules import RESULTS, Arrays, Numbers, first_failure, need, need_flags, raise_failures, require_x64
from ..rules.results import failure_if, is_successful
from .sensor import Sensor, fit_sensor
from .shot import Shot, fit_shot

# From the apparent ray to the ground: the height of the ground decides how the ray is bent, and the bent ray what the height is.
# Each pass leaves a hundredth of the error at 78 deg off nadir, for the steepest ground that is seen there. All but the
# last stand in a loop, which is not differentiated, and is compiled once.
_PASSES = 4


class Ray(NamedTuple):
    """A line of sight in the world frame: origin (..., 3) in metres, unit direction (..., 3)."""

    origin_m: Float[Array, "... 3"]
    direction: Float[Array, "... 3"]
    result: RESULTS


class Projection(NamedTuple):
    """Where a point is imaged: (sample or column, line offset or row), (..., 2).

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.
    """

    pixel_px: Float[Array, "... 2"]
    result: RESULTS


class GroundPoint(NamedTuple):
    """Where a pixel looks: a point of the world frame in metres, (..., 3)."""

    point_m: Float[Array, "... 3"]
    result: RESULTS


def sight(sensor: Sensor, shot: Shot, pixel: Vec2) -> tuple[Vec3, Vec3]:
    """Origin and direction (any length) of a pixel's line of sight, as components: one pass outwards, no 3x3 product."""
    origin, direction = ZERO, sensor.camera_at(shot).direction(pixel)
    for link in reversed(sensor.links):
        pose = link.pose(shot)
        origin, direction = pose.point(origin), pose.direction(direction)
    return origin, direction


def centre(sensor: Sensor, shot: Shot) -> Vec3:
    """The projection centre in the world frame, as components."""
    point = ZERO
    for link in reversed(sensor.links):
        point = link.pose(shot).point(point)
    return point


def apparent(sensor: Sensor, shot: Shot, point: Vec3) -> Vec3:
    """Where a ground point seems to lie, as components: where it is, for a sensor without refraction."""
    return point if sensor.refraction is None else sensor.refraction.apparent_point(centre(sensor, shot), point)


def into_camera(sensor: Sensor, shot: Shot, point: Vec3) -> Vec3:
    """A ground point in the camera frame, as components: one pass inwards, of the apparent point where light is refracted."""
    point = apparent(sensor, shot, point)
    for link in sensor.links:
        point = link.pose(shot).into(point)
    return point


def ground(sensor: Sensor, shot: Shot, pixel: Vec2, surface: AbstractSurface) -> tuple[Vec3, RESULTS]:
    """Where a pixel's line of sight meets a surface, as components."""
    origin, direction = sight(sensor, shot, pixel)
    if sensor.refraction is None:
        return surface.intersect(origin, direction)
    given = sensor.refraction, surface, origin, direction
    height, result = _height_met(*jax.lax.stop_gradient(given))
    (height,) = implicit(_above_where_it_meets, (height,), *given)
    chord, bent = sensor.refraction.true_direction(origin, direction, height)
    point, met = surface.intersect(origin, chord)
    return point, first_failure(result, bent, met)


def _height_met(refraction: Refraction, surface: AbstractSurface, origin: Vec3, direction: Vec3) -> tuple[Component, RESULTS]:
    """The ellipsoidal height at which a bent ray meets a surface: all passes but the last."""

    def step(_, state):
        height, result = state
        chord, bent = refraction.true_direction(origin, direction, height)
        point, met = surface.intersect(origin, chord)
        return height_and_up(*point)[0], first_failure(result, bent, met)

    point, result = surface.intersect(origin, direction)
    height, *_ = height_and_up(*point)
    result = jax.tree.map(lambda code: jnp.broadcast_to(code, height.shape), result)
    return jax.lax.fori_loop(1, _PASSES, step, (height, result))


def _above_where_it_meets(
    height: tuple[Component], refraction: Refraction, surface: AbstractSurface, origin: Vec3, direction: Vec3
) -> tuple[Component]:
    """What vanishes at the height at which a bent ray meets a surface."""
    chord, _ = refraction.true_direction(origin, direction, height[0])
    point, _ = surface.intersect(origin, chord)
    return (height[0] - height_and_up(*point)[0],)


def image(sensor: Sensor, shot: Shot, point: Vec3) -> Vec2:
    """Pixel of a ground point, as components."""
    return sensor.camera_at(shot).pixel(into_camera(sensor, shot, point))


def finite(*components: Component) -> RESULTS:
    """Whether all of these are numbers."""
    return failure_if(~jnp.isfinite(total(0 * c for c in components)), RESULTS.nonfinite)


def finish(components: tuple[Component, ...], result: RESULTS) -> Float[Array, "... n"]:
    """The components as an array, NaN where the result is not a success."""
    ok = is_successful(result)
    return stack([jnp.where(ok, c, jnp.nan) for c in components])


def begin(door: str, sensor: Sensor, shot: Shot, **flags: bool) -> Arrays:
    """What every door asks of its sensor, its shot and its options; the arrays taken next have to fit them."""
    require_x64(door)
    need_flags(door, **flags)
    need(door, "sensor", sensor, Sensor)
    need(door, "shot", shot, Shot, "Shot(time_s=...)")
    arrays = Arrays(door)
    fit_sensor(arrays, sensor, shot)
    fit_shot(arrays, shot)
    return arrays


def take_pixel(arrays: Arrays, pixel_px: Float[Numbers, "... 2"]) -> Float[Array, "... 2"]:
    """The pixels of a door."""
    meaning = "sample and line offset, or column and row"
    return jnp.asarray(arrays.take("pixel_px", pixel_px, "... 2", meaning=meaning))


def take_point(arrays: Arrays, point_m: Float[Numbers, "... 3"]) -> Float[Array, "... 3"]:
    """The ground points of a door, in float64 all the way."""
    return jnp.asarray(arrays.take("point_m", point_m, "... 3", absolute=True, meaning="x, y, z of the world frame"))


@eqx.filter_jit
def _ray(sensor: Sensor, shot: Shot, pixel_px: Float[Array, "... 2"]) -> Ray:
    pixel = unstack(pixel_px)
    origin, direction = sight(sensor, shot, pixel)
    result = first_failure(sensor.check(shot), sensor.camera_at(shot).check_pixel(pixel), finite(*origin, *direction))
    one_each = 0 * direction[0]  # shots that many pixels share have one origin: give each pixel its own
    origin = tuple(c + one_each for c in origin)
    return Ray(finish(origin, result), finish(scale(1 / norm(direction), direction), result), result)


def ray(sensor: Sensor, shot: Shot, pixel_px: Float[Numbers, "... 2"], *, throw: bool = True) -> Ray:
    """Line of sight of a pixel as it leaves the camera: refraction bends it only on its way, see `image_to_ground`.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `shot`: its fields broadcast against the pixels' batch shape.
    - `pixel_px`: (sample, line offset) of a line camera or (column, row) of a frame camera, (..., 2).
    - `throw`: raise outside `jit` where a shot or pixel fails; else look at `result`, and values are NaN.

    **Returns:** `Ray`, in the world frame.

    **Raises:** `SensorError`; `WhiskjaxError` where shapes do not fit; `RuntimeError` where float64 is off.
    """
    answer = _ray(sensor, shot, take_pixel(begin("ray", sensor, shot, throw=throw), pixel_px))
    if throw:
        raise_failures(answer.result, "ray")
    return answer


@eqx.filter_jit
def _project(sensor: Sensor, shot: Shot, point_m: Float[Array, "... 3"]) -> Projection:
    camera = sensor.camera_at(shot)
    q = into_camera(sensor, shot, unstack(point_m))
    pixel = camera.pixel(q)
    result = first_failure(sensor.check(shot), camera.check_direction(q), finite(*pixel))
    return Projection(finish(pixel, result), result)


def project(sensor: Sensor, shot: Shot, point_m: Float[Numbers, "... 3"], *, throw: bool = True) -> Projection:
    """Pixel of a ground point at the shot's own time (the collinearity equations: Jin et al. 2024, equation 9).

    For a line camera the second coordinate says how far beside the line the point is imaged at that time; `ground_to_image`
    finds the time when it is imaged on the line. Whether the pixel lies on the detector is not asked here.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `shot`: its fields broadcast against the points' batch shape.
    - `point_m`: world frame, metres, (..., 3).
    - `throw`: raise outside `jit` where a shot or point fails; else look at `result`, and values are NaN.

    **Returns:** `Projection`.

    **Raises:** `SensorError`; `WhiskjaxError` for float32, or where shapes do not fit; `RuntimeError` where float64 is off.
    """
    answer = _project(sensor, shot, take_point(begin("project", sensor, shot, throw=throw), point_m))
    if throw:
        raise_failures(answer.result, "project")
    return answer


@eqx.filter_jit
def _image_to_ground(sensor: Sensor, shot: Shot, pixel_px: Float[Array, "... 2"], surface: AbstractSurface) -> GroundPoint:
    pixel = unstack(pixel_px)
    point, hit = ground(sensor, shot, pixel, surface)
    result = first_failure(sensor.check(shot), sensor.camera_at(shot).check_pixel(pixel), hit, finite(*point))
    return GroundPoint(finish(point, result), result)


def image_to_ground(
    sensor: Sensor, shot: Shot, pixel_px: Float[Numbers, "... 2"], surface: AbstractSurface, *, throw: bool = True
) -> GroundPoint:
    """Where on a surface a pixel looks, along the bent ray where the sensor has a refraction.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `shot`: its fields broadcast against the pixels' batch shape.
    - `pixel_px`: (sample, line offset) of a line camera or (column, row) of a frame camera, (..., 2).
    - `surface`: `HeightSurface` (ECEF world), `Plane`, or anything with their interface.
    - `throw`: raise outside `jit` where a ray fails; else look at `result`, and values are NaN.

    **Returns:** `GroundPoint`.

    **Raises:** `SensorError`; `WhiskjaxError` where shapes do not fit, or the surface is none; `RuntimeError` where float64 is
    off.
    """
    arrays = begin("image_to_ground", sensor, shot, throw=throw)
    need_surface("image_to_ground", surface)
    pixel = take_pixel(arrays, pixel_px)
    arrays.fit("surface", getattr(surface, "batch_shape", ()), "...")
    answer = _image_to_ground(sensor, shot, pixel, surface)
    if throw:
        raise_failures(answer.result, "image_to_ground")
    return answer
