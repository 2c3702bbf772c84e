"""Whether looks determine a target, and whether a filter ended where they say it is."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .all_looks import Solved
from .filter import Belief
from .ground import Ground
from .model import Model
from .problem import as_matrix

# A filter that ends so many sigmas from least squares of its own looks has diverged.
_DIVERGED_SIGMAS = 5.0
_WILD_NIS = 2 * _DIVERGED_SIGMAS**2


def weakest(
    model: Model, prior: Belief, solved: Solved, ground: Ground | None = None
) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """The direction (unit vector, axes of the world) in which the looks know the position least, and its 1-sigma in metres.

    The prior of the position takes no part, but for a `ground` where one is given; velocity and nuisances have theirs.
    """
    share = jnp.asarray(model.share, dtype=float)
    information = solved.equations.data * jnp.outer(share, share)
    own, rest = information[:3, :3], information[3:, 3:]
    if ground is not None:
        own = own + ground.information
    if len(share) > 3:
        known = jnp.stack([jnp.stack([jnp.asarray(c, dtype=float) for c in row[3:]]) for row in prior.covariance[3:]])
        own = own - information[:3, 3:] @ jnp.linalg.solve(rest + jnp.linalg.inv(known), information[3:, :3])
    # An eigenvalue below rounding is none: the sigma then is beyond any distance.
    values, vectors = jnp.linalg.eigh(own)
    rounding = 1e-14 * values[2]
    least = jnp.where(values[0] > rounding, values[0], rounding)
    return vectors[:, 0], 1 / jnp.sqrt(least)


def has_diverged(
    model: Model,
    state: Float[Array, " n"],
    covariance: Float[Array, "n n"],
    nis: Float[Array, " looks"],
    used: Bool[Array, " looks"],
    solved: Solved,
) -> Bool[Array, ""]:
    """Whether a filter's end differs from least squares of the looks that it used by more than both can be wrong.

    Where residuals are larger than their sigmas say, both are believed that much less: a filter that ignores an error source is
    inconsistent, but has not diverged. A target with accelerations, of which a batch knows nothing, is judged by its innovations.
    """
    if model.density is not None:
        late = used & (jnp.arange(used.shape[0]) >= used.shape[0] // 2)
        return ~(jnp.where(late, nis, 0.0).sum() <= _WILD_NIS * late.sum(dtype=float))
    share = jnp.asarray(model.share, dtype=float)
    factor = jnp.maximum(1.0, solved.cost / jnp.maximum(2.0 * used.sum(dtype=float), 1.0))
    spread = factor * (covariance + solved.covariance) * jnp.outer(share, share) + jnp.diag(1 - share)
    away = (state - solved.state) * share
    return ~(away @ jnp.linalg.solve(spread, away) <= _DIVERGED_SIGMAS**2)


def off_optimum(model: Model, state: Float[Array, " n"], solved: Solved) -> Float[Array, ""]:
    """How far a filter's end is from least squares of the looks that it used: in sigmas of that, along the way between them.

    Of a target with accelerations least squares knows nothing, and numbers that are only considered weigh on the looks of a
    filter, but not on its: not a number.
    """
    if 0 in model.share:
        return jnp.full((), jnp.nan)
    away = state - solved.state
    squared = away @ jnp.linalg.solve(solved.covariance, away)
    off = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1.0)), 0.0)
    if model.density is None:
        return off
    return jnp.where((as_matrix(model.density) != 0).any(), jnp.nan, off)


def convergence(sight: Float[Array, "looks 3"], used: Bool[Array, " looks"]) -> Float[Array, ""]:
    """The largest angle between two of the used lines of sight (unit vectors), in radians; zero for fewer than two."""
    both = used[:, None] & used[None, :]
    difference = jnp.linalg.norm(jnp.where(both[:, :, None], sight[:, None, :] - sight[None, :, :], 0.0), axis=-1).ravel()
    half = difference[difference.argmax()] / 2  # the derivative of a maximum asks for equality, which computing anew spoils
    return 2 * jnp.arcsin(jnp.where(half < 1, half, 1.0))
