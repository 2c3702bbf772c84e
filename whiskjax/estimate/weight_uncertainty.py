"""What sigmas that were found from the data, and so are not known exactly, add to the covariance of the answer.

With theta the logarithms of the factors, W their covariance, and C(theta) the covariance of the answer u(theta) that known
factors would leave, three things are unknown together, and the covariance is (law of total covariance)

    Cov = E C(theta) + Cov u(theta).

- Weights that are a little off give another answer: to first order Cov u = J W J^T with J = du/dtheta (Kackar and Harville 1984).
- Sigmas that are a little off scale the errors: C_ii has the relative error g W g^T, g = d log C_ii / dtheta, as a variance that
  comes from nu = 2 / (g W g^T) values has (Satterthwaite 1946). What is divided by the root of such a variance is not normal but
  t of nu degrees of freedom, of variance nu / (nu - 2) (Koch 1999, Parameter Estimation, 4.2; Kenward and Roger 1997 for the
  same of several components). So row and column i of C are multiplied by the root of that.

C grows with every variance, and no faster than all of them: g >= 0, and its sum is at most 2. So g W g^T <= 4 max(W_jj), and nu
is no smaller than that of the least known factor: five or more, since others are not found (`LEAST_KNOWN`). So the covariance
grows by 2/3 at most, and stays positive definite.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .variance_components import LEAST_KNOWN, Components, Data, equations


class Uncertain(NamedTuple):
    """`growth`: roots of nu / (nu - 2) of each number, (k,); `moved`: the answers by one sigma each of independent factors,
    (k, groups)."""

    growth: Float[np.ndarray, " k"]
    moved: Float[np.ndarray, "k groups"]

    def of(self, covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
        """The covariance that knows of it, from that of known factors; of what it was made for, whitened or not."""
        return covariance * np.outer(self.growth, self.growth) + self.moved @ self.moved.T


def uncertain(
    answer: Float[np.ndarray, "groups k"],
    log_variance: Float[np.ndarray, "groups k"],
    covariance: Float[np.ndarray, "groups groups"],
) -> Uncertain:
    """**Arguments:** derivatives of the answer, and of the logarithms of its variances, by those of the factors; and W."""
    relative = np.einsum("gk,gh,hk->k", log_variance, covariance, log_variance)  # 2 / nu
    relative = np.minimum(relative, 4 * LEAST_KNOWN**2)  # what rounding, or an iteration that did not end, adds
    return Uncertain(1 / np.sqrt(1 - relative), answer.T @ np.linalg.cholesky(covariance))


def of_least_squares(found: Components, data: Data, size: int) -> Uncertain:
    """Of the first `size` numbers, those that were estimated: numbers that were only considered do not weigh."""
    if not found.names:
        return Uncertain(np.ones(size), np.zeros((size, 0)))
    answer, variance = (np.asarray(part) for part in _by_factors(jnp.log(jnp.asarray(found.factor)), data, size))
    return uncertain(answer, variance, found.covariance)


def _derivatives(theta: Float[Array, " groups"], data: Data, size: int) -> tuple[Array, Array]:
    def answer(theta: Array) -> tuple[Array, Array]:
        of = equations(theta, data)
        inverse = jnp.linalg.inv(of.normal[:size, :size])
        return -inverse @ of.right[:size], jnp.log(jnp.diag(inverse))

    by, log_variance = jax.jacfwd(answer)(theta)
    return by.T, log_variance.T


_by_factors = jax.jit(_derivatives, static_argnums=2)
