"""Numbers that are not estimated but whose uncertainty counts, against dense matrices (Schmidt 1966)."""

import dataclasses

import numpy as np
import pytest

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


def test_what_is_considered_needs_a_prior(stations):
    free = dataclasses.replace(stations.biases[0], mean=None, sigma=None, scale=1.0)
    with pytest.raises(wj.WhiskjaxError, match="consider: pos_a_turn_x has no prior sigma"):
        wj.calibrate(stations.sensor, stations.observations, stations.unknowns, consider=[free])


def test_a_number_is_either_estimated_or_considered(stations):
    with pytest.raises(wj.WhiskjaxError, match="arm_x"):
        wj.calibrate(stations.sensor, stations.observations, stations.unknowns, consider=[stations.unknowns[0]])
