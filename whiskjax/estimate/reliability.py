"""How well the observations control one another: redundancy numbers, normalised residuals, minimal detectable errors.

Baarda (1968), A testing procedure for use in geodetic networks; here with priors as observations, and for pairs of correlated
pixel coordinates.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .linearised import LeastSquares, Linearised, weighted_rows

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


def residual_covariance(
    here: Linearised, covariance: Float[np.ndarray, "k k"], share: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance of the whitened residuals: 1 - R C R^T where an observation took part, 1 + R C R^T where it did not."""
    spread = here.rows @ covariance @ np.swapaxes(here.rows, -1, -2)
    return np.eye(2) + np.where(share[:, None, None] > 0, -1.0, 1.0) * spread


def whitened_covariance(ready: LeastSquares, here: Linearised, share: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k k"]:
    """Covariance of the whitened unknowns, with what nothing determines left out (pseudo-inverse)."""
    rows, _ = weighted_rows(ready, here, share)
    return np.linalg.pinv(rows.T @ rows, hermitian=True)


def squared_residuals(
    here: Linearised, covariance: Float[np.ndarray, "k k"], share: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """The normalised squared length of each residual: chi-square with two degrees of freedom where nothing is wrong.

    A residual that is fixed (its observation alone determines an unknown) has nothing to test: zero.
    """
    values, vectors = np.linalg.eigh(residual_covariance(here, covariance, share))
    along = np.einsum("nij,ni->nj", vectors, here.whitened)
    free = values > 1e-6
    return (np.where(free, along**2, 0.0) / np.where(free, values, 1.0)).sum(axis=1)


def of_common_points(
    ready: LeastSquares, index: Int[np.ndarray, " m"], difference: Float[np.ndarray, "m 2"], spread: Float[np.ndarray, "m 2 k"]
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2 k"]]:
    """Whitened residuals and derivatives of some observations, whitened further where several see one point.

    The error of the point's coordinates is the same in all of them; the weights take each by itself.
    """
    covariance = ready.observations.point_covariance_m2
    if covariance is None:
        return difference, spread
    difference, spread = difference.copy(), spread.copy()
    _, of, count = np.unique(ready.observations.point_m[index], axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(of.ravel(), kind="stable")
    for members in np.split(order, np.cumsum(count)[:-1]):
        if len(members) > 1:
            rows = _triangles(ready.weight[index[members]]) @ ready.follows[index[members]]
            whole = rows.reshape(-1, 3) @ covariance[index[members[0]]] @ rows.reshape(-1, 3).T
            own = np.kron(np.eye(len(members)), np.ones((2, 2)))
            root = np.linalg.cholesky(np.where(own > 0, np.eye(len(own)), whole))
            difference[members] = np.linalg.solve(root, difference[members].ravel()).reshape(-1, 2)
            flat = spread[members].reshape(len(own), -1)
            spread[members] = np.linalg.solve(root, flat).reshape(len(members), 2, -1)
    return difference, spread


def _triangles(weight: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2 2"]:
    """The lower triangles that whiten pairs of pixel coordinates, as matrices."""
    w00, w10, w11 = weight.T
    return np.stack([np.stack([w00, np.zeros_like(w00)], -1), np.stack([w10, w11], -1)], -2)


def log_density(
    ready: LeastSquares, here: Linearised, covariance: Float[np.ndarray, "k k"], which: Bool[np.ndarray, " n"]
) -> float:
    """Mean logarithm of the density, per px^2, with which observations that took no part were predicted; NaN for none."""
    if not which.any():
        return math.nan
    spread = residual_covariance(here, covariance, np.zeros(len(which)))[which]
    v = here.whitened[which]
    exponent = np.einsum("ni,nij,nj->n", v, np.linalg.inv(spread), v)
    volume = np.log(np.linalg.det(spread)) - 2 * np.log(ready.weight[which, 0] * ready.weight[which, 2])
    return float(np.mean(-0.5 * (exponent + volume) - math.log(2 * math.pi)))


def reliability(
    ready: LeastSquares, here: Linearised, covariance: Float[np.ndarray, "k k"], used: Bool[np.ndarray, " n"]
) -> Reliability:
    """Reliability at a solution; `covariance` is that of the whitened unknowns, (k, k)."""
    share = used.astype(float)
    whitened = residual_covariance(here, covariance, share)
    triangle = _triangles(ready.weight)
    to_px = np.linalg.inv(triangle)
    variance_px2 = np.einsum("nai,nij,naj->na", to_px, whitened, to_px)
    redundancy = np.einsum("nai,nij,nja->na", to_px, whitened, triangle)
    # An error of one pixel in coordinate a moves the whitened observation along column a of the triangle.
    shown = np.einsum("nia,nij,nja->na", triangle, whitened, triangle)
    free = redundancy > 1e-6
    detectable = np.where(free, DETECTABLE / np.sqrt(np.where(free, shown, 1.0)), math.inf)
    return Reliability(
        redundancy=np.where(used[:, None], redundancy, math.nan),
        normalised=np.where(free, here.residual_px, 0.0) / np.sqrt(np.where(free, variance_px2, 1.0)),
        detectable_px=np.where(used[:, None], detectable, math.nan),
        squared=squared_residuals(here, covariance, share),
    )
