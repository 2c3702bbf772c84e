"""Whitening by innovations against the dense covariance of all looks, which is what it stands for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from whiskjax.locate.innovations import whitened

LOOKS, ERRORS, COLUMNS = 12, 3, 4


def made_up(seed: int, errors: int = ERRORS):
    """Noise (looks, 2, 2), effects (looks, 2, m), what is kept (looks, m) with errors drawn anew half-way, and columns."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(LOOKS, 2, 2))
    noise = root @ root.swapaxes(1, 2) + np.eye(2)
    effects = 3 * rng.normal(size=(LOOKS, 2, errors))
    keep = np.stack([np.ones(LOOKS), rng.uniform(0.5, 1, LOOKS), rng.uniform(0, 1, LOOKS)], -1)[:, :errors]
    keep[0] = 0.0
    keep[LOOKS // 2, 1:] = 0.0
    return noise, effects, keep, rng.normal(size=(LOOKS, 2, COLUMNS))


def dense(noise, effects, keep):
    """The covariance (2 looks, 2 looks), each correlation a product of what is kept on the way, by a loop."""
    looks = len(noise)
    whole = scipy.linalg.block_diag(*noise)
    for k in range(looks):
        for other in range(k + 1):
            kept = np.prod(keep[other + 1 : k + 1], axis=0)
            shared = effects[k] @ np.diag(kept) @ effects[other].T
            whole[2 * k : 2 * k + 2, 2 * other : 2 * other + 2] += shared
            if other != k:
                whole[2 * other : 2 * other + 2, 2 * k : 2 * k + 2] += shared.T
    return whole


@pytest.mark.parametrize("errors", [ERRORS, 0])
def test_it_is_the_cholesky_factor_of_the_dense_covariance(errors):
    """L^-1 y to 1e-12: innovations are those of the looks in their order."""
    noise, effects, keep, columns = made_up(1, errors)
    factor = np.linalg.cholesky(dense(noise, effects, keep))
    expected = scipy.linalg.solve_triangular(factor, columns.reshape(-1, COLUMNS), lower=True).reshape(columns.shape)
    part = np.ones(LOOKS, dtype=bool)
    found = jax.jit(whitened)(noise, effects, keep, part, columns)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_looks_that_take_no_part_are_zero_and_teach_nothing():
    """The rest is whitened as if they had never been; the errors wander on meanwhile."""
    noise, effects, keep, columns = made_up(2)
    part = np.arange(LOOKS) % 3 != 1
    rows = np.repeat(part, 2)
    factor = np.linalg.cholesky(dense(noise, effects, keep)[np.ix_(rows, rows)])
    expected = np.zeros((2 * LOOKS, COLUMNS))
    expected[rows] = scipy.linalg.solve_triangular(factor, columns.reshape(-1, COLUMNS)[rows], lower=True)
    found = whitened(*map(jnp.asarray, (noise, effects, keep, part, columns)))
    np.testing.assert_allclose(found, expected.reshape(columns.shape), rtol=0, atol=1e-12)


def test_batches_and_derivatives():
    """vmap is a loop; forward and reverse mode and differences agree."""
    noise, effects, keep, columns = map(jnp.asarray, made_up(3))
    part = jnp.ones(LOOKS, dtype=bool)

    def squared(factor):
        return (whitened(noise, factor * effects, keep, part, columns) ** 2).sum()

    factors = jnp.linspace(0.5, 2.0, 6).reshape(3, 2)
    together = jax.vmap(jax.vmap(squared))(factors)
    np.testing.assert_allclose(together, [[squared(f) for f in row] for row in factors], rtol=1e-12)
    step = 1e-5
    difference = (squared(1.0 + step) - squared(1.0 - step)) / (2 * step)
    np.testing.assert_allclose([jax.jacfwd(squared)(1.0), jax.grad(squared)(1.0)], difference, rtol=1e-7)
