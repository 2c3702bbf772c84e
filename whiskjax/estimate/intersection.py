"""Forward intersection: points from all the rays that see them, by least squares in the image."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..algebra.symmetric import solve3
from ..algebra.vectors import Vec2, Vec3, mul, stack, total, unstack, vadd, vsub
from ..chain.bake import bake
from ..chain.extremes import refuse_extremes
from ..chain.imaging import begin, finite, sight
from ..chain.joints import joint_derivatives
from ..chain.sensor import Sensor
from ..chain.shot import Shot, fit_shot
from ..rules import RESULTS, WhiskjaxError, arrays_of, compiled, first_failure, is_traced, plain, raise_failures
from ..rules.results import choose, failure_if, is_successful
from ..rules.sizes import filled, rounded
from ..rules.spread import refuse_sigmas

_STEPS = 5
_PARALLEL = 1e-10


class Intersection(NamedTuple):
    """Intersected points (points, 3) in metres, their covariance (points, 3, 3), residuals (rays, 2) in pixels, and results.

    The covariance follows from the stated pixel sigmas and the geometry. Residual = measured - projected.
    """

    point_m: Float[Array, "points 3"]
    covariance_m2: Float[Array, "points 3 3"]
    residual_px: Float[Array, "rays 2"]
    result: RESULTS


def intersect(
    sensor: Sensor,
    shot: Shot,
    pixel_px: Float[Array, "rays 2"],
    point_index: Int[np.ndarray, " rays"],
    sigma_px: Float[Array, "rays 2"] | float = 1.0,
    *,
    throw: bool = True,
) -> Intersection:
    """Intersect the rays of many points at once.

    Starts where the rays come closest in space, then takes Gauss-Newton steps on the pixel residuals, with closed
    3x3 solutions for each point.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    **Arguments:**

    - `shot`: fields of shape (rays,).
    - `pixel_px`: measured (sample, line offset) or (column, row) of each ray.
    - `point_index`: which point each ray sees, 0 to points - 1, every point at least once.
    - `sigma_px`: 1-sigma of the measurements.
    - `throw`: raise where a point is not determined (one ray, or parallel rays) or a ray fails; else look at `result`.

    **Returns:** `Intersection`; values are NaN where the result of the point is not a success.

    **Raises:** `SensorError`; `WhiskjaxError` for indices with holes.
    """
    arrays = begin("intersect", sensor, shot, throw=throw)
    pixel = plain(arrays.take("pixel_px", pixel_px, "rays 2"))
    index = np.asarray(arrays.take_whole("point_index", point_index, "rays"))
    fit_shot(arrays, shot, "rays")
    refuse_extremes(sensor, "intersect")
    sensor.refuse_aligned("intersect")
    if len(index) == 0:
        raise WhiskjaxError("intersect: there are no rays")
    points = int(index.max()) + 1
    if len(np.unique(index)) != points or index.min() < 0:
        raise WhiskjaxError(
            "intersect: point indices must run from 0 to points - 1 without holes: a point without a ray has no place"
        )
    shape = {0: "", 1: "2"}.get(np.ndim(sigma_px), "rays 2")
    sigma = plain(arrays.take("sigma_px", sigma_px, shape, finite=True, above=0.0))
    sigma = arrays_of((sigma, pixel)).broadcast_to(sigma, pixel.shape)
    if not is_traced(sigma):
        refuse_sigmas(np.asarray(sigma), lambda _: "intersect: a sigma_px")
    rays, whose, size = _filled(index, points)
    math = arrays_of((sensor, shot, pixel, sigma))  # outside of tracing nothing has to be compiled for picking
    shots = jax.tree.map(lambda a: math.broadcast_to(plain(a), index.shape)[rays], shot)
    found = _intersect(sensor, shots, plain(pixel)[rays], whose.astype(np.int32), plain(sigma)[rays], size)
    found = jax.tree.map(plain, found)
    answer = Intersection(
        found.point_m[:points],
        found.covariance_m2[:points],
        found.residual_px[: len(index)],
        jax.tree.map(lambda a: a[:points], found.result),
    )
    if throw:
        raise_failures(answer.result, "intersect (index: the point)")
    return answer


def _filled(index: Int[np.ndarray, " rays"], points: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Rays, whose they are, and how many points, of which few numbers are compiled: the last point once or several times more."""
    size = rounded(points + 1)
    last = np.flatnonzero(index == points - 1)
    rays = np.concatenate([np.arange(len(index)), np.tile(last, size - points)])
    whose = np.concatenate([index, np.repeat(np.arange(points, size), len(last))])
    more = filled(len(rays))
    return rays[more], whose[more], size


def _intersected(sensor: Sensor, shot: Shot, pixel: Array, index: Array, sigma: Array, points: int) -> Intersection:
    measured: Vec2 = unstack(pixel)
    weight = tuple(1 / s for s in unstack(sigma))
    ray_result = first_failure(sensor.check(shot), sensor.camera_at(shot).check_pixel(measured))
    sensor, shot = bake(sensor, shot, ())

    def gather(values: Vec3) -> Vec3:
        return tuple(v[index] for v in values)

    def add_up(values: tuple) -> tuple:
        return tuple(jax.ops.segment_sum(v, index, points) for v in values)

    point, rays_meet = _nearest(*sight(sensor, shot, measured), gather, add_up)

    def improve(_, state):
        point, _ = state
        _, normal, right = _normal(sensor, shot, gather(point), measured, weight)
        step, _ = solve3(add_up(normal), add_up(right))
        return vadd(point, step), step

    point, step = jax.lax.fori_loop(0, _STEPS, improve, (point, point))
    residual, normal, right = _normal(sensor, shot, gather(point), measured, weight)
    _, inverse = solve3(add_up(normal), add_up(right))

    def worst(of_rays: RESULTS) -> RESULTS:
        return jax.tree.map(lambda code: jax.ops.segment_max(code + 0 * index, index, points), of_rays)

    behind = sensor.camera_at(shot).check_direction(shot.poses[-1].into(gather(point)))
    moving = jnp.sqrt(total(mul(s, s) for s in step)) > 1e-3
    result = first_failure(
        worst(first_failure(ray_result, finite(*measured))),
        choose(rays_meet, RESULTS.successful, RESULTS.rank_deficient),
        worst(behind),
        finite(*point),
        failure_if(moving, RESULTS.not_converged),
    )
    ok = is_successful(result)[:, None]
    (a, b, c), (_, d, e), (_, _, f) = inverse
    covariance = jnp.stack([stack((a, b, c)), stack((b, d, e)), stack((c, e, f))], axis=-2)
    return Intersection(
        jnp.where(ok, stack(point), jnp.nan),
        jnp.where(ok[:, :, None], covariance, jnp.nan),
        jnp.where(ok[index], stack(residual), jnp.nan),
        result,
    )


_intersect = compiled(_intersected, lambda sensor, shot, pixel, *_: len(pixel))


def _nearest(origin: Vec3, direction: Vec3, gather, add_up) -> tuple[Vec3, Array]:
    """The point with the least squared distance to all of a point's rays, and whether the rays differ in direction."""
    length2 = total(mul(c, c) for c in direction)
    x, y, z = (c / jnp.sqrt(length2) for c in direction)
    # Sum of I - d d^T, around the first ray's origin, so that large coordinates do not cancel.
    normal = add_up((1 - x * x, -x * y, -x * z, 1 - y * y, -y * z, 1 - z * z))
    count, *middle = add_up((jnp.ones_like(x), *(o + jnp.zeros_like(x) for o in origin)))
    middle = tuple(m / count for m in middle)
    away = vsub(origin, gather(middle))
    along = total(mul(a, b) for a, b in zip((x, y, z), away, strict=True))
    offset, _ = solve3(normal, add_up(tuple(a - along * d for a, d in zip(away, (x, y, z), strict=True))))
    n00, n01, n02, n11, n12, n22 = normal
    determinant = n00 * (n11 * n22 - n12 * n12) - n01 * (n01 * n22 - n12 * n02) + n02 * (n01 * n12 - n11 * n02)
    return vadd(middle, offset), determinant > _PARALLEL * count**3


def _normal(sensor: Sensor, shot: Shot, point: Vec3, measured: Vec2, weight: Vec2) -> tuple[Vec2, tuple, tuple]:
    """Residuals, upper triangle of the normal matrix and right side of every ray."""
    swept = joint_derivatives(sensor, shot, point)
    residual = vsub(measured, swept.pixel)
    rows = [tuple(w * e for e in row) for w, row in zip(weight, swept.derivatives["earth"], strict=True)]
    scaled = [w * r for w, r in zip(weight, residual, strict=True)]
    normal = tuple(total(row[i] * row[j] for row in rows) for i in range(3) for j in range(i, 3))
    right = tuple(total(row[i] * s for row, s in zip(rows, scaled, strict=True)) for i in range(3))
    return residual, normal, right
