"""What sigmas found from the data do to the covariance, against dense refits, Student's t and drawing again and again."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import t as student

import whiskjax as wj
from tests.estimate.test_variance_components import FLAT, grouping_of
from tests.estimate.textbooks import MadeUp
from whiskjax.estimate.variance_components import LEAST_KNOWN, Grouping, components, data_of, decided, group, weighing
from whiskjax.estimate.weight_uncertainty import of_least_squares
from whiskjax.flights import haian


def refit(it, grouping, theta):
    """Answer and covariance of dense least squares with factors on the sigmas."""
    factor = np.append(np.exp(theta), [1.0, 1.0])
    sigma = (it.sigma_px * factor[grouping.observed])[it.used]
    v = np.diag(sigma.ravel() ** 2) + it.of_deciding(it.survey_px2)
    rows, y = it.rows_px[it.used].reshape(-1, it.k), it.measured_px[it.used].ravel()
    priors = np.diag(it.has_prior / factor[grouping.prior] ** 2)
    covariance = np.linalg.inv(rows.T @ np.linalg.solve(v, rows) + priors)
    return -covariance @ rows.T @ np.linalg.solve(v, y), covariance


@pytest.mark.parametrize("seed, rays", [(1, 1), (2, 5)])
def test_the_covariance_is_that_of_refits(seed, rays):
    """J and g by differences of dense refits; Cov = C nu / (nu - 2) + J W J^T, row by row."""
    it = MadeUp(seed, n=90, rays=rays)
    whole = grouping_of(it).keep(np.array([True] * 5 + [False]))
    found = components(whole, 30.0, it.ready, it.here, it.used)
    theta, h = np.log(found.factor), 1e-4
    answer, log_variance = [], []
    for e in h * np.eye(5):
        (more, wide), (less, tight) = (refit(it, whole, theta + side * e) for side in (1, -1))
        answer.append((more - less) / (2 * h))
        log_variance.append(np.log(np.diag(wide) / np.diag(tight)) / (2 * h))
    answer, log_variance = np.array(answer), np.array(log_variance)
    got = of_least_squares(found, data_of(whole, 30.0, it.ready, it.here, it.used), it.k)
    np.testing.assert_allclose(got.moved @ got.moved.T, answer.T @ found.covariance @ answer, rtol=1e-5, atol=1e-9)
    relative = np.array([g @ found.covariance @ g for g in log_variance.T])
    assert (relative < 0.4).all()  # as of five values or more
    np.testing.assert_allclose(got.growth, 1 / np.sqrt(1 - relative), rtol=1e-6)
    # As the docstring says of any covariance: it grows with each variance, and with all together by no more than they do.
    assert (log_variance > -1e-9).all() and (log_variance.sum(axis=0) < 2 + 1e-6).all()
    _, covariance = refit(it, whole, theta)
    grown = got.of(covariance)
    np.testing.assert_allclose(
        np.diag(grown), np.diag(covariance) / (1 - relative) + np.diag(answer.T @ found.covariance @ answer)
    )
    assert (np.diag(grown) > np.diag(covariance)).all()


def test_one_variance_makes_it_students_t():
    """Without priors and surveys nu is the number of values less that of unknowns, and errors have the variance of a t."""
    off = []
    for seed in range(400):
        it = MadeUp(seed, n=6, check=0, has_prior=(False, False), point_m=0.0)
        one = Grouping(("all",), np.zeros((6, 2), dtype=int), np.full(2, -1))
        found = components(one, FLAT, it.ready, it.here, it.used)
        assert found.log_sigma[0] == pytest.approx(1 / math.sqrt(2 * 10), rel=1e-6)
        got = of_least_squares(found, data_of(one, FLAT, it.ready, it.here, it.used), 2)
        np.testing.assert_allclose(got.growth**2, student(10).var(), rtol=1e-6)
        np.testing.assert_allclose(got.moved, 0, atol=1e-9)
        answer, covariance = refit(it, one, np.log(found.factor))
        truth = np.linalg.lstsq(it.rows_px.reshape(-1, 2), -(it.measured_px - it.error_px).ravel(), rcond=None)[0]
        off.append((answer - truth) / np.sqrt(np.diag(got.of(covariance))))
    # 400 draws of two hardly correlated numbers; the squares of t of 10 degrees of freedom scatter by 2 of their mean.
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=4 * 2 / math.sqrt(800))


def test_what_the_data_do_not_know_stays_as_stated():
    """Of six groups the last two, of two priors and of one, are given up; pixels of such a group keep their sigma."""
    it = MadeUp(3, n=90, point_m=0.0)
    whole = grouping_of(it)
    assert (components(whole, 30.0, it.ready, it.here, it.used).log_sigma[4:] > LEAST_KNOWN).all()
    left, found = decided(whole, 30.0, it.ready, it.here, it.used)
    assert left.names == found.names == whole.names[:4] and (left.prior == -1).all()
    np.testing.assert_array_equal(left.observed, whole.observed)
    some = whole.keep(np.array([True, False, True, True, False, True]))
    np.testing.assert_array_equal(np.unique(some.observed), [-2, 0, 1, 2])
    np.testing.assert_array_equal(some.prior, [-1, -1, 3, -1, -1])
    kept = components(some, 30.0, it.ready, it.here, it.used)
    observed, prior = weighing(some, kept)
    assert (observed[some.observed == -2] == 1).all() and (prior[:2] == 1).all() and prior[2] == kept.factor[3]


def test_nothing_is_known_of_four_points():
    """Neither of images nor of priors: it is the calibration that it is without."""
    flight = haian.simulate(3)
    seen = flight.observations()
    few = seen.take(np.flatnonzero(np.asarray(seen.images) == "L1")[:: 65 // 3][:2])
    plain = wj.calibrate(flight.sensor, few, flight.unknowns, errors=flight.errors)
    found = wj.calibrate(flight.sensor, few, flight.unknowns, errors=flight.errors, reweigh=wj.Reweigh(priors=True))
    assert found.components.names == ()
    np.testing.assert_allclose(found.value, plain.value, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.estimate.covariance, plain.estimate.covariance, rtol=1e-9)


def test_images_of_few_points_share_a_factor(flight):
    seen = flight.observations()
    images, order = np.array(seen.images), np.arange(len(seen))
    control = seen.is_control & ((images != "R1") | (order % 25 == 0))
    some = group(wj.Reweigh(), dataclasses.replace(seen, is_control=control), flight.unknowns)
    assert some.names == ("L1 x", "L1 y", "images of few points x", "images of few points y")


def test_priors_share_a_factor_where_they_were_one_statement(flight):
    """Angles of 0.03, 5 and 0.1 deg have nothing in common, and neither have an angle and a lever arm."""
    found = group(wj.Reweigh(priors=True), flight.observations(), flight.unknowns)
    members = {name: [x.name for x, g in zip(flight.unknowns, found.prior, strict=True) if found.names[g] == name]
               for name in found.names[4:]}  # fmt: skip
    assert members == {
        "priors of lever arm (0.2 m)": ["u_gps", "v_gps", "u_sen", "v_sen"],
        "priors of lever arm (1 m)": ["w_gps"],
        "priors of angles (5 deg)": ["omega_pos_left", "omega_pos_right", "phi_sen"],
        "priors of angles (0.02 deg)": ["phi_pos_left", "phi_pos_right"],
        "priors of angles (0.5 deg)": ["kappa_pos_left", "kappa_pos_right"],
        "priors of lever arm (2 m)": ["w_sen"],
        "priors of angles (0.03 deg)": ["omega_sen"],
        "priors of angles (0.1 deg)": ["kappa_sen"],
    }


def test_what_is_considered_is_no_reason_for_larger_sigmas():
    """A bias that all measurements share is in their residuals, and in what they were said to be."""
    it = MadeUp(8)
    effect = np.random.default_rng(1).normal(size=(40, 2, 1)) * 5
    ready = dataclasses.replace(it.ready, observations=it.observations)
    here = it.here._replace(residual_px=it.here.residual_px + 2 * effect[..., 0])
    whole = grouping_of(it).keep(np.array([True] * 4 + [False] * 2))
    clean = components(whole, 30.0, ready, it.here, it.used)
    blamed, known = (components(whole, 30.0, ready, here, it.used, with_it) for with_it in (None, effect))
    assert (blamed.factor > 3 * clean.factor).all()
    np.testing.assert_allclose(known.factor, clean.factor, rtol=0.3)
