"""What a careful person would say about a calibration: consistency, correlations, unknowns that only the prior holds."""

import math
from collections.abc import Sequence

import numpy as np
from jax.scipy.special import gammaincc
from jaxtyping import Float

from .posterior import Posterior
from .unknown import Unknown

_CORRELATED, _INSEPARABLE = 0.9, 0.95
_PRIOR_ONLY = 0.05
_UNLIKELY = 1e-4


def chi_square_tail(value: float, freedom: int) -> float:
    """Probability that a chi-square variable of this many degrees of freedom exceeds the value."""
    return float(gammaincc(0.5 * freedom, 0.5 * value)) if freedom > 0 else 1.0


def consistency(cost: float, freedom: int) -> tuple[float, float, bool]:
    """Global model test of a weighted least-squares fit.

    **Arguments:** `cost`: sum of squared whitened residuals, priors included; `freedom`: their number less the unknowns.

    **Returns:** the variance factor (1 where residuals are as large as their sigmas say), the probability of a larger one, and
    whether the fit is sound: not larger than chance explains at 1e-4. Smaller than expected is a warning, not a failure.
    """
    if freedom <= 0:
        return math.nan, 1.0, True
    tail = chi_square_tail(cost, freedom)
    return cost / freedom, tail, tail > _UNLIKELY


def warnings_of(
    unknowns: Sequence[Unknown], posterior: Posterior, factor: float, tail: float, shift: Float[np.ndarray, " k"]
) -> list[str]:
    """Sentences for people, the most serious first.

    **Arguments:** `factor`, `tail`: from `consistency`; `shift`: (solution - prior mean) / prior sigma.
    """
    said = []
    names = [x.name for x in unknowns]
    for direction in posterior.null_space:
        parts = " ".join(f"{v:+.2g} {name}" for name, v in direction.items())
        said.append(f"the data alone do not determine {', '.join(direction)}: moving along {parts} changes no residual")
    if tail <= _UNLIKELY:
        said.append(
            f"the residuals are {math.sqrt(factor):.2f} times as large as their sigmas say (chance: {tail:.0e}): "
            "the model lacks something, or the sigmas are too small, or there are blunders"
        )
    elif tail >= 1 - _UNLIKELY:
        said.append(f"the residuals are {math.sqrt(factor):.2f} times as large as their sigmas say: the sigmas are too large")
    order = [(i, j) for i in range(len(names)) for j in range(i) if abs(posterior.correlation[i, j]) > _CORRELATED]
    for i, j in sorted(order, key=lambda ij: -abs(posterior.correlation[ij])):
        rho = posterior.correlation[i, j]
        kind = "cannot be told apart" if abs(rho) > _INSEPARABLE else "are strongly correlated"
        said.append(f"{names[j]} and {names[i]} {kind}: correlation {rho:+.3f}")
    for name, share, away in zip(names, posterior.data_share, shift, strict=True):
        if share < _PRIOR_ONLY:
            said.append(f"{name} is fixed by its prior: the data took {max(share, 0):.1%} of the prior variance away")
        if not np.isnan(share) and abs(away) > 3:
            said.append(f"{name} ended {abs(away):.1f} prior sigmas from its prior mean")
    return said
