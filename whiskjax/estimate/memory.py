"""How errors are remembered from exposure to exposure: white, constant, and between them the Ornstein-Uhlenbeck process.

Between two moments an error keeps phi = exp(-dt / tau) of itself and gains sigma^2 (1 - phi^2) of variance (Gelb 1974, equations
4.5-8 and 4.5-9, the first-order Markov process), so that its covariance is sigma^2 exp(-|dt| / tau) at all times.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

WHITE, FADING, CONSTANT = "white", "fading", "constant"


def forgotten(step_s: Any, correlation_s: Any) -> Any:
    """phi = exp(-dt / tau), what is left of an error after some seconds; of one without memory 1 at once, and then 0."""
    tau = jnp.asarray(correlation_s, dtype=float)
    return jnp.where(tau > 0, jnp.exp(-step_s / jnp.where(tau > 0, tau, 1.0)), jnp.where(step_s == 0, 1.0, 0.0))


def correlation(
    memory: str, correlation_s: Any, time_s: Float[Array, " n"] | None, same: Bool[Array, "n n"], exposures: int
) -> Float[Array, "n n"]:
    """The correlation between exposures; 0 where they do not share a draw."""
    if memory == WHITE:
        return jnp.eye(exposures)
    shared = same.astype(float)
    if memory == CONSTANT or time_s is None:
        return shared
    return shared * forgotten(jnp.abs(time_s[:, None] - time_s[None, :]), correlation_s)


def steps(memory: str, correlation_s: Any, time_s: Float[Array, " n"] | None, group: Array, exposures: int) -> Float[Array, " n"]:
    """phi from the exposure before, in the order given; 0 for the first, and where the group changes."""
    if memory == WHITE:
        return jnp.zeros(exposures)
    if memory == CONSTANT or time_s is None:
        kept = jnp.ones(exposures - 1)
    else:
        kept = forgotten(jnp.abs(jnp.diff(time_s)), correlation_s)
    return jnp.concatenate([jnp.zeros(1), jnp.where(group[1:] == group[:-1], kept, 0.0)])


def drawn(
    key: Any, memory: str, correlation_s: Any, time_s: Float[Array, " n"] | None, group: Array, exposures: int
) -> Float[Array, " n"]:
    """One draw at unit sigma, exact for any times in any order: x_i = phi_i x_(i-1) + sqrt(1 - phi_i^2) w_i in the order of time
    within each group of exposures that share a draw."""
    white = jax.random.normal(key, (exposures,), float)
    if memory == WHITE:
        return white
    order = jnp.lexsort((jnp.zeros(exposures) if time_s is None else time_s, group))
    keep = steps(memory, correlation_s, None if time_s is None else time_s[order], group[order], exposures)
    # A root has no derivative at zero, where two exposures are one moment.
    gained = 1 - keep * keep
    fresh = jnp.where(gained > 0, jnp.sqrt(jnp.where(gained > 0, gained, 1.0)), 0.0) * white
    value = jax.lax.associative_scan(lambda a, b: (a[0] * b[0], b[0] * a[1] + b[1]), (keep, fresh))[1]
    return jnp.zeros(exposures).at[order].set(value)
