"""Whitens what looks say by the innovations of the errors that they share (Kailath 1968).

The covariance of all looks is C = D + E K E^T: what is new at each of them, and what a few errors of remembered poses do to all.
A Kalman filter that follows these errors from look to look tells of each look what the ones before it foretold. What is left, its
innovation, is independent of theirs, so that innovations over their own Cholesky factors are L^-1 y, with C = L L^T. That takes
time in proportion to the number of looks, where C itself takes its third power.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def whitened(
    noise: Float[Array, "looks 2 2"],
    effects: Float[Array, "looks 2 m"],
    keep: Float[Array, "looks m"],
    part: Bool[Array, " looks"],
    columns: Float[Array, "looks 2 c"],
) -> Float[Array, "looks 2 c"]:
    """L^-1 of some columns; zero for looks that take no part, of which the others know nothing.

    **Arguments:**

    - `noise`: D, of each look alone.
    - `effects`: E, what one sigma of each error does to a look; with none of them, m = 0, looks are independent.
    - `keep`: what each error keeps of itself from the look before; 0 where it is drawn anew.
    """
    if effects.shape[-1] == 0:
        return jnp.where(part[:, None, None], _forward(_factor(noise), columns), 0.0)

    def one(carry: tuple[Array, Array], look: Any) -> tuple[tuple[Array, Array], Array]:
        covariance, state = carry
        noise, effect, keep, part, column = look
        covariance = covariance * (keep[:, None] * keep[None, :]) + jnp.diag(1 - keep * keep)
        state = state * keep[:, None]
        crossed = effect @ covariance
        factor = _factor(noise + effect @ crossed.T)
        new = jnp.where(part, _forward(factor, column - effect @ state), 0.0)
        gain = jnp.where(part, _forward(factor, crossed), 0.0)
        return (covariance - gain.T @ gain, state + gain.T @ new), new

    m, c = effects.shape[-1], columns.shape[-1]
    return jax.lax.scan(one, (jnp.eye(m), jnp.zeros((m, c))), (noise, effects, keep, part, columns))[1]


def _factor(pairs: Float[Array, "... 2 2"]) -> tuple[Array, Array, Array]:
    """The Cholesky factor (l00, l10, l11)."""
    l00 = jnp.sqrt(pairs[..., 0, 0])
    l10 = pairs[..., 1, 0] / l00
    return l00, l10, jnp.sqrt(pairs[..., 1, 1] - l10 * l10)


def _forward(factor: tuple[Array, Array, Array], columns: Float[Array, "... 2 c"]) -> Float[Array, "... 2 c"]:
    """L^-1 of pairs of rows."""
    l00, l10, l11 = (entry[..., None] for entry in factor)
    first = columns[..., 0, :] / l00
    return jnp.stack([first, (columns[..., 1, :] - l10 * first) / l11], -2)
