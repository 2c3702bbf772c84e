"""Where the filter starts: a point and how far off it may be."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..chain.imaging import image_to_ground
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface
from ..rules import WhiskjaxError, is_traced, raise_failures, require_x64
from ..rules.spread import refuse_covariances
from .looks import Looks

# Horizontal sigmas in degrees beside a height in metres (paper 003, equation 19) differ by 1e5; no target is known so well.
_LIKE_DEGREES = 1e-3


def _array(value: Any) -> Any:
    return value if is_traced(value) else jnp.asarray(value, dtype=jnp.float64)


class Guess(eqx.Module):
    """The target before the first look: a point of the world frame (3,) in metres, covariance (3, 3) in east, north, up.

    **Raises:** `WhiskjaxError` where the covariance is not symmetric and positive definite, or looks like degrees.
    """

    point_m: Float[Array, "3"] = eqx.field(converter=_array)
    covariance_enu_m2: Float[Array, "3 3"] = eqx.field(converter=_array)

    def __check_init__(self):
        require_x64("Guess")
        if self.point_m.shape != (3,) or self.covariance_enu_m2.shape != (3, 3):
            raise WhiskjaxError(
                f"guess: a point {self.point_m.shape} and a covariance {self.covariance_enu_m2.shape}, expected (3,) and (3, 3)"
            )
        if not is_traced(self.point_m) and not np.isfinite(np.asarray(self.point_m)).all():
            raise WhiskjaxError(f"guess: the point {np.asarray(self.point_m).tolist()} is not finite")
        if not is_traced(self.covariance_enu_m2):
            _check_covariance(np.asarray(self.covariance_enu_m2))

    @classmethod
    def around(cls, point_m: Float[ArrayLike, "3"], sigma_enu_m: Float[ArrayLike, "3"]) -> "Guess":
        """A point with independent 1-sigma east, north, up in metres."""
        sigma = _array(sigma_enu_m)
        if sigma.shape != (3,):
            raise WhiskjaxError(f"guess: three sigmas are needed (east, north, up, in metres), not {sigma.shape}")
        return cls(point_m, jnp.diag(sigma * sigma))


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
    sensor: Sensor, looks: Looks, surface: AbstractSurface, sigma_enu_m: Float[ArrayLike, "3"], *, throw: bool = True
) -> Guess:
    """Intersection of the first look that has a measurement with a surface (paper 003, equations 9 and 10).

    **Arguments:** `surface`: `HeightSurface`, `Plane` or anything with their interface; `sigma_enu_m`: how far off the target may
    be, 1-sigma east, north, up.

    **Raises:** `SensorError` where that look's ray misses the surface: a target above the horizon.
    """
    first = jnp.argmin(looks.is_missed)
    # All looks, of which one is used: links may hold records that are aligned with the looks.
    every = image_to_ground(sensor, looks.shot, looks.pixel_px, surface, throw=False)
    if throw:
        raise_failures(jax.tree.map(lambda code: code[first], every.result), "locate: the first look gives no first guess")
    return Guess.around(every.point_m[first], sigma_enu_m)
