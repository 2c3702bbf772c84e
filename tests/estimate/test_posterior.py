"""Posterior and diagnosis against numpy and scipy on made-up matrices."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from whiskjax.estimate.losses import Cauchy, Huber
from whiskjax.estimate.model_test import chi_square_tail, consistency
from whiskjax.estimate.posterior import posterior


@given(st.integers(0, 10**6), st.integers(1, 8))
def test_covariance_of_random_problems(seed, k):
    rng = np.random.default_rng(seed)
    jac, scale, has_prior = rng.normal(size=(3 * k + 2, k)), np.exp(rng.normal(size=k)), rng.random(k) < 0.5
    found = posterior(jac, scale, np.diag(has_prior.astype(float)), [f"x{i}" for i in range(k)])
    raw = jac / scale
    expected = np.linalg.inv(raw.T @ raw + np.diag(has_prior / scale**2))
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(np.diag(found.correlation), 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.data_share[has_prior], (1 - np.diag(expected) / scale**2)[has_prior], atol=1e-10)
    assert np.isnan(found.data_share[~has_prior]).all()
    assert found.rank == k and found.null_space == ()


def test_null_space_is_named_and_scale_free():
    """x0 + x2 is all that the data see of the two; x3 is not seen at all; units differ by 1e6."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 30))
    scale = np.array([1.0, 1e3, 1e-3, 1.0])
    jac = np.stack([a, b, a, 0 * a], -1) * 1.0
    found = posterior(jac, scale, np.zeros((4, 4)), ["x0", "x1", "x2", "x3"])
    assert found.rank == 2
    assert {frozenset(d) for d in found.null_space} <= {frozenset({"x0", "x2"}), frozenset({"x2", "x0"}), frozenset({"x3"})} | {
        frozenset({"x0"})
    }
    assert np.isinf(found.sigma[[0, 2, 3]]).all() and np.isfinite(found.sigma[1])


@pytest.mark.parametrize("freedom", [1, 2, 7, 60, 260, 17000])
def test_chi_square_tail_is_scipys(freedom):
    for value in (0.2 * freedom, freedom, 1.2 * freedom, 2.5 * freedom):
        assert chi_square_tail(value, freedom) == pytest.approx(scipy.stats.chi2.sf(value, freedom), rel=1e-6, abs=1e-12)


def test_consistency_verdict():
    assert consistency(260.0, 260)[2]
    assert consistency(120.0, 260)[2], "small residuals are no failure"
    assert not consistency(400.0, 260)[2]


@pytest.mark.parametrize("loss", [Huber(1.5), Cauchy(1.5)])
def test_losses_against_their_textbook_form(loss):
    s = np.array([1e-9, 0.3, 1.4999, 1.5001, 4.0, 100.0])
    k = 1.5
    if isinstance(loss, Huber):
        rho = np.where(s <= k, s**2 / 2, k * s - k**2 / 2)
        weight = np.where(s <= k, 1.0, k / s)
    else:
        rho = k**2 / 2 * np.log1p((s / k) ** 2)
        weight = 1 / (1 + (s / k) ** 2)
    np.testing.assert_allclose(0.5 * (np.asarray(loss.factor(s**2)) * s) ** 2, rho, rtol=1e-9)
    np.testing.assert_allclose(loss.weight(s**2), weight, rtol=1e-12)
