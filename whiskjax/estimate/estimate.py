"""The answer that every verb gives, and that every verb takes as knowledge: numbers with a joint covariance."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..chain.parameters import Places
from ..rules import RESULTS, WhiskjaxError, is_traced
from .unknown import Unit, Unknown, unit_of


class Estimate(eqx.Module):
    """Numbers of a sensor, with all that is known of them at the solution; traceable, and the same in every answer.

    The answer of many runs has a leading axis in each of its arrays.

    Handed to `calibrate`, `adjust` or `locate` among the unknowns, it is their joint prior; as `consider`, numbers whose
    uncertainty counts.

    **Fields** (k numbers):

    - `value`: in the units of the fields (m, rad, s, px), (k,); `covariance`: (k, k), what is considered is in it.
    - `prior_share`: posterior over prior variance, considered numbers left out: 1 where the data said nothing; NaN without a
      prior, (k,).
    - `cost`: sum of squared whitened residuals, priors included, as it would be if what was considered were estimated too;
      chi-square of `freedom` degrees where all is as was said.
    - `result`: how the solution ended.
    - `names`, `places`: of the numbers: for people, and in the sensor.
    """

    value: Float[Any, " k"]
    covariance: Float[Any, "k k"]
    prior_share: Float[Any, " k"]
    cost: Float[Any, ""]
    freedom: Int[Any, ""] | int
    result: RESULTS
    names: tuple[str, ...] = eqx.field(static=True)
    places: Places = eqx.field(static=True)

    @property
    def sigma(self) -> Float[Any, " k"]:
        """1-sigma of each number, in the units of the fields."""
        variance = jnp.diagonal(self.covariance, axis1=-2, axis2=-1)
        return jnp.sqrt(variance) if is_traced(variance) else np.sqrt(np.asarray(variance))

    @property
    def correlation(self) -> Float[Any, "k k"]:
        """Of the numbers; NaN where a sigma is not finite."""
        sigma = self.sigma
        return self.covariance / (sigma[..., :, None] * sigma[..., None, :])

    @property
    def units(self) -> tuple[Unit, ...]:
        """Units for people."""
        return tuple(unit_of(of[0]) for of in self.places)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Each number by itself, with value and sigma as its prior; the correlations are not in them.

        **Raises:** `WhiskjaxError` where one is not determined.
        """
        sigma, value = self.sigma, self.value if is_traced(self.value) else np.asarray(self.value)
        if not is_traced(sigma) and not np.isfinite(sigma).all():
            lost = ", ".join(n for n, s in zip(self.names, sigma, strict=True) if not np.isfinite(s))
            raise WhiskjaxError(f"an estimate that did not determine {lost} is no prior: hand on an answer that is sound")
        numbers = zip(self.names, self.places, value, sigma, strict=True)
        return tuple(Unknown(name, tuple(p.inner for p in of), value, s) for name, of, value, s in numbers)
