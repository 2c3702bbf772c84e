"""A robust fit that starts anywhere: damped Gauss-Newton steps under a loss whose scale shrinks with the residuals.

The loss of a residual of squared whitened length z is c^2 log(1 + z / c^2) (Cauchy): one of 3 sigmas pulls half as much as in
least squares, and a blunder next to nothing. Far from the solution all residuals are blunders; there c is taken so many times
larger as the median residual is larger than noise, until it is noise.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

BOUND = 3.0
_MEDIAN = 1.386  # of the squared length of two normal residuals
_MOST_DAMPING, _SETTLED = 1e12, 1e-4
_LITTLE = 1e-2  # of the cost: 25 tell remedies apart


class Rows(NamedTuple):
    """Whitened residuals and derivatives by some numbers: of observations (n, 2), (n, 2, k), and of priors (m,), (m, k)."""

    residual: Float[np.ndarray, "n 2"]
    by: Float[np.ndarray, "n 2 k"]
    prior: Float[np.ndarray, " m"]
    prior_by: Float[np.ndarray, "m k"]


class Fit(NamedTuple):
    """Where a fit ended: the numbers (k,), its rows there, and how many steps it took."""

    x: Float[np.ndarray, " k"]
    rows: Rows
    steps: int


def loss(z: Float[np.ndarray, "..."], scale: float = 1.0) -> Float[np.ndarray, "..."]:
    """The loss of squared whitened lengths, c `scale` times as large."""
    c2 = BOUND**2 * scale
    return c2 * np.log1p(z / c2)


def fit(
    of: Callable[[Float[np.ndarray, " k"]], Rows], start: Float[np.ndarray, " k"], used: Bool[np.ndarray, " n"], steps: int
) -> Fit:
    """The minimum of the robust cost of the used observations and of the priors.

    **Arguments:** `of`: rows at some numbers; `steps`: of them at most so many evaluations.
    """
    x, rows, damping, taken = np.array(start, dtype=float), of(start), 1e-3, 0
    scale = _scale(rows, used)
    for _ in range(steps):
        z = _squared(rows, used)
        pull = np.sqrt(used / (1 + z / (BOUND**2 * scale)))[:, None]
        by, right = _finite(rows, used)
        a = np.concatenate([(pull[:, :, None] * by).reshape(-1, len(x)), rows.prior_by])
        b = np.concatenate([(pull * right).ravel(), rows.prior])
        normal, slope = a.T @ a, a.T @ b
        diagonal = np.maximum(normal.diagonal(), 1e-12 * max(normal.diagonal().max(initial=0.0), 1e-300))
        step = -np.linalg.lstsq(normal + damping * np.diag(diagonal), slope, rcond=None)[0]
        there = of(x + step)
        gained = _cost(rows, used, scale) - _cost(there, used, scale)
        if gained >= 0:
            x, rows, taken = x + step, there, taken + 1
            shrunk, damping = _scale(rows, used), max(damping / 8, 1e-9)
            is_little = np.abs(step).max() < _SETTLED or (gained < _LITTLE and damping < 1e-2)
            if is_little and shrunk >= scale:
                break
            scale = min(scale, shrunk)
        else:
            damping *= 8
            if damping > _MOST_DAMPING:
                break
    return Fit(x, rows, taken)


def covariance(end: Fit, used: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "k k"]:
    """Of the numbers, by the derivatives at the end, observations weighted as the loss does."""
    z = _squared(end.rows, used)
    by, _ = _finite(end.rows, used)
    pull = np.sqrt(used / (1 + z / BOUND**2))[:, None, None]
    a = np.concatenate([(pull * by).reshape(-1, len(end.x)), end.rows.prior_by])
    return np.linalg.pinv(a.T @ a, hermitian=True)


def _finite(rows: Rows, used: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives and residuals, zero where they are none."""
    fine = used & np.isfinite(rows.residual).all(axis=1) & np.isfinite(rows.by).all(axis=(1, 2))
    return np.where(fine[:, None, None], rows.by, 0.0), np.where(fine[:, None], rows.residual, 0.0)


def _squared(rows: Rows, used: Bool[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Squared lengths; a point in the plane of the projection centre is as far off as can be."""
    with np.errstate(over="ignore", invalid="ignore"):
        z = (rows.residual**2).sum(axis=1)
    return np.where(used, np.where(np.isfinite(z), z, 1e20), 0.0)


def _scale(rows: Rows, used: Bool[np.ndarray, " n"]) -> float:
    return max(1.0, float(np.median(_squared(rows, used)[used])) / _MEDIAN) if used.any() else 1.0


def _cost(rows: Rows, used: Bool[np.ndarray, " n"], scale: float) -> float:
    cost = float(loss(_squared(rows, used), scale)[used].sum() + rows.prior @ rows.prior)
    return cost if np.isfinite(cost) else np.inf
