"""Redundancy, normalised residuals and detectable errors against the dense matrices of a textbook (Baarda 1968)."""

import dataclasses

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag

import whiskjax as wj
from tests.estimate.textbooks import MadeUp, Textbook
from whiskjax.estimate.reliability import (
    DETECTABLE,
    foreseen,
    log_density,
    reliability,
    residual_covariance,
    squared_residuals,
    whitened_covariance,
)
from whiskjax.flights import haian

SIGMA = np.concatenate(haian.PRIOR_SIGMA)


def dense(design, weights):
    """Qvv P = I - A (A^T P A)^-1 A^T P, and Qvv, over all measurements and priors."""
    size = len(weights)
    shown = np.eye(size) - design @ np.linalg.inv(design.T @ weights @ design) @ design.T @ weights
    return shown, shown @ np.linalg.inv(weights)


RAYS = st.sampled_from([1, 2, 5])  # that see one point


@given(st.integers(0, 10**6), RAYS)
def test_reliability_is_the_dense_formula(seed, rays):
    """x and y of a point are correlated here, and rays that see one: P is not diagonal, v / sigma_v not the whitened residual."""
    it = MadeUp(seed, rays=rays)
    shown, cofactor = dense(it.design, it.weights)
    control, n = it.used, 2 * int(it.used.sum())
    assert np.abs(it.weights[0, 1]) > 0
    covariance = whitened_covariance(it.ready, it.here, control.astype(float))
    np.testing.assert_allclose(covariance, it.unknown_covariance, atol=1e-12)
    found = reliability(it.ready, it.here, covariance, control)

    np.testing.assert_allclose(found.redundancy[control].ravel(), np.diag(shown)[:n], atol=1e-11)
    # With what the priors' own residuals show, they add up to the degrees of freedom.
    freedom = len(it.weights) - it.k
    np.testing.assert_allclose(found.redundancy[control].sum() + np.diag(shown)[n:].sum(), freedom, rtol=1e-12)
    of_priors = 1 - np.diag(covariance)[it.has_prior]
    np.testing.assert_allclose(found.redundancy[control].sum() + of_priors.sum(), freedom, rtol=1e-12)

    expected = it.residuals / np.sqrt(np.diag(cofactor))
    np.testing.assert_allclose(found.normalised[control].ravel(), expected[:n], atol=1e-9)
    smallest = DETECTABLE / np.sqrt(np.diag(it.weights @ cofactor @ it.weights))
    np.testing.assert_allclose(found.detectable_px[control].ravel(), smallest[:n], rtol=1e-10)
    # An error in both coordinates of one ray: (P v)^T (P Q P)^-1 P v of its two entries, where P is diagonal v^T Q^-1 v.
    weighted, tested = it.weights @ it.residuals, it.weights @ cofactor @ it.weights
    blocks = [tested[i : i + 2, i : i + 2] for i in range(0, n, 2)]
    squared = [v @ np.linalg.solve(q, v) for q, v in zip(blocks, weighted[:n].reshape(-1, 2), strict=True)]
    np.testing.assert_allclose(found.squared[control], squared, rtol=1e-9)


def _density(it, which):
    share = it.used.astype(float)
    return log_density(foreseen(it.ready, it.here, share), it.unknown_covariance, share, which)


@given(st.integers(0, 10**6), RAYS)
def test_a_point_that_took_no_part_is_judged_as_a_prediction(seed, rays):
    """From the residuals of the others, which see some of the points as well: their conditional mean and covariance."""
    it = MadeUp(seed, rays=rays)
    check, to, others = ~it.used, np.flatnonzero(np.repeat(~it.used, 2)), it.deciding
    gain = it.whole_px2[np.ix_(to, others)] @ np.linalg.inv(it.of_deciding(it.whole_px2))
    rows, error = it.rows_px.reshape(-1, it.k), it.here.residual_px.ravel()
    error, moved = (error[to] - gain @ error[others]).reshape(-1, 2), rows[to] - gain @ rows[others]
    whole = it.whole_px2[np.ix_(to, to)] - gain @ it.whole_px2[np.ix_(others, to)] + moved @ it.unknown_covariance @ moved.T
    spread = np.array([whole[i : i + 2, i : i + 2] for i in range(0, len(to), 2)])
    found = reliability(it.ready, it.here, it.unknown_covariance, it.used)
    sigma = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    np.testing.assert_allclose(found.normalised[check], error / sigma, atol=1e-9)
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(spread), error)
    np.testing.assert_allclose(found.squared[check], squared, rtol=1e-8)
    assert np.isnan(found.redundancy[check]).all() and np.isnan(found.detectable_px[check]).all()
    expected = [scipy.stats.multivariate_normal(np.zeros(2), s).logpdf(e) for s, e in zip(spread, error, strict=True)]
    np.testing.assert_allclose(_density(it, check), np.mean(expected), rtol=1e-10)


def test_without_check_points_there_is_no_density():
    it = MadeUp(1, check=0)
    assert np.isnan(_density(it, ~it.used))


def test_an_error_as_large_as_detectable_is_found_four_times_in_five():
    """Alone in its coordinate and at 0.1 % (two-sided): the power of the normal test at the given non-centrality."""
    limit = scipy.stats.norm.isf(0.0005)
    power = scipy.stats.norm.sf(limit - DETECTABLE) + scipy.stats.norm.cdf(-limit - DETECTABLE)
    assert power == pytest.approx(0.8, abs=0.002)


def test_what_alone_determines_an_unknown_cannot_be_checked():
    """An unknown that only the first point's x sees takes its residual away: no redundancy, no detectable error."""
    it = MadeUp(5, n=12, check=0, has_prior=(True, False), point_m=0.0)
    it.rows_px[:, :, 1] = 0.0
    it.rows_px[0, 0, 1] = 3.0
    rows = it.rows_px / it.sigma_px[:, :, None]
    here = it.here._replace(rows=rows)
    covariance = whitened_covariance(it.ready, here, np.ones(12))
    found = reliability(it.ready, here, covariance, it.used)
    assert found.redundancy[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert np.isinf(found.detectable_px[0, 0]) and found.normalised[0, 0] == 0
    assert np.isfinite(found.detectable_px[0, 1]) and np.isfinite(found.squared).all()
    # Of the fixed point only y is left to test.
    of = foreseen(it.ready, here, np.ones(12))
    spread = residual_covariance(of, covariance, np.ones(12))[0]
    squared = squared_residuals(of, covariance, np.ones(12))[0]
    assert squared == pytest.approx(here.whitened[0, 1] ** 2 / spread[1, 1], rel=1e-9)


@pytest.fixture(scope="module")
def everything(flight, calibration):
    """Of all observations of the flight: the textbook's residuals, derivatives by whitened unknowns, and covariances."""
    textbook = Textbook(flight, check_too=True)
    u, step = calibration.value / SIGMA, 1e-3
    sides = [[textbook.residuals_px(SIGMA * (u + h * e)) for h in (step, -step)] for e in np.eye(15)]
    rows = np.stack([(up - down) / (2 * step) for up, down in sides], -1)
    return textbook.residuals_px(calibration.value), rows, textbook.covariances_px2(np.zeros(15))


def test_reliability_of_the_whiskbroom_is_the_textbooks(flight, calibration, everything):
    """Derivatives here are central differences of a plain loop: 1e-4 of each figure."""
    residual, rows, covariance = everything
    control = flight.observations().is_control
    n = 2 * int(control.sum())
    design = np.concatenate([rows[control].reshape(-1, 15), np.eye(15)])
    weights = np.linalg.inv(block_diag(*covariance[control], np.eye(15)))
    shown, cofactor = dense(design, weights)
    found = calibration.reliability
    np.testing.assert_allclose(found.redundancy[control].ravel(), np.diag(shown)[:n], atol=1e-4)
    np.testing.assert_allclose(
        found.normalised[control].ravel(), residual[control].ravel() / np.sqrt(np.diag(cofactor)[:n]), atol=1e-3
    )
    smallest = DETECTABLE / np.sqrt(np.diag(weights @ cofactor @ weights))
    np.testing.assert_allclose(found.detectable_px[control].ravel(), smallest[:n], rtol=1e-4)
    shares = 1 - np.diag(calibration.posterior.covariance) / SIGMA**2
    assert found.redundancy[control].sum() + shares.sum() == pytest.approx(calibration.fit.degrees_of_freedom, rel=1e-9)


def test_check_points_of_the_whiskbroom_are_predicted_with_their_density(flight, calibration, everything):
    residual, rows, covariance = everything
    check = np.flatnonzero(~flight.observations().is_control)
    u_covariance = calibration.posterior.covariance / np.outer(SIGMA, SIGMA)
    spread = covariance + rows @ u_covariance @ np.swapaxes(rows, 1, 2)
    logs = [scipy.stats.multivariate_normal(np.zeros(2), spread[i]).logpdf(residual[i]) for i in check]
    assert calibration.check_log_density == pytest.approx(np.mean(logs), rel=1e-5)


def test_the_weights_of_the_whiskbroom_are_correlated(everything):
    """What the end-to-end tests above would otherwise not show: x and y share the points' errors."""
    covariance = everything[2]
    rho = covariance[:, 0, 1] / np.sqrt(covariance[:, 0, 0] * covariance[:, 1, 1])
    assert np.abs(rho).max() > 1e-5


def test_a_blunder_shows_in_its_own_normalised_residual(flight, calibration):
    """Four times the detectable error: its residual is the largest of all, and has changed by redundancy times error."""
    observations = flight.observations()
    i = int(np.flatnonzero(observations.is_control)[30])
    error = 4 * calibration.reliability.detectable_px[i, 0]
    pixel = observations.pixel_px.copy()
    pixel[i, 0] += error
    spoilt = wj.calibrate(flight.sensor, dataclasses.replace(observations, pixel_px=pixel), flight.unknowns)
    control = observations.is_control
    assert np.argmax(np.where(control, spoilt.reliability.squared, 0)) == i
    assert np.argmax(np.where(control[:, None], np.abs(spoilt.reliability.normalised), 0)) == 2 * i
    change = (spoilt.residual_after_px - calibration.residual_after_px)[i, 0]
    assert change == pytest.approx(calibration.reliability.redundancy[i, 0] * error, rel=1e-3)
