"""Whether a covariance tells the truth: normalised estimation errors over many runs."""

import math

import numpy as np
from jaxtyping import Float

# Two-sided 99.7 %: an honest covariance leaves the band once in 370.
_SIGMAS = 3.0


def nees(error: Float[np.ndarray, "runs k"], covariance: Float[np.ndarray, "runs k k"]) -> Float[np.ndarray, " runs"]:
    """Normalised estimation error squared e^T C^-1 e of each run: chi-square with k degrees of freedom where C is honest.

    Its mean is k then; larger, and the covariance promises too much (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).
    """
    return np.einsum("ri,ri->r", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def nees_band(unknowns: int, runs: int) -> tuple[float, float]:
    """Where the mean over the runs lies for an honest covariance, but for one time in 370."""
    half = _SIGMAS * math.sqrt(2 * unknowns / runs)
    return unknowns - half, unknowns + half
