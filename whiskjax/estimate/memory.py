"""How errors are remembered from exposure to exposure: white, constant, and between them the Ornstein-Uhlenbeck process.

Between two moments an error keeps phi = exp(-dt / tau) of itself and gains sigma^2 (1 - phi^2) of variance (Gelb 1974, equations
4.5-8 and 4.5-9, the first-order Markov process), so that its covariance is sigma^2 exp(-|dt| / tau) at all times.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..rules import arrays_of, plain

WHITE, FADING, CONSTANT = "white", "fading", "constant"


def forgotten(step_s: Any, correlation_s: Any) -> Any:
    """phi = exp(-dt / tau), what is left of an error after some seconds; of one without memory 1 at once, and then 0."""
    math = arrays_of((step_s, correlation_s))
    tau = math.asarray(correlation_s, dtype=float)
    return math.where(tau > 0, math.exp(-step_s / math.where(tau > 0, tau, 1.0)), math.where(step_s == 0, 1.0, 0.0))


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
    math = arrays_of((correlation_s, time_s, group))
    if memory == WHITE:
        return math.zeros(exposures)
    if memory == CONSTANT or time_s is None:
        kept = math.ones(exposures - 1)
    else:
        kept = forgotten(math.abs(math.diff(time_s)), correlation_s)
    return math.concatenate([math.zeros(1), math.where(group[1:] == group[:-1], kept, 0.0)])


def drawn(
    white: Any, acting: Sequence[int], memory: Sequence[str], correlation_s: Sequence[Any], time_s: Any, group: Any
) -> list[Any]:
    """Draws of unit sigma, (n,) each, of independent white ones (components, n); exact for any times in any order.

    In the order of time, within each group of exposures that share a draw, x_i = phi_i x_(i-1) + sqrt(1 - phi_i^2) w_i.
    Components that are not `acting` stay white.
    """
    found, constant, fading = list(white), *([k for k in acting if memory[k] == kind] for kind in (CONSTANT, FADING))
    if not constant and not fading:
        return found
    # What is known of the exposures is put in order on the host, also where the errors are traced.
    math, n = arrays_of((time_s, group)), white.shape[1]
    group = math.asarray(group)
    order = math.lexsort((math.zeros(n) if time_s is None else math.asarray(time_s), group))
    first = order[math.searchsorted(group[order], group)]  # of the exposures that share the draw
    for k in constant:
        found[k] = white[k][first]
    if fading:
        each = [steps(FADING, correlation_s[k], math.asarray(time_s)[order], group[order], n) for k in fading]
        math = arrays_of(each)
        keep = math.stack(each, axis=1)
        # A root has no derivative at zero, where two exposures are one moment.
        gained = 1 - keep * keep
        root = math.where(gained > 0, math.sqrt(math.where(gained > 0, gained, 1.0)), 0.0)
        fresh = root * white[np.array(fading)][:, order].T
        start = jnp.zeros(len(fading))
        course = jax.lax.scan(lambda x, step: (step[0] * x + step[1],) * 2, start, (keep, fresh))[1]
        value = plain(course)[arrays_of(order).argsort(order)]
        for j, k in enumerate(fading):
            found[k] = value[:, j]
    return found
