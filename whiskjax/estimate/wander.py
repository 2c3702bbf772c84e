"""Errors of a frame that wander, found in residuals: how large they are, and after which time they are forgotten.

Whitened residuals are r = M e. Where e is white noise and turns of a frame that are remembered for several times tau_k, their
covariance is w^2 M + sum_k s_k^2 M K_k M, with K_k(i, j) = A_i A_j^T exp(-|t_i - t_j| / tau_k) and A_i what a turn does to
measurement i. The variances w^2, s_k^2 are those, none below zero, that come nearest to the products of the residuals, weighed by
the covariance that they say themselves (Rao 1971, MINQUE, iterated: REML). Of a ladder of times only few get a variance.

Of a memory of a third of the flight there are few independent draws, and its most likely variance may by chance be nothing.
What is stated is the mean of what it may be: of a normal distribution about the most likely one, with its own sigma, above zero.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import nnls
from scipy.sparse import csc_array
from scipy.special import ndtr

from .fitted import AbstractFitted

_RUNS, _RUN = 20, 10  # measurements that are looked at where there are many: so many in a row, at so many times
_ROUNDS, _SAME = 12, 1e-2  # of its own sigma, about: what changes less has settled
_STEP, _LONGEST = 4.0, 1 / 3  # of the ladder of times, the last of them in parts of the flight
_LITTLE = 0.05  # of the largest variance, and of the largest times its memory: less changes nothing
_THERE = 1e-6  # eigenvalues of M: below them the fit took everything


class Memory(NamedTuple):
    """Turns about each axis of a frame, of one sigma and one memory."""

    sigma_rad: float
    correlation_s: float


def memories(
    fit: AbstractFitted, turn_px: Float[np.ndarray, "n 2 3"], time_s: Float[np.ndarray, " n"], used: Bool[np.ndarray, " n"]
) -> tuple[Memory, ...]:
    """The turns that residuals show, the shortest memory first; none where they show none.

    **Arguments:** `turn_px`: what turns of the frame do to the pixels; `used`: measurements that decided and have a time.
    """
    index = _some(time_s, used)
    time, gaps = time_s[index], np.diff(time_s[index])
    if not (gaps > 0).any():
        return ()
    ladder = np.median(gaps[gaps > 0]) * _STEP ** np.arange(64)
    ladder = ladder[ladder <= _LONGEST * np.ptp(time)]
    rows = (2 * index[:, None] + np.arange(2)).ravel()
    own = csc_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), (2 * len(time_s), len(rows)))
    left, axes = np.linalg.eigh(np.eye(len(rows)) - fit.gram(own).taken)
    left, axes = left[left > _THERE], axes[:, left > _THERE]
    turned = fit.whitened(turn_px.reshape(-1, 3))[rows]
    apart = np.repeat(np.repeat(np.abs(time[:, None] - time[None, :]), 2, axis=0), 2, axis=1)
    alike = turned @ turned.T
    kernels = [left[:, None] * (axes.T @ (alike * np.exp(-apart / tau)) @ axes) * left for tau in ladder]
    # Of turns that the fit takes, as free poses do, only rounding is left.
    shown = np.array([np.trace(kernel) for kernel in kernels]) > fit.visible * np.trace(alike)
    ladder, kernels = ladder[shown], [kernel for kernel, some in zip(kernels, shown, strict=True) if some]
    if not kernels:
        return ()
    likely, sigma = _components(axes.T @ fit.residual.ravel()[rows], [np.diag(left), *kernels])
    variance = _mean_above_zero(likely, sigma)[1:]
    weight = variance * ladder
    kept = (variance > _LITTLE * variance.max(initial=0.0)) | (weight > _LITTLE * weight.max(initial=0.0))
    return tuple(Memory(float(np.sqrt(v)), float(tau)) for v, tau in zip(variance[kept], ladder[kept], strict=True) if v > 0)


def _some(time_s: Float[np.ndarray, " n"], used: Bool[np.ndarray, " n"]) -> np.ndarray:
    """Measurements in the order of time; of many, runs that follow closely, from the first to the last."""
    index = np.flatnonzero(used)
    index = index[np.argsort(time_s[index], kind="stable")]
    if len(index) <= _RUNS * _RUN:
        return index
    first = np.linspace(0, len(index) - _RUN, _RUNS).astype(int)
    return index[np.unique(first[:, None] + np.arange(_RUN))]


def _components(
    seen: Float[np.ndarray, " m"], kernels: list[Float[np.ndarray, "m m"]]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Variances, none negative, by which the sum of kernels comes nearest to seen seen^T, and their sigmas beside one another."""
    variance, gram = np.zeros(len(kernels)), np.eye(len(kernels))
    variance[0] = 1.0
    hair = 1e-9 * np.eye(len(seen))
    for _ in range(_ROUNDS):
        whole = np.einsum("k,kij->ij", variance, np.array(kernels))
        weight = np.linalg.inv(whole + np.trace(whole) / len(seen) * hair)
        weighed = [weight @ kernel for kernel in kernels]
        gram = np.array([[np.sum(a * b.T) for b in weighed] for a in weighed])
        towards = weight @ seen
        right = np.array([towards @ kernel @ towards for kernel in kernels])
        scale = 1 / np.sqrt(gram.diagonal())
        root = np.linalg.cholesky(gram * np.outer(scale, scale) + 1e-10 * np.eye(len(scale)))
        last, variance = variance, scale * nnls(root.T, np.linalg.solve(root, scale * right))[0]
        if (np.abs(variance - last) * np.sqrt(gram.diagonal())).max() < _SAME:
            break
    acts, sigma = variance > 0, np.zeros(len(kernels))
    sigma[acts] = np.sqrt(2 * np.linalg.pinv(gram[np.ix_(acts, acts)], hermitian=True).diagonal())
    return variance, sigma


def _mean_above_zero(likely: Float[np.ndarray, " k"], sigma: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """The means of normal distributions of which only what is positive is left; 0 where sigma is."""
    z = np.where(sigma > 0, likely / np.where(sigma > 0, sigma, 1.0), 0.0)
    return likely + sigma * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) / ndtr(z)
