"""Robust losses: how much an observation may pull.

Each turns a whitened residual r of squared length z into one whose half square is rho(z), so that least squares minimises the
robust cost exactly; and each gives the weight w = 2 rho'(z) that the observation has at the solution, for the covariance.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..rules import Arrays, Numbers


class AbstractLoss(eqx.Module):
    """A robust loss of the whitened squared length z of one observation's residual."""

    @abc.abstractmethod
    def factor(self, z: Float[Array, "..."]) -> Float[Array, "..."]:
        """What the residual is multiplied by: sqrt(2 rho(z) / z)."""

    @abc.abstractmethod
    def weight(self, z: Float[Array, "..."]) -> Float[Array, "..."]:
        """Weight of the observation, 1 for a good one."""


def _bound(owner: str, bound: Float[Numbers, ""]) -> Float[Array, ""]:
    return jnp.asarray(Arrays(owner).take("bound", bound, "", finite=True, above=0.0, meaning="a number of sigmas"))


class Huber(AbstractLoss):
    """Quadratic up to `bound` sigmas (of the two-dimensional residual), linear beyond (Huber 1964)."""

    bound: Float[Array, ""]

    def __init__(self, bound: Float[Numbers, ""] = 2.5):
        """**Raises:** `WhiskjaxError` where the bound is no positive number."""
        self.bound = _bound("Huber", bound)

    def factor(self, z):
        """sqrt(2 k s - k^2) / s beyond the bound."""
        far = z > self.bound**2
        safe = jnp.where(far, z, 1.0)
        return jnp.where(far, jnp.sqrt((2 * self.bound * jnp.sqrt(safe) - self.bound**2) / safe), 1.0)

    def weight(self, z):
        """k / s beyond the bound."""
        far = z > self.bound**2
        return jnp.where(far, self.bound / jnp.sqrt(jnp.where(far, z, 1.0)), 1.0)


class Cauchy(AbstractLoss):
    """Logarithmic: a blunder's pull vanishes as 1/s; for gross errors of many sigmas. Needs a start near the solution."""

    bound: Float[Array, ""]

    def __init__(self, bound: Float[Numbers, ""] = 2.5):
        """**Raises:** `WhiskjaxError` where the bound is no positive number."""
        self.bound = _bound("Cauchy", bound)

    def factor(self, z):
        """sqrt(log(1 + z/c^2) / (z/c^2)), its series near zero."""
        x = z / self.bound**2
        small = x < 1e-6
        safe = jnp.where(small, 1.0, x)
        return jnp.sqrt(jnp.where(small, 1 - 0.5 * x, jnp.log1p(safe) / safe))

    def weight(self, z):
        """1 / (1 + z/c^2)."""
        return 1 / (1 + z / self.bound**2)
