"""The residuals of all looks at a solution, as the checks of a verdict ask them."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..estimate.fitted import Dense
from .all_looks import Solved, at_last
from .filter import Belief
from .innovations import whitened
from .model import Model

# Of a pattern's square. Looks are linearised at recorded poses, whose errors (a thousandth of the way to the target) shift what
# the fit leaves of a pattern that it takes but for a thousandth.
_VISIBLE = 1e-3


class Residuals(eqx.Module):
    """Least squares of the looks that were used, linearised where it ended.

    `white`, `rows`: residuals and their derivatives by the whole state over a factor of the covariance of all looks; the prior of
    the state by its `information` and `pull`, that times the state less its mean. `noise` (in sigmas of the pixel, `sigma_px`),
    `effects` and `keep` say how anything else is whitened like them (innovations.py). `by_target_px`: derivatives of the pixels
    by the target's place, world frame.
    """

    white: Float[Array, "looks 2"]
    rows: Float[Array, "looks 2 n"]
    information: Float[Array, "n n"]
    pull: Float[Array, " n"]
    noise: Float[Array, "looks 2 2"]
    effects: Float[Array, "looks 2 m"]
    keep: Float[Array, "looks m"]
    sigma_px: Float[Array, "looks 2"]
    by_target_px: Float[Array, "looks 2 3"]

    @classmethod
    def of(cls, model: Model, prior: Belief, found: Solved) -> "Residuals":
        """At a solution."""
        mean, spread = at_last(model, prior)
        information, at = jnp.linalg.inv(spread), found.equations
        m = at.effects.shape[-1]
        keep = jnp.stack([*model.remembered.keep], -1) if m else jnp.zeros((len(at.noise), 0))
        sigma = jnp.broadcast_to(jnp.stack([jnp.asarray(s, dtype=float) for s in model.sigma_px], -1), at.residual.shape)
        pull = information @ (found.state - mean)
        by_target = at.rows[..., :3] * sigma[..., None]
        return cls(at.white, -at.white_rows, information, pull, at.noise, at.effects, keep, sigma, by_target)

    def fitted(self) -> Dense:
        """For the checks."""
        white, rows, information, pull = (np.asarray(part) for part in (self.white, self.rows, self.information, self.pull))
        part = (rows != 0).any(axis=(1, 2))

        def whitener(pattern_px: Any) -> Any:
            columns = pattern_px / np.asarray(self.sigma_px)[:, :, None]
            return np.asarray(whitened(self.noise, self.effects, self.keep, jnp.asarray(part), jnp.asarray(columns)))

        return Dense(white, rows, information, pull, whitener, _VISIBLE)
