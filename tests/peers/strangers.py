"""A surface and a camera that whiskjax does not have: somebody else's, by the interfaces alone."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from whiskjax.algebra.vectors import Component, Mat3, Vec2, Vec3, cross, dot, norm, scale, transpose, vadd
from whiskjax.chain.camera import AbstractCamera
from whiskjax.chain.shot import Shot
from whiskjax.earth.surface import AbstractSurface
from whiskjax.rules import RESULTS
from whiskjax.rules.results import failure_if


def _number(value: Any) -> Array:
    return jnp.asarray(value, dtype=float)


class Sphere(AbstractSurface):
    """A ball about the origin of the world: a moon. `radius_m` may be a batch, one radius for each ray."""

    radius_m: Float[Array, "..."] = eqx.field(converter=_number)

    def intersect(self, origin: Vec3, direction: Vec3) -> tuple[Vec3, RESULTS]:
        """The near root of |origin + s direction| = radius, without cancellation."""
        square, climb = dot(direction, direction), dot(origin, direction)
        beyond = dot(origin, origin) - self.radius_m**2
        discriminant = climb * climb - square * beyond
        misses = (discriminant <= 0) | (climb >= 0) | (beyond < 0)
        s = beyond / (jnp.sqrt(jnp.where(misses, 1.0, discriminant)) - jnp.where(misses, -1.0, climb))
        return vadd(origin, scale(s, direction)), failure_if(misses, RESULTS.ray_misses_ground)

    def level(self, point: Vec3) -> Mat3:
        """Columns east, north and up."""
        up = scale(1 / norm(point), point)
        east = cross((0, 0, 1), up)
        east = scale(1 / norm(east), east)
        return transpose((east, cross(up, east), up))


class CubicLine(AbstractCamera):
    """LRO's NAC as usgscsm has it: what lies at y on the detector, along the y axis, belongs at u = y / (1 + k y^2).

    Pixels are (sample, line offset), the first centre at 0.5: y = (sample_step sample - centre) / per_mm.
    """

    focal_mm: Float[Array, ""] = eqx.field(converter=_number)
    k: Float[Array, ""] = eqx.field(default=0.0, converter=_number)
    per_mm: Float[Array, ""] = eqx.field(default=1.0, converter=_number)
    centre: Float[Array, ""] = eqx.field(default=0.0, converter=_number)
    sample_step: Float[Array, ""] = eqx.field(default=1.0, converter=_number)

    @property
    def is_line(self) -> bool:
        """Yes."""
        return True

    def at(self, shot: Shot) -> "CubicLine":
        """The same for every shot."""
        return self

    def check(self, shot: Shot) -> RESULTS:
        """The same for every shot."""
        return RESULTS.successful

    def direction(self, pixel: Vec2) -> Vec3:
        """Direction of a (sample, line offset)."""
        y = (self.sample_step * pixel[0] - self.centre) / self.per_mm
        return pixel[1] * self.sample_step / self.per_mm, y / (1 + self.k * y * y), -self.focal_mm

    def pixel(self, q: Vec3) -> Vec2:
        """(sample, line offset) of a direction: u k y^2 - y + u = 0, the root that goes with k through 0."""
        x, u = (self.focal_mm * c / -q[2] for c in q[:2])
        y = 2 * u / (1 + jnp.sqrt(1 - 4 * self.k * u * u))
        return (self.per_mm * y + self.centre) / self.sample_step, x * self.per_mm / self.sample_step

    def check_direction(self, q: Vec3) -> RESULTS:
        """In front of the camera."""
        return failure_if(~(q[2] < 0), RESULTS.point_behind_camera)

    def check_pixel(self, pixel: Vec2) -> RESULTS:
        """Every pixel has a direction."""
        return RESULTS.successful

    def sees(self, pixel: Vec2) -> bool:
        """The detector's ends are not known here."""
        return True

    def ends(self) -> None:
        """Not known."""

    def miss(self, q: Vec3) -> Component:
        """The detector lies in the plane x = 0: tangent of half the angle beside it."""
        return q[0] / (norm((q[0], q[2])) - q[2])
