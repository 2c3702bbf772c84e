"""Where the filter starts: a point and how far off it may be."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..chain.imaging import image_to_ground
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface, need_surface
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced, need, need_flags, raise_failures, require_x64
from ..rules.spread import refuse_covariances
from .looks import Looks

# Horizontal sigmas in degrees beside a height in metres (Liu et al. 2019, equation 19) differ by 1e5; no target is known so well.
_LIKE_DEGREES = 1e-3


class Guess(eqx.Module):
    """The target before the first look: a point of the world frame (3,) in metres, covariance (3, 3) in east, north, up.

    **Raises:** `WhiskjaxError` where the covariance is not symmetric and positive definite, or looks like degrees.
    """

    point_m: Float[Array, "3"] = eqx.field(converter=jnp.asarray)
    covariance_enu_m2: Float[Array, "3 3"] = eqx.field(converter=jnp.asarray)

    def __init__(self, point_m: Float[Numbers, "3"], covariance_enu_m2: Float[Numbers, "3 3"]):
        require_x64("Guess")
        arrays = Arrays("Guess")
        self.point_m = arrays.take("point_m", point_m, "3", absolute=True, finite=True, meaning="x, y, z of the world frame")
        self.covariance_enu_m2 = arrays.take("covariance_enu_m2", covariance_enu_m2, "3 3")

    def __check_init__(self):
        if not is_traced(self.covariance_enu_m2):
            _check_covariance(np.asarray(self.covariance_enu_m2))

    @classmethod
    def around(cls, point_m: Float[Numbers, "3"], sigma_enu_m: Float[Numbers, "3"]) -> "Guess":
        """A point with independent 1-sigma east, north, up in metres."""
        sigma = jnp.asarray(take_sigma(Arrays("Guess.around"), sigma_enu_m))
        return cls(point_m, jnp.diag(sigma * sigma))


def take_sigma(arrays: Arrays, sigma_enu_m: Float[Numbers, "3"]) -> Float[Array, "3"]:
    """How far off a target may be, 1-sigma east, north, up, as somebody's argument of that name."""
    return arrays.take("sigma_enu_m", sigma_enu_m, "3", finite=True, above=0.0, meaning="east, north, up, in metres")


def _check_covariance(covariance: Float[np.ndarray, "3 3"]) -> None:
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T, rtol=1e-9, atol=0):
        raise WhiskjaxError("guess: the covariance must be finite and symmetric")
    least = float(np.linalg.eigvalsh(covariance)[0])
    if not least > 0:
        raise WhiskjaxError(f"guess: the covariance must be positive definite, but its least eigenvalue is {least:g} m^2")
    refuse_covariances(covariance[None], lambda _: "guess: covariance_enu_m2")
    east, north, up = np.sqrt(np.diag(covariance))
    if max(east, north) < _LIKE_DEGREES * up:
        raise WhiskjaxError(
            f"guess: 1-sigma of {east:g} m east and {north:g} m north beside {up:g} m in height look like degrees; all are "
            "metres (0.015 deg of latitude are 1670 m)"
        )


def first_guess(
    sensor: Sensor, looks: Looks, surface: AbstractSurface, sigma_enu_m: Float[Numbers, "3"], *, throw: bool = True
) -> Guess:
    """Intersection of the first look that has a measurement with a surface (Liu et al. 2019, equations 9 and 10).

    **Arguments:** `surface`: `HeightSurface`, `Plane` or anything with their interface; `sigma_enu_m`: how far off the target may
    be, 1-sigma east, north, up.

    **Raises:** `SensorError` where that look's ray misses the surface: a target above the horizon.
    """
    need("first_guess", "looks", looks, Looks)
    need_flags("first_guess", throw=throw)
    need_surface("first_guess", surface)
    take_sigma(Arrays("first_guess"), sigma_enu_m)
    first = jnp.argmin(looks.is_missed)
    # All looks, of which one is used: links may hold records that are aligned with the looks.
    every = image_to_ground(sensor, looks.shot, looks.pixel_px, surface, throw=False)
    if throw:
        raise_failures(jax.tree.map(lambda code: code[first], every.result), "locate: the first look gives no first guess")
    return Guess.around(every.point_m[first], sigma_enu_m)
