"""A correction that wanders: a random walk or a Gaussian process in time, as a basis with independent coefficients.

The values at the nodes are L c, with L the Cholesky factor of the process's covariance (at unit sigma) and c independent with one
and the same sigma; between nodes they are interpolated linearly. So a process needs nothing that a bias or a spline does not:
coefficients, each with its own prior, and every estimator that knows priors knows processes.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..algebra.vectors import Component
from ..rules import RESULTS, WhiskjaxError
from ..rules.results import choose
from .correction import AbstractBasis
from .knots import take


class Process(AbstractBasis):
    """A zero-mean Gaussian process at nodes in time; make one by `random_walk`, `ornstein_uhlenbeck` or `smooth`.

    The coefficients' common a-priori sigma is the sigma of the process itself (stationary ones), or its growth per square root of
    a second (random walk). Outside the nodes nothing is said.
    """

    time_s: Float[Array, " nodes"]
    root: Float[Array, "nodes nodes"]

    @classmethod
    def random_walk(cls, time_s: Float[ArrayLike, " nodes"], start_sigma: float = 0.0) -> "Process":
        """Brownian motion: independent changes, variance growing with time.

        **Arguments:** `time_s`: increasing; `start_sigma`: sigma at the first node over the growth per square root of a second; 0
        where a constant unknown beside the process already holds the start.
        """
        t = _increasing(time_s)
        covariance = start_sigma**2 + np.minimum(*np.meshgrid(t - t[0], t - t[0]))
        first = np.zeros(len(t))
        first[0] = start_sigma
        root = np.zeros((len(t), len(t)))
        root[:, 0] = start_sigma
        root[1:, 1:] = np.linalg.cholesky(covariance[1:, 1:] - start_sigma**2)
        return cls(jnp.asarray(t), jnp.asarray(root))

    @classmethod
    def ornstein_uhlenbeck(cls, time_s: Float[ArrayLike, " nodes"], correlation_s: float) -> "Process":
        """Errors that are forgotten: covariance exp(-|dt| / correlation_s). POS attitude errors behave so."""
        t = _increasing(time_s)
        return cls._stationary(t, np.exp(-np.abs(t[:, None] - t) / _positive(correlation_s)))

    @classmethod
    def smooth(cls, time_s: Float[ArrayLike, " nodes"], correlation_s: float) -> "Process":
        """Once differentiable: Matern 3/2, (1 + x) exp(-x) with x = sqrt(3) |dt| / correlation_s. Thermal drift behaves so."""
        t = _increasing(time_s)
        x = np.sqrt(3) * np.abs(t[:, None] - t) / _positive(correlation_s)
        return cls._stationary(t, (1 + x) * np.exp(-x))

    @classmethod
    def _stationary(cls, t: np.ndarray, covariance: np.ndarray) -> "Process":
        return cls(jnp.asarray(t), jnp.asarray(np.linalg.cholesky(covariance + 1e-12 * np.eye(len(t)))))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.time_s.shape[0]

    def weights(self, t: Component) -> list[tuple[Component, Component]]:
        """Every coefficient, by linear interpolation of its column of the root."""
        i = jnp.clip(jnp.searchsorted(self.time_s, t, side="right") - 1, 0, self.size - 2)
        start = take(self.time_s, i)
        w = (t - start) / (take(self.time_s, i + 1) - start)
        columns = [self.root[:, k] for k in range(self.size)]
        return [(k, (1 - w) * take(c, i) + w * take(c, i + 1)) for k, c in enumerate(columns)]

    def check(self, t: Component) -> RESULTS:
        """From the first to the last node."""
        inside = (t >= self.time_s[0]) & (t <= self.time_s[-1])
        return choose(inside, RESULTS.successful, RESULTS.time_outside_trajectory)


def _increasing(time_s: Float[ArrayLike, " nodes"]) -> np.ndarray:
    t = np.asarray(time_s, dtype=float)
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
        raise WhiskjaxError(f"a process needs at least two node times that increase, not {time_s}")
    return t


def _positive(correlation_s: float) -> float:
    if not (np.isfinite(correlation_s) and correlation_s > 0):
        raise WhiskjaxError(f"correlation_s must be a positive number of seconds, not {correlation_s}")
    return correlation_s
