"""Errors that wander are found in residuals, with their sizes and memories: against draws, and the likelihood by scipy."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import truncnorm

from whiskjax.estimate.fitted import Dense
from whiskjax.estimate.wander import _components, _mean_above_zero, memories

SIGMA_RAD = 2e-3
TURN_PX = np.array([[0.0, 1000.0, 300.0], [-1000.0, 0.0, -200.0]])


def drawn(rng, n, terms, white=1.0, spacing_s=0.5):
    """Residuals of a fit of four numbers to white noise and turns that wander: `terms` are their sigmas and memories."""
    time = spacing_s * (np.arange(n) + 0.3 * rng.uniform(size=n))
    turn = np.tile(TURN_PX, (n, 1, 1)) * (1 + 0.1 * rng.normal(size=(n, 1, 1)))
    gap = np.abs(time[:, None] - time[None, :])
    e = white * rng.normal(size=(n, 2))
    for sigma, tau in terms:
        motion = sigma * np.linalg.cholesky(np.exp(-gap / tau) + 1e-12 * np.eye(n)) @ rng.normal(size=(n, 3))
        e = e + np.einsum("nik,nk->ni", turn, motion)
    rows = np.concatenate([np.tile(np.eye(2), (n, 1, 1)), rng.normal(size=(n, 2, 2))], axis=2)
    fit = Dense(e, rows, np.zeros((4, 4)), np.zeros(4), lambda px: px)
    return fit, turn, time


def found(rng, n, terms, **more):
    fit, turn, time = drawn(rng, n, terms, **more)
    return memories(fit, turn, time, np.ones(n, dtype=bool))


def test_a_memory_is_found_with_its_size():
    """Over 12 flights of 160 exposures: the variance is that of the draws, and its memory within the ladder's factor of two."""
    rng = np.random.default_rng(1)
    flights = [found(rng, 160, [(SIGMA_RAD, 4.0)]) for _ in range(12)]
    variance = [sum(one.sigma_rad**2 for one in flight) for flight in flights]
    # 80 s of a memory of 4 s hold some 10 independent draws of each of three axes: 12 flights know the variance to 8 %.
    assert np.mean(variance) / SIGMA_RAD**2 == pytest.approx(1.0, abs=0.25)
    weighed = [sum(one.sigma_rad**2 * np.log(one.correlation_s) for one in f) / v for f, v in zip(flights, variance, strict=True)]
    assert np.exp(np.mean(weighed)) == pytest.approx(4.0, rel=0.5)


def test_two_memories_are_told_apart():
    rng = np.random.default_rng(2)
    flights = [found(rng, 160, [(SIGMA_RAD, 0.6), (SIGMA_RAD, 15.0)]) for _ in range(8)]
    short = np.mean([sum(one.sigma_rad**2 for one in flight if one.correlation_s < 3) for flight in flights])
    long = np.mean([sum(one.sigma_rad**2 for one in flight if one.correlation_s > 3) for flight in flights])
    assert short / SIGMA_RAD**2 == pytest.approx(1.0, abs=0.35) and 0.4 < long / SIGMA_RAD**2 < 1.6


@pytest.mark.parametrize("white", [0.5, 1.0, 2.0])
def test_white_noise_has_none(white):
    """What is left of the variance is a small part of the noise's, however large that is."""
    rng = np.random.default_rng(3)
    flights = [found(rng, 120, [], white=white) for _ in range(6)]
    variance = np.mean([sum(one.sigma_rad**2 for one in flight) for flight in flights])
    assert variance * (TURN_PX**2).sum() / 2 < 0.15 * white**2


def test_of_many_measurements_some_runs_are_looked_at():
    rng = np.random.default_rng(4)
    flights = [found(rng, 600, [(SIGMA_RAD, 4.0)]) for _ in range(3)]
    assert np.mean([sum(one.sigma_rad**2 for one in f) for f in flights]) / SIGMA_RAD**2 == pytest.approx(1.0, abs=0.35)


def test_one_moment_has_no_memory():
    fit, turn, _ = drawn(np.random.default_rng(5), 30, [])
    assert memories(fit, turn, np.zeros(30), np.ones(30, dtype=bool)) == ()


def test_variances_are_those_of_the_greatest_likelihood():
    """Three variances of a normal vector, all well above zero: where scipy finds the greatest likelihood."""
    rng, m = np.random.default_rng(6), 120
    gap = np.abs(np.arange(m)[:, None] - np.arange(m)[None, :])
    kernels = [np.eye(m), np.exp(-gap / 3.0), np.exp(-gap / 30.0)]
    seen = np.linalg.cholesky(kernels[0] + 2 * kernels[1] + 4 * kernels[2]) @ rng.normal(size=m)

    def cost(log):
        whole = sum(np.exp(v) * k for v, k in zip(log, kernels, strict=True))
        return 0.5 * np.linalg.slogdet(whole)[1] + 0.5 * seen @ np.linalg.solve(whole, seen)

    expected = np.exp(minimize(cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9}).x)
    ours, _ = _components(seen, kernels)
    assert (expected > 0.2).all()
    assert cost(np.log(ours)) - cost(np.log(expected)) < 1e-3
    np.testing.assert_allclose(ours, expected, rtol=0.03)


def test_a_variance_that_is_hardly_known_is_the_mean_of_what_it_may_be():
    likely, sigma = np.array([0.0, 1.0, 0.1, 5.0, 0.0]), np.array([1.0, 1.0, 2.0, 0.1, 0.0])
    expected = [truncnorm.mean(-m / s, np.inf, loc=m, scale=s) if s else m for m, s in zip(likely, sigma, strict=True)]
    np.testing.assert_allclose(_mean_above_zero(likely, sigma), expected, rtol=1e-9)
