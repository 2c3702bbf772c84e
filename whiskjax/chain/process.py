"""A correction that wanders: a random walk or a Gaussian process in time, as a basis with independent coefficients.

The values at the nodes are L c, with L the Cholesky factor of the process's covariance (at unit sigma) and c independent with one
and the same sigma; between nodes they are interpolated linearly. So a process needs nothing that a bias or a spline does not:
coefficients, each with its own prior, and every estimator that knows priors knows processes.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Component
from ..rules import RESULTS, Arrays, Numbers
from ..rules.results import choose
from .correction import AbstractBasis
from .knots import take


class Process(AbstractBasis):
    """A zero-mean Gaussian process at nodes in time; make one by `random_walk`, `ornstein_uhlenbeck` or `smooth`.

    The coefficients' common a-priori sigma is the sigma of the process itself (stationary ones), or its growth per square root of
    a second (random walk). Outside the nodes nothing is said.
    """

    given: ClassVar = ("time_s",)
    time_s: Float[Array, " nodes"]
    root: Float[Array, "nodes nodes"]
    kind: str = eqx.field(static=True)
    parameter: float = eqx.field(static=True)  # start_sigma of a random walk, correlation_s of the others

    def __check_init__(self):
        arrays = Arrays("Process")
        arrays.take("time_s", self.time_s, "nodes", absolute=True)
        arrays.take("root", self.root, "nodes nodes")

    @classmethod
    def random_walk(cls, time_s: Float[Numbers, " nodes"], start_sigma: float = 0.0) -> "Process":
        """Brownian motion: independent changes, variance growing with time.

        **Arguments:** `time_s`: increasing; `start_sigma`: sigma at the first node over the growth per square root of a second; 0
        where a constant unknown beside the process already holds the start.
        """
        t = _increasing(time_s)
        start_sigma = float(Arrays("Process").take("start_sigma", start_sigma, "", finite=True, least=0.0))
        # The start, and independent changes from node to node: column k acts from node k on.
        root = np.tril(np.broadcast_to(np.append(start_sigma, np.sqrt(np.diff(t))), (len(t), len(t))))
        return cls(jnp.asarray(t), jnp.asarray(root), "random_walk", start_sigma)

    @classmethod
    def ornstein_uhlenbeck(cls, time_s: Float[Numbers, " nodes"], correlation_s: float) -> "Process":
        """Errors that are forgotten: covariance exp(-|dt| / correlation_s). POS attitude errors behave so."""
        t = _increasing(time_s)
        covariance = np.exp(-np.abs(t[:, None] - t) / _positive(correlation_s))
        return cls(jnp.asarray(t), _root(covariance), "ornstein_uhlenbeck", float(correlation_s))

    @classmethod
    def smooth(cls, time_s: Float[Numbers, " nodes"], correlation_s: float) -> "Process":
        """Once differentiable: Matern 3/2, (1 + x) exp(-x) with x = sqrt(3) |dt| / correlation_s. Thermal drift behaves so."""
        t = _increasing(time_s)
        x = np.sqrt(3) * np.abs(t[:, None] - t) / _positive(correlation_s)
        return cls(jnp.asarray(t), _root((1 + x) * np.exp(-x)), "smooth", float(correlation_s))

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


def _increasing(time_s: Float[Numbers, " nodes"]) -> np.ndarray:
    arrays = Arrays("Process")
    t = np.asarray(arrays.take("time_s", time_s, "nodes", absolute=True, finite=True))
    if len(t) < 2 or not (np.diff(t) > 0).all():
        arrays.refuse("time_s", f"is {t.tolist()}; at least two node times that increase are needed")
    return t


def _root(covariance: np.ndarray) -> Float[Array, "nodes nodes"]:
    # The hair keeps nodes that are close together positive definite: a millionth of the sigma.
    return jnp.asarray(np.linalg.cholesky(covariance + 1e-12 * np.eye(len(covariance))))


def _positive(correlation_s: float) -> float:
    return float(Arrays("Process").take("correlation_s", correlation_s, "", finite=True, above=0.0))
