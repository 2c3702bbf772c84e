"""How well the observations control one another: redundancy numbers, normalised residuals, minimal detectable errors.

Baarda (1968), A testing procedure for use in geodetic networks; here with priors as observations, and for pairs of correlated
pixel coordinates.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .linearised import LeastSquares, Linearised, weighted_rows
from .surveys import triangles

# Non-centrality at which a one-dimensional test at 0.1 % finds an error four times in five: 3.29 + 0.84.
DETECTABLE = 4.13


class Reliability(NamedTuple):
    """For each observation, an entry for both pixel coordinates.

    - `redundancy`: the share of an error in the measurement that its own residual shows, 0 to 1. Over all observations and priors
      they add up to the degrees of freedom; NaN for points that took no part.
    - `normalised`: the residual over its own sigma, standard normal where nothing is wrong. For points that took no part it is
      the error of the prediction over the sigma of prediction and measurement together.
    - `detectable_px`: the smallest error that a test at 0.1 % finds with a probability of 80 %; NaN for points that took no part.
    - `squared`: both coordinates together, chi-square with two degrees of freedom where nothing is wrong (n,).
    """

    redundancy: Float[np.ndarray, "n 2"]
    normalised: Float[np.ndarray, "n 2"]
    detectable_px: Float[np.ndarray, "n 2"]
    squared: Float[np.ndarray, " n"]


class Foreseen(NamedTuple):
    """Each observation beside what those that took part say of the survey of its point, whitened by `weight` (n, 3).

    Where no other ray sees the point that is nothing: `whitened` and `rows` are the residual and its derivatives, `left` zero. Of
    rays of one point they are V^-1 r and V^-1 R where a ray took part, the error of the prediction where it did not, and `left`
    what its survey still adds to the covariance; `alone`, `alone_rows` and `before` are the same before anything was said.
    """

    weight: Float[np.ndarray, "n 3"]
    whitened: Float[np.ndarray, "n 2"]
    rows: Float[np.ndarray, "n 2 k"]
    left: Float[np.ndarray, "n 2 2"]
    alone: Float[np.ndarray, "n 2"]
    alone_rows: Float[np.ndarray, "n 2 k"]
    before: Float[np.ndarray, "n 2 2"]


def foreseen(ready: LeastSquares, here: Linearised, share: Float[np.ndarray, " n"]) -> Foreseen:
    """Where those observations took part that have a share."""
    if ready.surveys is None:
        none = np.zeros((len(share), 2, 2))
        return Foreseen(ready.weight, here.whitened, here.rows, none, here.whitened, here.rows, none)
    joint = ready.joint((share > 0).astype(float))
    triangle = triangles(joint.weight)
    alone, rows = (triangle @ here.residual_px[:, :, None])[..., 0], triangle @ here.rows_px
    said = joint.given_others(alone), joint.given_others(rows), joint.part(joint.left_m2)
    return Foreseen(joint.weight, *said, alone, rows, joint.part(joint.before_m2))


def residual_covariance(
    of: Foreseen, covariance: Float[np.ndarray, "k k"], share: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance of `Foreseen.whitened`: 1 - R C R^T where an observation took part, 1 + R C R^T where it did not.

    Of rays of one point, what their survey has `left` goes the way of R C R^T: it is one more thing that was estimated.
    """
    spread = of.left + of.rows @ covariance @ np.swapaxes(of.rows, -1, -2)
    return np.eye(2) + np.where(share[:, None, None] > 0, -1.0, 1.0) * spread


def whitened_covariance(ready: LeastSquares, here: Linearised, share: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k k"]:
    """Covariance of the whitened unknowns, with what nothing determines left out (pseudo-inverse)."""
    rows, _ = weighted_rows(ready, here, share)
    return np.linalg.pinv(rows.T @ rows, hermitian=True)


def squared_residuals(
    of: Foreseen, covariance: Float[np.ndarray, "k k"], share: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """The normalised squared length of each residual: chi-square with two degrees of freedom where nothing is wrong.

    It tests whether this one ray is off, not its point: a gross error of a survey, which all rays of the point show alike, is
    found in none of them by itself. A residual that is fixed (its observation alone determines an unknown) has nothing to test:
    zero.
    """
    values, vectors = np.linalg.eigh(residual_covariance(of, covariance, share))
    along = np.einsum("nij,ni->nj", vectors, of.whitened)
    free = values > 1e-6
    return (np.where(free, along**2, 0.0) / np.where(free, values, 1.0)).sum(axis=1)


def of_common_points(
    ready: LeastSquares,
    share: Float[np.ndarray, " n"],
    index: Int[np.ndarray, " m"],
    difference: Float[np.ndarray, "m 2"],
    spread: Float[np.ndarray, "m 2 k"],
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2 k"]]:
    """`Foreseen` residuals and derivatives of observations that took no part, whitened further where several see one point.

    The error that is left of the point's coordinates is the same in all of them.
    """
    if ready.surveys is None:
        return difference, spread
    joint, (difference, spread) = ready.joint(share), (difference.copy(), spread.copy())
    is_common = (joint.by[index] != 0).any(axis=(1, 2))
    for point in np.unique(joint.of[index[is_common]]):
        members = np.flatnonzero(is_common & (joint.of[index] == point))
        by = joint.by[index[members]].reshape(-1, 3)
        root = np.linalg.cholesky(np.eye(len(by)) + by @ joint.left_m2[point] @ by.T)
        difference[members] = np.linalg.solve(root, difference[members].ravel()).reshape(-1, 2)
        spread[members] = np.linalg.solve(root, spread[members].reshape(len(by), -1)).reshape(len(members), 2, -1)
    return difference, spread


def log_density(
    of: Foreseen, covariance: Float[np.ndarray, "k k"], share: Float[np.ndarray, " n"], which: Bool[np.ndarray, " n"]
) -> float:
    """Mean logarithm of the density, per px^2, with which observations that took no part were predicted; NaN for none."""
    if not which.any():
        return math.nan
    spread, v = residual_covariance(of, covariance, share)[which], of.whitened[which]
    exponent = np.einsum("ni,nij,nj->n", v, np.linalg.inv(spread), v)
    volume = np.log(np.linalg.det(spread)) - 2 * np.log(of.weight[which, 0] * of.weight[which, 2])
    return float(np.mean(-0.5 * (exponent + volume) - math.log(2 * math.pi)))


def reliability(
    ready: LeastSquares, here: Linearised, covariance: Float[np.ndarray, "k k"], used: Bool[np.ndarray, " n"]
) -> Reliability:
    """Reliability at a solution; `covariance` is that of the whitened unknowns, (k, k).

    Of rays of one point the redundancy is still that of one ray: the diagonal of Q V^-1, with Q the covariance of all residuals.
    """
    share = used.astype(float)
    of = foreseen(ready, here, share)
    tested = residual_covariance(of, covariance, share)
    triangle = triangles(of.weight)
    to_px = np.linalg.inv(triangle)
    turned = covariance @ np.swapaxes(of.alone_rows, -1, -2)
    own = np.eye(2) + of.before - of.alone_rows @ turned
    variance_px2 = np.einsum("nai,nij,naj->na", to_px, np.where(used[:, None, None], own, tested), to_px)
    redundancy = np.einsum("nai,nij,nja->na", to_px, np.eye(2) - np.swapaxes(of.rows @ turned, -1, -2), triangle)
    # An error of one pixel in coordinate a moves the whitened observation along column a of the triangle.
    shown = np.einsum("nia,nij,nja->na", triangle, tested, triangle)
    free = redundancy > 1e-6
    detectable = np.where(free, DETECTABLE / np.sqrt(np.where(free, shown, 1.0)), math.inf)
    residual_px = np.where(used[:, None], here.residual_px, (to_px @ of.whitened[:, :, None])[..., 0])
    free = np.where(used[:, None], free, True)
    return Reliability(
        redundancy=np.where(used[:, None], redundancy, math.nan),
        normalised=np.where(free, residual_px, 0.0) / np.sqrt(np.where(free, variance_px2, 1.0)),
        detectable_px=np.where(used[:, None], detectable, math.nan),
        squared=squared_residuals(of, covariance, share),
    )
