"""The global model test: whether residuals are as large as their sigmas say."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaincc as gammaincc_traced
from scipy.special import gammaincc, gammainccinv

from ..rules import arrays_of

UNLIKELY = 1e-4  # what chance explains less often than this, it does not explain
NOTHING = 1e-12  # a variance factor of rounding: measurements that were made with the model itself
FAMILY = 1e-3  # the chance that something is found in a family of clean tests, however many there are


def chi_square_tail(value: Any, freedom: Any) -> Any:
    """Probability that a chi-square variable of this many degrees of freedom exceeds the value; 1 without any. Traceable."""
    if arrays_of((value, freedom)) is np:
        return float(gammaincc(0.5 * float(freedom), 0.5 * float(value))) if freedom > 0 else 1.0
    value, freedom = jnp.asarray(value, dtype=float), jnp.asarray(freedom, dtype=float)
    return jnp.where(freedom > 0, gammaincc_traced(0.5 * jnp.maximum(freedom, 1.0), 0.5 * value), 1.0)


def chi_square_bound(probability: float, freedom: int) -> float:
    """What a chi-square variable exceeds with a probability."""
    return 2 * float(gammainccinv(0.5 * freedom, probability))


def consistency(cost: Any, freedom: Any) -> tuple[Any, Any, Any]:
    """Global model test of a weighted least-squares fit. Traceable.

    **Arguments:** `cost`: sum of squared whitened residuals, priors included; `freedom`: their number less the unknowns.

    **Returns:** the variance factor (1 where residuals are as large as their sigmas say), the probability of a larger one, and
    whether the fit is sound: not larger than chance explains at 1e-4. Smaller than expected is a warning, not a failure.
    """
    xp, tail = arrays_of((cost, freedom)), chi_square_tail(cost, freedom)
    freedom = xp.asarray(freedom, dtype=float)
    there = freedom > 0
    return xp.where(there, xp.asarray(cost) / xp.maximum(freedom, 1.0), np.nan), tail, ~there | (tail > UNLIKELY)
