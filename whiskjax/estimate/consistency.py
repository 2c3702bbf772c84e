"""Whether a covariance tells the truth: normalised estimation errors over many runs."""

import math

import numpy as np
from jaxtyping import Bool, Float

from ..rules import Arrays
from ..rules.spread import refuse_covariances

# Two-sided 99.7 %: an honest covariance leaves the band once in 370.
_SIGMAS = 3.0


def nees(error: Float[np.ndarray, "runs k"], covariance: Float[np.ndarray, "runs k k"]) -> Float[np.ndarray, " runs"]:
    """Normalised estimation error squared e^T C^-1 e of each run: chi-square with k degrees of freedom where C is honest.

    Its mean is k then; larger, and the covariance promises too much (Bar-Shalom, Li and Kirubarajan 2001, section 5.4). A run
    whose numbers are not finite has none.

    **Raises:** `WhiskjaxError` where shapes do not fit, or a covariance is not positive definite.
    """
    arrays = Arrays("nees")
    error = np.asarray(arrays.take("error", error, "runs k"))
    covariance = np.asarray(arrays.take("covariance", covariance, "runs k k"))
    known = np.isfinite(covariance).all(axis=(1, 2))  # a run without an answer has no number
    refuse_covariances(covariance[known], lambda i: f"nees: the covariance of run {np.flatnonzero(known)[i]}")
    flat = np.flatnonzero(known)[~_is_positive_definite(covariance[known])]
    if flat.size:
        arrays.refuse("covariance", f"of run {flat[0]} is not positive definite")
    return np.einsum("ri,ri->r", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def _is_positive_definite(covariance: Float[np.ndarray, "runs k k"]) -> Bool[np.ndarray, " runs"]:
    """Judged by correlations, in which units do not matter."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.where(variance > 0, variance, 1.0))
    least = np.linalg.eigvalsh(covariance / (sigma[:, :, None] * sigma[:, None, :])).min(axis=1, initial=np.inf)
    return (variance > 0).all(axis=1) & (least > 0)


def nees_band(unknowns: int, runs: int) -> tuple[float, float]:
    """Where the mean over the runs lies for an honest covariance, but for one time in 370.

    **Raises:** `WhiskjaxError` where one of the two is no whole number from 1 on.
    """
    arrays = Arrays("nees_band")
    for name, value in (("unknowns", unknowns), ("runs", runs)):
        if not int(arrays.take_whole(name, value, "", meaning="a number of them")) > 0:
            arrays.refuse(name, f"is {value}, but there is at least one")
    half = _SIGMAS * math.sqrt(2 * unknowns / runs)
    return unknowns - half, unknowns + half
