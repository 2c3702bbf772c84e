"""A surface on which the target lies, as far as the surface is known: an observation of its height."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..chain.imaging import image_to_ground
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface
from ..rules.results import is_successful
from .looks import Looks

_BESIDE_PX = 1.0  # of rays that find the slope


class Ground(eqx.Module):
    """The plane that touches a surface where the first look meets it: `point_m` and `normal` (unit vector), world frame.

    `sigma_m`: 1-sigma of the target's distance from it. Looks at one target meet the surface near one place, so that the plane is
    the surface there.
    """

    point_m: Float[Array, "3"]
    normal: Float[Array, "3"]
    sigma_m: Float[Array, ""]

    def given(
        self, anchor_m: Float[Array, "3"], covariance_m2: Float[Array, "3 3"]
    ) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        """A place, as the way from an anchor (mean zero, world frame), once its distance from the plane was observed: mean and
        covariance of the way (Kalman's update by a scalar)."""
        crossed = covariance_m2 @ self.normal
        gain = crossed / (self.normal @ crossed + self.sigma_m**2)
        left = jnp.eye(3) - jnp.outer(gain, self.normal)
        covariance = left @ covariance_m2 @ left.T + self.sigma_m**2 * jnp.outer(gain, gain)
        return gain * (self.normal @ (self.point_m - anchor_m)), covariance

    @property
    def information(self) -> Float[Array, "3 3"]:
        """What it says of a place."""
        return jnp.outer(self.normal, self.normal) / self.sigma_m**2


def ground_seen(sensor: Sensor, looks: Looks, surface: AbstractSurface, sigma_m: Float[Array, ""]) -> Ground:
    """Where the first look that has a measurement and a pose meets a surface; not a number where it does not.

    Its slope is that between this ray and two beside it, so that it may be any surface.
    """
    first = jnp.argmax(~looks.is_missed & is_successful(sensor.check(looks.shot)))

    def met(by_px: Float[Array, "2"]) -> Float[Array, "3"]:
        # All looks, of which one is used: links may hold records that are aligned with the looks.
        return image_to_ground(sensor, looks.shot, looks.pixel_px + by_px[None], surface, throw=False).point_m[first]

    point, right, up = (met(_BESIDE_PX * jnp.array(by)) for by in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    normal = jnp.cross(right - point, up - point)
    return Ground(point, normal / jnp.linalg.norm(normal), jnp.asarray(sigma_m))
