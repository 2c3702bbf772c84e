"""Numbers that are not estimated but whose uncertainty counts, against dense matrices (Schmidt 1966)."""

import dataclasses

import jax
import numpy as np
import pytest
import scipy.linalg
import scipy.stats

import whiskjax as wj
from tests.estimate.textbooks import Stations


@pytest.fixture(scope="module")
def stations():
    return Stations()


@pytest.fixture(scope="module")
def considered(stations):
    return wj.calibrate(stations.sensor, stations.observations, stations.unknowns, consider=stations.biases)


@pytest.fixture(scope="module")
def dense(stations):
    """Derivatives of the control points' pixels by unknowns (A) and biases (H), weights, prior information, prior covariance."""
    control = np.repeat(stations.observations.is_control, 2)
    start = [1000.0 if x.name == "focal" else 0.0 for x in stations.unknowns]
    a = stations.derivatives(stations.unknowns, start).reshape(48, -1)[control]
    h = stations.derivatives(stations.biases, np.zeros(12)).reshape(48, -1)[control]
    p = np.diag(stations.sigma_px.ravel()[control] ** -2)
    information = np.diag([0.0 if x.sigma is None else x.sigma**-2 for x in stations.unknowns])
    return a, h, p, information, np.diag([x.sigma**2 for x in stations.biases])


def in_sigmas(covariance, like):
    sigma = np.sqrt(np.diag(like))
    return covariance / np.outer(sigma, sigma)


def test_the_covariance_is_widened_by_what_the_biases_do(considered, dense):
    """C + (C A^T P H) D (C A^T P H)^T, with D the prior covariance of what is considered."""
    a, h, p, information, prior = dense
    c = np.linalg.inv(a.T @ p @ a + information)
    moved = c @ a.T @ p @ h
    expected = c + moved @ prior @ moved.T
    np.testing.assert_allclose(in_sigmas(considered.posterior.covariance, expected), in_sigmas(expected, expected), atol=1e-9)
    np.testing.assert_allclose(considered.posterior.sigma, np.sqrt(np.diag(expected)), rtol=1e-9)
    np.testing.assert_allclose(considered.posterior.correlation, in_sigmas(expected, expected), atol=1e-9)
    # Here they matter: a sigma grows by half and more.
    assert (np.diag(expected) / np.diag(c)).max() > 2


def test_considering_moves_no_value(stations, considered):
    plain = wj.calibrate(stations.sensor, stations.observations, stations.unknowns)
    np.testing.assert_array_equal(considered.value, plain.value)
    np.testing.assert_array_equal(considered.posterior.data_share, plain.posterior.data_share)
    difference = considered.posterior.covariance - plain.posterior.covariance
    assert np.linalg.eigvalsh(in_sigmas(difference, plain.posterior.covariance)).min() > -1e-12


def test_estimated_with_the_others_it_costs_less(stations, dense):
    """The Schur complement; never larger than the considered covariance, because it is the best linear estimate."""
    focal = wj.Unknown("focal", "camera.focal_px", 1000.0, 2.0)
    considered = wj.calibrate(stations.sensor, stations.observations, stations.angles, consider=[focal])
    joint = wj.calibrate(stations.sensor, stations.observations, [*stations.angles, focal])
    a, h, p, information, _ = dense
    a, h, information, prior = a[:, :3], a[:, 3:], information[:3, :3], np.array([[4.0]])
    c = np.linalg.inv(a.T @ p @ a + information)
    moved = c @ a.T @ p @ h
    wide = c + moved @ prior @ moved.T
    np.testing.assert_allclose(in_sigmas(considered.posterior.covariance, wide), in_sigmas(wide, wide), atol=1e-9)
    cross = a.T @ p @ h
    schur = a.T @ p @ a + information - cross @ np.linalg.solve(h.T @ p @ h + np.linalg.inv(prior), cross.T)
    narrow, found = np.linalg.inv(schur), joint.posterior.covariance[:3, :3]
    np.testing.assert_allclose(in_sigmas(found, narrow), in_sigmas(narrow, narrow), atol=1e-9)
    values = np.linalg.eigvalsh(in_sigmas(considered.posterior.covariance - found, wide))
    assert values.min() > -1e-12 and values.max() > 0.01


@pytest.fixture(scope="module")
def noisy():
    """With the answer of a calibration that considers the biases, and of the same calibration without."""
    it = Stations(seed=1)
    return it, *(wj.calibrate(it.sensor, it.observations, it.unknowns, consider=of) for of in (it.biases, ()))


def test_the_cost_is_that_of_the_marginal_covariance(noisy):
    """Generalised least squares with what is considered in the covariance of the pixels, 1 / p + H D H^T, and the priors: its
    least cost, wherever in the linear problem it starts. Variance factor and tail probability are made of it."""
    it, found, plain = noisy
    control, k = np.repeat(it.observations.is_control, 2), len(it.unknowns)
    rows = it.derivatives([*it.unknowns, *it.biases], np.append(found.value, np.zeros(12))).reshape(48, -1)[control]
    a, h = rows[:, :k], rows[:, k:]
    prior = np.diag([x.sigma**2 for x in it.angles])
    covariance = scipy.linalg.block_diag(
        np.diag(it.sigma_px.ravel()[control] ** 2) + h @ np.diag([x.sigma**2 for x in it.biases]) @ h.T, prior
    )
    design = np.concatenate([a, -np.eye(k)[:3]])
    left = np.concatenate([found.residual_after_px.ravel()[control], found.value[:3]])
    weight = np.linalg.inv(covariance)
    left = left - design @ np.linalg.solve(design.T @ weight @ design, design.T @ weight @ left)
    assert found.estimate.cost == pytest.approx(left @ weight @ left, rel=1e-8)
    freedom = int(control.sum()) + 3 - k
    assert found.fit.degrees_of_freedom == plain.fit.degrees_of_freedom == freedom
    assert found.fit.variance_factor == pytest.approx(left @ weight @ left / freedom, rel=1e-8)
    assert found.fit.tail_probability == pytest.approx(scipy.stats.chi2(freedom).sf(left @ weight @ left), rel=1e-6)
    # Without, it is the sum of the squared residuals, of the same solution.
    squares = ((plain.residual_after_px / it.sigma_px).ravel()[control] ** 2).sum() + ((plain.value[:3] / 0.01) ** 2).sum()
    assert plain.estimate.cost == pytest.approx(squares, rel=1e-9) and plain.estimate.cost > found.estimate.cost


def test_estimated_along_it_leaves_the_same_cost(noisy):
    """The least |e + E c|^2 + |c|^2: the same to what the small biases bend, with as many more priors as numbers."""
    it, found, _ = noisy
    along = wj.calibrate(it.sensor, it.observations, [*it.unknowns, *it.biases])
    assert along.estimate.freedom == found.estimate.freedom
    assert along.estimate.cost == pytest.approx(found.estimate.cost, rel=1e-2)


def test_the_tail_probability_is_uniform():
    """400 flights whose biases, angles and noise are drawn as they are said: Kolmogorov and Smirnov against uniform, which chance
    fails once in a thousand. The sum of squared residuals, which was tested before, is far too large."""
    it, runs = Stations(), 400
    numbers = [*it.unknowns, *it.biases]
    draw = np.random.default_rng(12)
    sigma = np.array([x.sigma for x in it.biases])
    truth = np.column_stack(
        [0.01 * draw.normal(size=(runs, 3)), draw.uniform(995, 1005, runs), draw.normal(size=(runs, 12)) * sigma]
    )

    def pixels(values):
        return wj.project(wj.assign(it.sensor, numbers, values), it.shot, it.point_m, throw=False).pixel_px

    pixel_px = np.asarray(jax.jit(jax.vmap(pixels))(truth)) + draw.normal(size=(runs, 24, 2)) * it.sigma_px

    def costs(pixel_px):
        seen = dataclasses.replace(it.observations, pixel_px=pixel_px)
        found, plain = (wj.calibrate(it.sensor, seen, it.unknowns, consider=of).estimate for of in (it.biases, ()))
        return found.cost, plain.cost, found.freedom

    tested, summed, freedom = jax.jit(jax.vmap(costs))(pixel_px)
    uniform, not_uniform = (scipy.stats.kstest(scipy.stats.chi2(freedom[0]).sf(c), "uniform").pvalue for c in (tested, summed))
    assert uniform > 1e-3 and not_uniform < 1e-9


def test_what_is_considered_needs_a_prior(stations):
    free = dataclasses.replace(stations.biases[0], mean=None, sigma=None, scale=1.0)
    with pytest.raises(wj.WhiskjaxError, match="consider: pos_a_turn_x has no prior sigma"):
        wj.calibrate(stations.sensor, stations.observations, stations.unknowns, consider=[free])


def test_a_number_is_either_estimated_or_considered(stations):
    with pytest.raises(wj.WhiskjaxError, match="arm_x"):
        wj.calibrate(stations.sensor, stations.observations, stations.unknowns, consider=[stations.unknowns[0]])
