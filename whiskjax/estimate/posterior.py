"""What the data said: covariance, the share that is not prior, structural rank with the names of the null space.

Host side (numpy): small matrices, once, after the solver; kept apart from it so that any solver can be judged.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..rules import arrays_of

# A direction counts as undetermined where its singular value, columns scaled to one, is below this share of the largest: well
# above what rounding leaves of an exact zero (1e-13), well below the weakest real ones seen (1e-9 in the 12 unknowns of Jin et
# al. 2024).
RANK_TOLERANCE = 1e-11
_NAMED_SHARE = 0.1


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Second moments of the unknowns at the solution, in the unit of their fields (m, rad, s, px).

    `data_share` is 1 - sigma_post^2 / sigma_prior^2, the part of the prior variance that the data removed (NaN without a prior);
    `rank`, `null_space` and `untouched` speak of the data alone, without priors: the number of combinations that they determine,
    moves of the unknowns that change no residual (in the units of the fields; the largest part is one prior sigma or scale), and
    unknowns that no observation depends on. `condition` is that of the column-scaled data Jacobian.
    """

    covariance: Float[np.ndarray, "k k"]
    sigma: Float[np.ndarray, " k"]
    correlation: Float[np.ndarray, "k k"]
    data_share: Float[np.ndarray, " k"]
    rank: int
    null_space: tuple[dict[str, float], ...]
    untouched: tuple[str, ...]
    condition: float

    @property
    def is_determined(self) -> bool:
        """Whether observations and priors together determine every unknown."""
        return bool(np.isfinite(self.sigma).all())

    def widened(self, extra: Float[np.ndarray, "k k"]) -> "Posterior":
        """The same with a further covariance; what the data said (shares, rank, null space) stays."""
        covariance = self.covariance + extra
        sigma = np.sqrt(np.diag(covariance))
        return dataclasses.replace(self, covariance=covariance, sigma=sigma, correlation=covariance / np.outer(sigma, sigma))


class Rank(NamedTuple):
    """Structural rank of a Jacobian, its columns scaled to length one; of its right singular vectors (k, k), those from `rank` on
    span the null space. `length` is that of the columns, 1 for zeros; `condition` that of the scaled Jacobian.

    So scaled, the parts of a null vector say what each unknown does to the residuals, whatever its unit.
    """

    rank: Any
    vectors: Float[Any, "k k"]
    length: Float[Any, " k"]
    condition: Any


def rank_of(jacobian: Float[Any, "rows k"]) -> Rank:
    """The rank, traced or not."""
    math, k = arrays_of(jacobian), jacobian.shape[1]
    length = math.linalg.norm(jacobian, axis=0)
    length = math.where(length > 0, length, 1.0)
    scaled = jacobian / length[None]
    triangle = math.linalg.qr(scaled, mode="r") if scaled.shape[0] > k else scaled
    _, values, vectors = math.linalg.svd(triangle, full_matrices=True)
    values = math.concatenate([values, np.zeros(k - len(values))])
    rank = ((values > RANK_TOLERANCE * values[0]) & (values > 0)).sum()
    condition = math.where(values[-1] > 0, values[0] / math.where(values[-1] > 0, values[-1], 1.0), math.inf)
    return Rank(rank, vectors, length, condition)


def directions(found: Rank, scale: Float[np.ndarray, " k"], names: Sequence[str]) -> tuple[dict[str, float], ...]:
    """Moves of the unknowns that change no residual, in the units of the fields; the largest part is one `scale`."""
    null = _separate(found.vectors[int(found.rank) :])
    return tuple(_named(v, v / found.length, scale, names) for v in null)


def _separate(null: Float[np.ndarray, "nullity k"]) -> Float[np.ndarray, "nullity k"]:
    """The same space with a reduced echelon basis: each vector names as few unknowns as possible."""
    basis = null.copy()
    for row in range(len(basis)):
        pivot = int(np.argmax(np.abs(basis[row])))
        basis[row] /= basis[row, pivot]
        for other in range(len(basis)):
            if other != row:
                basis[other] -= basis[other, pivot] * basis[row]
    return basis / np.abs(basis).max(axis=1, keepdims=True) if len(basis) else basis


def _named(
    effect: Float[np.ndarray, " k"], move: Float[np.ndarray, " k"], scale: Float[np.ndarray, " k"], names: Sequence[str]
) -> dict[str, float]:
    """A move that changes nothing, in the units of the fields; parts that hardly act on the residuals are left out."""
    acting = np.abs(effect) > _NAMED_SHARE
    move = np.where(acting, move, 0.0)
    return {names[i]: float(move[i] * scale[i] / np.abs(move).max()) for i in np.flatnonzero(acting).tolist()}


def posterior(
    jacobian: Float[np.ndarray, "rows k"],
    scale: Float[np.ndarray, " k"],
    prior: Float[np.ndarray, "k k"],
    names: Sequence[str],
) -> Posterior:
    """Posterior of whitened least squares.

    **Arguments:**

    - `jacobian`: of the whitened observation residuals by the whitened unknowns, priors left out.
    - `scale`: what one whitened unit is, in the unknown's own unit.
    - `prior`: root of the priors' information, whitened: their residuals are prior @ u; zero rows without a prior.
    - `names`: of the unknowns.
    """
    k = len(scale)
    found = rank_of(jacobian)
    has_prior = (prior != 0).any(axis=1)
    full = np.concatenate([jacobian, prior[has_prior]])
    total = rank_of(full)
    if total.rank < k:
        # Unknowns with a part in the null space of everything have no variance; the others keep theirs (pseudo-inverse).
        whitened = np.linalg.pinv(full.T @ full, hermitian=True, rcond=RANK_TOLERANCE)
        lost = (np.abs(_separate(total.vectors[total.rank :])) > 1e-6).any(axis=0)
        whitened[lost, :] = whitened[:, lost] = np.nan
        whitened[lost, lost] = np.inf
    else:
        inverse = np.linalg.inv(np.linalg.qr(full, mode="r"))
        whitened = inverse @ inverse.T
    sigma_u = np.sqrt(np.diag(whitened))
    covariance = whitened * np.outer(scale, scale)
    with np.errstate(invalid="ignore"):
        correlation = whitened / np.outer(sigma_u, sigma_u)
        share = np.where(has_prior, 1 - sigma_u**2, np.nan)
    untouched = (jacobian == 0).all(axis=0)
    named = tuple(name for name, unseen in zip(names, untouched, strict=True) if unseen)
    sigma, moves = sigma_u * scale, directions(found, scale, names)
    return Posterior(covariance, sigma, correlation, share, int(found.rank), moves, named, float(found.condition))
