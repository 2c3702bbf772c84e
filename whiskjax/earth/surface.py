"""Surfaces that a ray can meet.

Every surface has one method, `intersect(origin, direction) -> (point, result)`, elementwise over any batch of rays. The first
intersection in front of the origin is returned; the direction need not be a unit vector.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.vectors import Mat3, Vec3, cross, dot, mul, norm, scale, transpose, vadd, vsub
from ..rules import RESULTS
from ..rules.results import failure_if
from .ellipsoid import SEMI_MAJOR_M, SEMI_MINOR_M, geodetic_from_ecef
from .frames import ecef_from_enu


def _as_float(value: Any) -> Array:
    return jnp.asarray(value, dtype=float)


class AbstractSurface(eqx.Module):
    """What a ray can be intersected with."""

    @abc.abstractmethod
    def intersect(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, RESULTS]:
        """First point of the surface along the ray, in the frame of the ray."""

    @abc.abstractmethod
    def level(self, point: Vec3) -> Mat3:
        """Rotation world_from_enu at a point: its columns are east, north and up there."""


class HeightSurface(AbstractSurface):
    """All points of one ellipsoidal height: ECEF, metres.

    This is the true surface, not the ellipsoid with lengthened axes, which starts the iteration (the two differ by 0.010 m for a
    look 78 deg off nadir). `height_m` may be a batch: one height for each ray.
    """

    height_m: Float[Array, "..."] = eqx.field(converter=_as_float)

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

    point_m: Float[Array, "3"] = eqx.field(converter=_as_float)
    normal: Float[Array, "3"] = eqx.field(converter=_as_float)

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
