"""Weights from the data, against restricted maximum likelihood with dense matrices and scipy's minimiser."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import minimize

import whiskjax as wj
from tests.estimate.textbooks import MadeUp
from whiskjax.estimate.variance_components import Grouping, components, group
from whiskjax.flights import haian

NAMES = ("A x", "A y", "B x", "B y", "first priors", "last prior")
# Of what a hyperprior this wide says nothing is left.
FLAT = 1e300


def grouping_of(it):
    """Images A and B, x and y apart; the first two priors and the third; the unknowns without a prior in no group."""
    observed = np.array([[2 * (image == "B"), 2 * (image == "B") + 1] for image in it.observations.images])
    return Grouping(NAMES, observed, np.array([4, 4, 5, -1, -1]))


def minus_log_restricted_likelihood(theta, it, grouping, spread):
    """1/2 (log det V + log det X^T V^-1 X + y^T P y): unknowns with a prior are part of V, the others are X.

    Patterson and Thompson (1971); the hyperprior is a normal one of the logarithms.
    """
    factor = np.append(np.exp(theta), 1.0)
    sigma = (it.sigma_px * factor[grouping.observed])[it.used]
    noise = np.diag(sigma.ravel() ** 2) + it.of_deciding(it.survey_px2)
    rows = it.rows_px[it.used].reshape(-1, it.k)
    random, x = rows[:, it.has_prior], rows[:, ~it.has_prior]
    v = noise + random @ np.diag(factor[grouping.prior[it.has_prior]] ** 2) @ random.T
    y, inverse = it.measured_px[it.used].ravel(), np.linalg.inv(v)
    fixed = x.T @ inverse @ x
    p = inverse - inverse @ x @ np.linalg.solve(fixed, x.T @ inverse)
    volume = np.linalg.slogdet(v)[1] + np.linalg.slogdet(fixed)[1]
    return 0.5 * (volume + y @ p @ y) + 0.5 * np.sum((theta / math.log(spread)) ** 2)


def gradient(f, x, step=1e-4):
    """Central differences: forward ones, scipy's default, leave a flat minimum known to 3e-5 only."""
    return np.array([f(x + e) - f(x - e) for e in step * np.eye(len(x))]) / (2 * step)


def hessian(f, x, step=1e-3):
    """Central differences."""
    e = step * np.eye(len(x))
    rows = [[f(x + a + b) - f(x + a - b) - f(x - a + b) + f(x - a - b) for b in e] for a in e]
    return np.array(rows) / (4 * step**2)


@pytest.mark.parametrize("seed, spread, rays", [(1, 30.0, 1), (2, 3.0, 1), (3, FLAT, 1), (1, 30.0, 5), (2, FLAT, 2)])
def test_factors_are_the_dense_maximum_and_their_sigmas_its_curvature(seed, spread, rays):
    it = MadeUp(seed, rays=rays)
    grouping = grouping_of(it)
    # Given sigmas are wrong: what is found is not 1.
    it.observations = dataclasses.replace(it.observations, sigma_px=it.sigma_px * [0.5, 3.0])
    it.sigma_px = it.observations.sigma_px
    ready = dataclasses.replace(it.ready, observations=it.observations)
    found = components(grouping, spread, ready, it.here, it.used)

    def cost(theta):
        return minus_log_restricted_likelihood(theta, it, grouping, spread)

    best = minimize(cost, np.zeros(6), method="BFGS", jac=lambda x: gradient(cost, x), options={"gtol": 1e-9}).x
    # A minimum known to its slope's rounding: a hundred thousandth of a factor.
    np.testing.assert_allclose(np.log(found.factor), best, atol=1e-5)
    np.testing.assert_allclose(found.log_sigma, np.sqrt(np.diag(np.linalg.inv(hessian(cost, best)))), rtol=1e-4)
    assert cost(np.log(found.factor)) <= cost(best) + 1e-9
    assert found.names == NAMES
    np.testing.assert_array_equal(found.is_prior, [False, False, False, False, True, True])
    per_image = [int((np.array(it.observations.images)[it.used] == image).sum()) for image in "AB"]
    np.testing.assert_array_equal(found.count, [per_image[0], per_image[0], per_image[1], per_image[1], 2, 1])


def test_all_sigmas_times_c_divide_the_factors_by_c():
    """The points' own covariance carries no factor, so there is none here; whitened unknowns become c times as large."""
    it, c = MadeUp(4, point_m=0.0), 7.0
    grouping = grouping_of(it)
    plain = components(grouping, FLAT, it.ready, it.here, it.used)
    ready = dataclasses.replace(it.ready, observations=dataclasses.replace(it.observations, sigma_px=c * it.sigma_px))
    here = it.here._replace(u=it.here.u / c, rows_px=c * it.here.rows_px)
    scaled = components(grouping, FLAT, ready, here, it.used)
    # The hyperprior pulls by log(c) / log(spread)^2 against the curvature 1 / log_sigma^2: millionths for groups of one value.
    pull = math.log(c) / math.log(FLAT) ** 2 * plain.log_sigma**2
    assert (np.abs(np.log(scaled.factor * c / plain.factor)) < 1.5 * pull + 1e-7).all() and pull.max() < 2e-5
    np.testing.assert_allclose(scaled.log_sigma, plain.log_sigma, rtol=1e-4)


def test_where_the_problem_was_made_linear_does_not_matter():
    """The same linear problem about another u: only the residual at u = 0 counts."""
    it = MadeUp(5)
    du = np.array([0.3, -2.0, 1.0, 0.5, 4.0])
    moved = it.here._replace(u=it.here.u + du, residual_px=it.here.residual_px + it.rows_px @ du)
    one = components(grouping_of(it), 30.0, it.ready, it.here, it.used)
    other = components(grouping_of(it), 30.0, it.ready, moved, it.used)
    np.testing.assert_allclose(other.factor, one.factor, rtol=1e-7)


def test_points_that_take_no_part_say_nothing():
    it = MadeUp(6)
    residual = it.here.residual_px + np.where(it.used[:, None], 0.0, 100.0)
    one = components(grouping_of(it), 30.0, it.ready, it.here, it.used)
    other = components(grouping_of(it), 30.0, it.ready, it.here._replace(residual_px=residual), it.used)
    np.testing.assert_array_equal(other.factor, one.factor)


def test_a_group_without_data_stays_and_is_as_uncertain_as_the_hyperprior():
    """No observation depends on the last prior's unknown: its own scatter is one number that the data do not see."""
    it = MadeUp(7)
    here = it.here._replace(rows_px=it.here.rows_px * [1, 1, 0, 1, 1])
    found = components(grouping_of(it), 30.0, it.ready, here, it.used)
    assert found.factor[-1] == pytest.approx(1.0, abs=1e-6)
    assert found.log_sigma[-1] == pytest.approx(math.log(30), rel=1e-6)


def test_images_with_control_points_have_groups(flight):
    observations, unknowns = flight.observations(), flight.unknowns
    assert group(wj.Reweigh(), observations, unknowns).names == ("L1 x", "L1 y", "R1 x", "R1 y")
    found = group(wj.Reweigh(priors={"arms": ["u_gps", "v_gps", "w_gps"]}), observations, unknowns)
    assert found.names == ("L1 x", "L1 y", "R1 x", "R1 y", "arms")
    images = np.array(observations.images)
    np.testing.assert_array_equal(found.observed[images == "R1"], np.broadcast_to([2, 3], (75, 2)))
    assert (found.observed[~np.isin(images, ["L1", "R1"])] == -1).all()
    np.testing.assert_array_equal(found.prior, np.repeat([4, -1, -1, -1, -1], 3))


@pytest.mark.parametrize(
    "rule, names",
    [
        (wj.Reweigh(), ("L1 x", "L1 y", "R1 x", "R1 y")),
        (wj.Reweigh(priors={}), ("L1 x", "L1 y", "R1 x", "R1 y")),
        (wj.Reweigh(axes=False), ("L1", "R1")),
        (wj.Reweigh(images=False), ("all images x", "all images y")),
        (wj.Reweigh(images=False, axes=False, priors={"arms": ["u_gps", "w_sen"]}), ("all images", "arms")),
    ],
)
def test_who_shares_a_factor_can_be_chosen(flight, rule, names):
    found = group(rule, flight.observations(), flight.unknowns)
    assert found.names == names
    named = [x.name for x, i in zip(flight.unknowns, found.prior, strict=True) if i >= 0]
    assert named == (["u_gps", "w_sen"] if "arms" in names else [])


@pytest.mark.parametrize(
    "priors, message",
    [
        ({"arms": ["u_gps", "u_imu"]}, "group 'arms' lists 'u_imu', which is no unknown with a prior"),
        ({"arms": ["kappa_sen"]}, "group 'arms' lists 'kappa_sen', which is no unknown with a prior"),
        ({"arms": ["u_gps"], "all": ["u_gps", "v_gps"]}, "'u_gps' is in two groups"),
        # A group of nobody has no scatter, and two groups of one name cannot be told apart: failed when written.
        ({"arms": []}, "arms"),
        ({"L1 x": ["u_gps"]}, "L1 x"),
    ],
)
def test_groups_that_make_no_sense(flight, priors, message):
    free = dataclasses.replace(flight.unknowns[-1], mean=None, sigma=None, scale=1.0)
    with pytest.raises(wj.WhiskjaxError, match=message):
        group(wj.Reweigh(priors=priors), flight.observations(), [*flight.unknowns[:-1], free])


@pytest.mark.parametrize("spread", [1.0, 0.0, -3.0, math.nan, math.inf])
def test_a_spread_that_makes_no_sense(spread):
    with pytest.raises(wj.WhiskjaxError, match="spread is a factor above 1"):
        wj.Reweigh(spread=spread)


@pytest.mark.parametrize("priors", [None, "all", ["u_gps"]])
def test_priors_that_are_no_groups(priors):
    with pytest.raises(wj.WhiskjaxError, match="priors is True, False, or groups of unknowns by name"):
        wj.Reweigh(priors=priors)


# Of the priors only all together are many enough.
ALL = wj.Reweigh(priors={"priors": [x.name for x in haian.unknowns()]})


@pytest.fixture(scope="module")
def reweighed(flight):
    """The flight with the sigmas of x three times too large in all images, of the y three times too small: the calibration."""
    observations = flight.observations()
    wrong = dataclasses.replace(observations, sigma_px=observations.sigma_px * [3.0, 1 / 3])
    return wj.calibrate(flight.sensor, wrong, flight.unknowns, reweigh=ALL)


def test_image_sigmas_wrong_by_three_are_found(reweighed):
    """Within three predicted sigmas of the logarithm.

    This can fail though nothing is wrong: four factors leave three sigmas once in a hundred seeds (the logarithm of a variance
    from 65 values is a little skew as well), and the simulated errors hold the jitter of the POS beside the image noise, 0.4 px
    in x of R1 where the noise is 1.5: 3 % of the factor, a third of its predicted sigma.
    """
    found = reweighed.components
    assert found.names[:4] == ("L1 x", "L1 y", "R1 x", "R1 y")
    off = np.log(found.factor[:4] * [3, 1 / 3, 3, 1 / 3]) / found.log_sigma[:4]
    assert np.abs(off).max() < 3
    # 65 values each, of which the unknowns take a few.
    assert (found.log_sigma[:4] > 1 / math.sqrt(2 * 65)).all() and (found.log_sigma[:4] < 1.2 / math.sqrt(2 * 65)).all()


def test_a_reweighed_calibration_carries_the_new_sigmas(flight, reweighed):
    given, found = flight.observations(), reweighed.components
    images = np.array(given.images)
    expected = given.sigma_px * [3.0, 1 / 3]
    expected[images == "L1"] *= found.factor[:2]
    expected[images == "R1"] *= found.factor[2:4]
    # The other images have check points alone: the mean of the factors of their axis, by the precision of the logarithms.
    weight = found.log_sigma[:4].reshape(2, 2) ** -2
    mean = np.exp((weight * np.log(found.factor[:4].reshape(2, 2))).sum(axis=0) / weight.sum(axis=0))
    expected[~np.isin(images, ["L1", "R1"])] *= mean
    np.testing.assert_allclose(reweighed.observations.sigma_px, expected, rtol=1e-12)
    assert found.names[4:] == ("priors",)
    sigma = [x.sigma * found.factor[4] for x in flight.unknowns]
    np.testing.assert_allclose([x.sigma for x in reweighed.unknowns], sigma, rtol=1e-12)
    assert [(x.name, x.where, x.mean) for x in reweighed.unknowns] == [(x.name, x.where, x.mean) for x in flight.unknowns]


def test_a_reweighed_calibration_is_the_one_with_the_new_sigmas(flight, reweighed):
    """Solution and fit are those of its own unknowns and observations, given to `calibrate` as they are; sigmas are larger."""
    again = wj.calibrate(flight.sensor, reweighed.observations, reweighed.unknowns)
    sigma = np.array([x.sigma for x in reweighed.unknowns])
    np.testing.assert_allclose((again.value - reweighed.value) / sigma, 0, atol=1e-8)
    larger = reweighed.posterior.sigma / again.posterior.sigma
    assert (larger > 1).all() and (larger < 1.3).all()  # of variance components known to 10 %, and of one of 15 priors
    assert again.fit.variance_factor == pytest.approx(reweighed.fit.variance_factor, rel=1e-8)
    # At the maximum, residuals are as large as their sigmas say: only the hyperprior (log 3 / log(30)^2 a group) stands between.
    assert reweighed.fit.variance_factor == pytest.approx(1.0, abs=0.02)


def test_wrong_weights_end_where_right_ones_do(flight, reweighed):
    """The factors are relative to what was given; what they make of it is not, but for the hyperprior. Check points agree, though
    their sigmas were given as wrong as the others'."""
    right = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, reweigh=ALL)
    assert reweighed.is_sound and reweighed.fit.check.chi_square == pytest.approx(right.fit.check.chi_square, rel=0.01)
    control = flight.observations().is_control
    np.testing.assert_allclose(reweighed.observations.sigma_px[control], right.observations.sigma_px[control], rtol=0.005)
    assert np.abs((reweighed.value - right.value) / right.posterior.sigma).max() < 0.02
    with pytest.raises(wj.WhiskjaxError, match="answer the same question twice"):
        wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, reweigh=wj.Reweigh(), loss=wj.Huber(2.0))


def test_weights_need_determined_unknowns(flight):
    """Only left images and no priors: the same error as without new weights (when written: "sigma_px is not a finite number")."""
    observations = flight.observations()
    left = dataclasses.replace(observations, is_control=observations.is_control & np.char.startswith(observations.images, "L"))
    free = [dataclasses.replace(x, mean=None, sigma=None, scale=x.sigma) for x in flight.unknowns]
    with pytest.raises(wj.SensorError, match="do not determine these unknowns: omega_pos_right, phi_pos_right, kappa_pos_right"):
        wj.calibrate(flight.sensor, left, free, reweigh=wj.Reweigh())
