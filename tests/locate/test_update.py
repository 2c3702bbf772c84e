"""The update of one pair of measurements against full matrices."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whiskjax.locate.update import corrected, gain, innovate, joseph, seen_by


def problem(n, seed, batch=()):
    """Covariance, rows, noise, residual and state of random numbers, on scales that differ by 1e4."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-2, 2, n)
    root = rng.normal(size=(*batch, n, n)) * scale[:, None]
    noise = rng.normal(size=(*batch, 2, 2))
    return (
        root @ np.swapaxes(root, -1, -2),
        rng.normal(size=(*batch, 2, n)) / scale,
        noise @ np.swapaxes(noise, -1, -2) + 0.1 * np.eye(2),
        rng.normal(size=(*batch, 2)),
        rng.normal(size=(*batch, n)),
    )


def components(covariance, rows, noise, residual, state):
    n = covariance.shape[-1]
    return (
        tuple(tuple(covariance[..., i, j] for j in range(n)) for i in range(n)),
        tuple(tuple(rows[..., a, i] for i in range(n)) for a in range(2)),
        (noise[..., 0, 0], noise[..., 0, 1], noise[..., 1, 1]),
        (residual[..., 0], residual[..., 1]),
        tuple(state[..., i] for i in range(n)),
    )


@jax.jit
def ours(covariance, rows, noise, residual, state, share):
    crossed = seen_by(covariance, rows)
    found = innovate(residual, crossed, rows, noise)
    k = gain(crossed, found.covariance, share)
    return found, k, corrected(state, k, residual), joseph(covariance, k, crossed, found.covariance)


def theirs(p, h, r, z, x, share):
    s = h @ p @ h.T + r
    k = share[:, None] * (p @ h.T @ np.linalg.inv(s))
    left = np.eye(len(x)) - k @ h
    return s, z @ np.linalg.solve(s, z), k, x + k @ z, left @ p @ left.T + k @ r @ k.T


def shares(n, kind):
    if kind == "optimal":
        return np.ones(n)
    return (np.arange(n) < n - n // 3).astype(float) if kind == "Schmidt" else np.zeros(n)


@pytest.mark.parametrize("n", [3, 6, 9])
@pytest.mark.parametrize("kind", ["optimal", "Schmidt", "none"])
def test_the_update_is_that_of_the_textbook(n, kind):
    for seed in range(20):
        p, *_ = parts = problem(n, seed)
        share = shares(n, kind)
        found, k, state, covariance = ours(*components(*parts), tuple(share))
        s, nis, k0, x0, p0 = theirs(*parts, share)
        sigma = np.sqrt(np.diag(p))
        np.testing.assert_allclose(
            [found.covariance[0], found.covariance[1], found.covariance[2]], s[[0, 0, 1], [0, 1, 1]], rtol=1e-12
        )
        np.testing.assert_allclose(found.nis, nis, rtol=1e-9)
        np.testing.assert_allclose(np.array(k).T / sigma[:, None], k0 / sigma[:, None], rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.array(state) / sigma, x0 / sigma, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.array(covariance) / np.outer(sigma, sigma), p0 / np.outer(sigma, sigma), rtol=0, atol=1e-10)


@given(st.sampled_from(["optimal", "Schmidt"]), st.integers(0, 10_000))
def test_a_covariance_stays_symmetric_and_positive_semidefinite_and_never_grows(kind, seed):
    p, *_ = parts = problem(6, seed)
    *_, covariance = ours(*components(*parts), tuple(shares(6, kind)))
    sigma = np.sqrt(np.diag(p))
    after = np.array(covariance) / np.outer(sigma, sigma)
    np.testing.assert_array_equal(after, after.T)
    assert np.linalg.eigvalsh(after).min() > -1e-12
    if kind == "optimal":
        assert np.linalg.eigvalsh(p / np.outer(sigma, sigma) - after).min() > -1e-12


@pytest.mark.parametrize("batch", [(), (1,), (3, 2)])
def test_a_batch_agrees_with_a_loop(batch):
    parts = problem(3, 1, batch)
    *_, state, covariance = ours(*components(*parts), (1.0, 1.0, 1.0))
    for i in np.ndindex(batch):
        *_, one_state, one = ours(*components(*(a[i] for a in parts)), (1.0, 1.0, 1.0))
        np.testing.assert_allclose([c[i] for c in state], one_state, rtol=1e-12)
        np.testing.assert_allclose([[c[i] for c in row] for row in covariance], one, rtol=1e-9, atol=1e-12)
