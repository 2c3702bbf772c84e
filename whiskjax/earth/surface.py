"""Surfaces that a ray can meet.

Every surface has one method, `intersect(origin, direction) -> (point, result)`, elementwise over any batch of rays. The first
intersection in front of the origin is returned; the direction need not be a unit vector.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Mat3, Vec3, cross, dot, mul, norm, scale, transpose, vadd, vsub
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, is_traced
from ..rules.results import failure_if
from .ellipsoid import SEMI_MAJOR_M, SEMI_MINOR_M, geodetic_from_ecef
from .frames import ecef_from_enu


class AbstractSurface(eqx.Module):
    """What a ray can be intersected with."""

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """() for one surface that all rays meet; else it broadcasts with the rays."""
        return ()

    @abc.abstractmethod
    def intersect(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, RESULTS]:
        """First point of the surface along the ray, in the frame of the ray."""

    @abc.abstractmethod
    def level(self, point: Vec3) -> Mat3:
        """Rotation world_from_enu at a point: its columns are east, north and up there."""


def need_surface(owner: str, surface: Any) -> None:
    """**Raises:** `WhiskjaxError` where a surface is none: a bare height, say. `owner` is whose argument it is."""
    if isinstance(surface, type) or not callable(getattr(surface, "intersect", None)):
        height = isinstance(surface, int | float | np.number)
        remedy = f"HeightSurface({surface})" if height else "HeightSurface(height_m), Plane(point_m, normal) or your own"
        raise WhiskjaxError(f"{owner}: surface is {surface!r}, which no ray can be intersected with; give {remedy}")


class HeightSurface(AbstractSurface):
    """All points of one ellipsoidal height: ECEF, metres.

    This is the true surface, not the ellipsoid with lengthened axes, which starts the iteration (the two differ by 0.010 m for a
    look 78 deg off nadir). `height_m` may be a batch: one height for each ray.
    """

    height_m: Float[Array, "..."]

    def __init__(self, height_m: Float[Numbers, "..."]):
        """**Raises:** `WhiskjaxError` where the height is no finite number, or float32."""
        self.height_m = jnp.asarray(Arrays("HeightSurface").take("height_m", height_m, "...", absolute=True, finite=True))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of the heights."""
        return np.shape(self.height_m)

    def intersect(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, RESULTS]:
        """Near root with the lengthened ellipsoid, then one step on the geodetic height along the ray.

        The root misses by centimetres. The step solves height + climb s + s^2 (1 - climb^2) / 2R = wanted height, so that what is
        left is of third order, also for rays that graze.

        The geodetic height of a point of the lengthened ellipsoid has a closed form: with parametric latitude beta and its foot
        (a cos(beta), b sin(beta)), the rest h (cos(beta), sin(beta)) has a part along the normal and a small one along the
        meridian, which adds its square over twice the radius; exact to rounding up to 8 km, to 3e-7 m at 400 km.
        """
        h = self.height_m
        a, b = 1 / (SEMI_MAJOR_M + h), 1 / (SEMI_MINOR_M + h)
        p = tuple(mul(c, w) for c, w in zip(origin, (a, a, b), strict=True))
        v = tuple(mul(c, w) for c, w in zip(direction, (a, a, b), strict=True))
        vv, pv, pp = dot(v, v), dot(p, v), dot(p, p) - 1
        discriminant = pv * pv - vv * pp
        misses = (discriminant <= 0) | (pv >= 0) | (pp < 0)
        # pp / (-pv + root) is the near root without cancellation; where the ray misses, a harmless 1 keeps gradients finite.
        root = jnp.sqrt(jnp.where(misses, 1.0, discriminant))
        s = pp / (root - jnp.where(misses, -1.0, pv))
        x, y, z = vadd(p, scale(s, v))  # on the unit sphere: cos(beta) cos(lon), cos(beta) sin(lon), sin(beta)
        sin2 = z * z
        cos2 = 1 - sin2
        square = SEMI_MINOR_M**2 * cos2 + SEMI_MAJOR_M**2 * sin2
        w = 1 / jnp.sqrt(square)
        along = h * (SEMI_MINOR_M * cos2 + SEMI_MAJOR_M * sin2) * w
        aside = h * (SEMI_MAJOR_M - SEMI_MINOR_M) * w
        meridian = square * square * w / (SEMI_MAJOR_M * SEMI_MINOR_M) + h
        rise = h - along - aside * aside * sin2 * cos2 / (2 * meridian)
        # The normal at the foot, tilted by the small part along the meridian.
        tilt = aside / meridian
        level = w * (SEMI_MINOR_M + SEMI_MAJOR_M * tilt * sin2)
        up = level * x, level * y, w * (SEMI_MAJOR_M - SEMI_MINOR_M * tilt * cos2) * z
        climb = jnp.where(misses, -1.0, dot(up, direction))
        bend = (dot(direction, direction) - climb * climb) / SEMI_MAJOR_M
        under = climb * climb + 2 * bend * rise
        s = s + 2 * rise / (climb - jnp.sqrt(jnp.where(misses | (under < 0), climb * climb, under)))
        return vadd(origin, scale(s, direction)), failure_if(misses, RESULTS.ray_misses_ground)

    def level(self, point: Vec3) -> Mat3:
        """East, north and up of the ellipsoid."""
        lat, lon, _ = geodetic_from_ecef(*point)
        return ecef_from_enu(lat, lon)


class Plane(AbstractSurface):
    """The plane through `point_m` with the normal `normal` (any length), in the frame of the rays."""

    point_m: Float[Array, "3"]
    normal: Float[Array, "3"]

    def __init__(self, point_m: Float[Numbers, "3"], normal: Float[Numbers, "3"]):
        """**Raises:** `WhiskjaxError` for other shapes, numbers that are not finite, a normal of no length."""
        arrays = Arrays("Plane")
        self.point_m = jnp.asarray(arrays.take("point_m", point_m, "3", absolute=True, finite=True))
        self.normal = jnp.asarray(arrays.take("normal", normal, "3", finite=True))
        if not is_traced(self.normal) and not np.asarray(self.normal).any():
            arrays.refuse("normal", "is zero, and has no direction")

    def intersect(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, RESULTS]:
        """The one intersection, if it lies in front of the origin."""
        point = tuple(self.point_m[..., i] for i in range(3))
        normal = tuple(self.normal[..., i] for i in range(3))
        climb = dot(normal, direction)
        rise = dot(normal, vsub(point, origin))
        misses = climb * rise <= 0
        s = rise / jnp.where(misses, 1.0, climb)
        return vadd(origin, scale(s, direction)), failure_if(misses, RESULTS.ray_misses_ground)

    def level(self, point: Vec3) -> Mat3:
        """Up is the normal, towards positive z; north is the y axis of the frame, laid into the plane.

        A plane across the y axis has no north, and the numbers are not finite.
        """
        normal = tuple(self.normal[..., i] for i in range(3))
        up = scale(jnp.where(normal[2] < 0, -1.0, 1.0) / norm(normal), normal)
        north = vsub((0, 1, 0), scale(up[1], up))
        north = scale(1 / norm(north), north)
        return transpose((cross(north, up), north, up))
