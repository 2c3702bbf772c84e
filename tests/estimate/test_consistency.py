"""Normalised estimation errors against a loop, and against draws from the covariance they are judged by."""

import numpy as np
import pytest
import scipy.stats

import whiskjax as wj


def draws(runs, k, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(runs, k, k)) + 2 * np.eye(k)
    return np.einsum("rij,rj->ri", root, rng.normal(size=(runs, k))), root @ np.swapaxes(root, 1, 2)


def test_nees_is_a_loop():
    error, covariance = draws(7, 4)
    expected = [e @ np.linalg.inv(c) @ e for e, c in zip(error, covariance, strict=True)]
    np.testing.assert_allclose(wj.nees(error, covariance), expected, rtol=1e-9)


def test_nees_does_not_ask_for_units():
    error, covariance = draws(5, 3, seed=1)
    unit = np.array([1e-5, 1.0, 1e4])
    np.testing.assert_allclose(wj.nees(error * unit, covariance * np.outer(unit, unit)), wj.nees(error, covariance), rtol=1e-9)


def test_nees_of_an_honest_covariance_is_chi_square():
    error, covariance = draws(4000, 5)
    found = wj.nees(error, covariance)
    assert scipy.stats.kstest(found, scipy.stats.chi2(5).cdf).pvalue > 0.01
    low, high = wj.nees_band(5, 4000)
    assert low < found.mean() < high
    # A sigma that is promised a quarter too small is found out.
    assert wj.nees(error, covariance / 1.25**2).mean() > high


@pytest.mark.parametrize("k, runs", [(15, 600), (3, 2000)])
def test_the_band_holds_997_of_1000_honest_means(k, runs):
    """The mean of chi-squares is a chi-square over the runs; scipy's own quantiles differ from the normal band by its skew."""
    low, high = wj.nees_band(k, runs)
    exact = scipy.stats.chi2(k * runs)
    inside = exact.cdf(high * runs) - exact.cdf(low * runs)
    assert inside == pytest.approx(1 - 1 / 370, abs=3e-4)
    assert (low + high) / 2 == pytest.approx(k, rel=1e-12)
