"""Gross errors: found, named and left out; and nothing else."""

import dataclasses

import numpy as np
import pytest
import scipy.stats

import whiskjax as wj
from tests.estimate.textbooks import MadeUp
from whiskjax.estimate import blunders as search
from whiskjax.estimate.blunders import Linear, descend
from whiskjax.flights import haian

TRUTH = np.concatenate(haian.TABLE_4)
SIGMA = np.concatenate(haian.PRIOR_SIGMA)


def names(observations, which):
    return {observations.label(int(i)) for i in which}


def spoil(observations, which, error_px):
    pixel = observations.pixel_px.copy()
    pixel[which] += error_px
    return dataclasses.replace(observations, pixel_px=pixel)


def prediction_error_px(flight, answer):
    """RMS distance from the exact images of the control points, without noise."""
    observations = flight.observations()
    exact, found = wj.images_of(flight.sensor, observations, flight.unknowns, np.stack([TRUTH, answer.value]))
    return np.sqrt(np.mean((found - exact)[observations.is_control] ** 2))


@pytest.fixture(scope="module")
def scattered(flight):
    """A tenth of the control points off by 10 to 150 px: the observations, which, and how far off (13, 2)."""
    observations, rng = flight.observations(), np.random.default_rng(0)
    wrong = rng.choice(np.flatnonzero(observations.is_control), 13, replace=False)
    angle, size = rng.uniform(0, 2 * np.pi, 13), rng.uniform(10, 150, 13)
    error = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return spoil(observations, wrong, error), wrong, error


@pytest.fixture(scope="module")
def cleansed(flight, scattered):
    return wj.calibrate(flight.sensor, scattered[0], flight.unknowns, blunders=wj.Blunders())


@pytest.fixture(scope="module")
def by_chance(flight):
    """What is rejected of the clean flight: of 130 good points each with a chance of one in a thousand."""
    return set(wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, blunders=wj.Blunders()).blunders)


def test_exactly_the_wrong_points_are_listed(calibration, scattered, cleansed, by_chance):
    """But for those whose error is below what can be detected in their point."""
    observations, wrong, error = scattered
    hidden = wrong[np.linalg.norm(error / calibration.reliability.detectable_px[wrong], axis=1) < 1]
    listed = set(cleansed.blunders)
    assert listed <= names(observations, wrong) | by_chance
    assert names(observations, wrong) - listed <= names(observations, hidden)
    assert len(hidden) <= 1 and len(listed) >= 12
    assert cleansed.is_sound
    assert names(observations, np.flatnonzero(~cleansed.used & observations.is_control)) == set(cleansed.blunders)


def without(observations, wrong):
    """The wrong points as check points."""
    return dataclasses.replace(observations, is_control=observations.is_control & ~np.isin(np.arange(len(observations)), wrong))


def test_the_solution_is_the_one_without_them(flight, scattered, cleansed):
    left_out = np.flatnonzero(~cleansed.used & scattered[0].is_control)
    right = wj.calibrate(flight.sensor, without(scattered[0], left_out), flight.unknowns)
    np.testing.assert_allclose((cleansed.value - right.value) / SIGMA, 0, atol=1e-8)
    np.testing.assert_allclose(cleansed.posterior.sigma, right.posterior.sigma, rtol=1e-7)
    np.testing.assert_allclose(cleansed.residual_after_px, right.residual_after_px, atol=1e-6)
    assert cleansed.fit.degrees_of_freedom == right.fit.degrees_of_freedom == 2 * (130 - len(left_out))
    assert cleansed.fit.variance_factor == pytest.approx(right.fit.variance_factor, rel=1e-8)
    # A blunder is judged like a check point: as a prediction.
    np.testing.assert_allclose(cleansed.reliability.squared, right.reliability.squared, rtol=1e-5)
    assert (cleansed.reliability.squared[left_out] > wj.Blunders().bound).all()
    assert (cleansed.reliability.squared[cleansed.used] <= wj.Blunders().bound).all()


def test_the_bound_is_a_chi_square_quantile():
    for level in (1e-4, 1e-3, 0.05):
        assert wj.Blunders(level=level).bound == pytest.approx(scipy.stats.chi2(2).isf(level), rel=1e-12)


def test_of_clean_points_no_more_than_the_level_is_rejected():
    """Four flights, 520 good points, all errors stated: no more than chance takes once in a thousand times."""
    flights = [haian.simulate(seed) for seed in (11, 12, 13, 14)]
    for level in (0.01, 1e-3):
        rule = wj.Blunders(level=level)
        found = [wj.calibrate(f.sensor, f.observations(), f.unknowns, errors=f.errors, blunders=rule) for f in flights]
        assert sum(len(answer.blunders) for answer in found) <= scipy.stats.binom(520, level).isf(1e-3)


@pytest.mark.parametrize("image", ["L1", "R1"])
def test_blunders_in_a_cluster_are_found(flight, calibration, by_chance, image):
    """A fifth of one image's points, neighbours in time, all off by the same 70 px: the prediction stays within 15 %."""
    observations = flight.observations()
    there = np.flatnonzero((np.array(observations.images) == image) & observations.is_control)
    wrong = there[np.argsort(np.asarray(observations.shot.time_s)[there])][5:18]
    found = wj.calibrate(flight.sensor, spoil(observations, wrong, [60.0, -40.0]), flight.unknowns, blunders=wj.Blunders())
    assert names(observations, wrong) <= set(found.blunders) <= names(observations, wrong) | by_chance and found.is_sound
    assert prediction_error_px(flight, found) <= 1.15 * prediction_error_px(flight, calibration)


def test_a_large_cluster_is_pointed_at(flight, by_chance):
    """40 % of an image left out: whether they or the others are wrong cannot be told from the data."""
    observations = flight.observations()
    there = np.flatnonzero((np.array(observations.images) == "R1") & observations.is_control)
    wrong = there[np.argsort(np.asarray(observations.shot.time_s)[there])][5:31]
    found = wj.calibrate(flight.sensor, spoil(observations, wrong, [60.0, -40.0]), flight.unknowns, blunders=wj.Blunders())
    said = [reason for reason in found.reasons if reason.kind == "one image"]
    count = 26 + sum("image R1" in name for name in by_chance - names(observations, wrong))
    assert len(said) == 1 and said[0].text.startswith(f"{count} of 65 observations of image R1 were left out")
    assert said[0].figures == {"image": "R1", "count": count, "of": 65} and said[0].grade == "caution"


def test_too_many_blunders_are_not_sound(flight, scattered, cleansed):
    few = wj.calibrate(flight.sensor, scattered[0], flight.unknowns, blunders=wj.Blunders(most=0.05))
    assert few.blunders == cleansed.blunders
    assert cleansed.is_sound and not few.is_sound and not few.fit.is_consistent


def test_blunders_and_weights_together(flight, scattered, cleansed):
    """With image sigmas three times too large a blunder of 13 px hides behind them; with weights from the data it does not."""
    observations = dataclasses.replace(scattered[0], sigma_px=3 * scattered[0].sigma_px)
    both = wj.calibrate(flight.sensor, observations, flight.unknowns, blunders=wj.Blunders(), reweigh=wj.Reweigh())
    assert set(cleansed.blunders) <= set(both.blunders)
    # 117 good points; with sigmas of its own making a calibration may lose one or two at the edge.
    assert len(both.blunders) <= len(cleansed.blunders) + 2
    off = np.log(3 * both.components.factor[:4]) / both.components.log_sigma[:4]
    assert np.abs(off).max() < 3


@pytest.mark.parametrize(
    "given", [{"level": 0.0}, {"level": 0.5}, {"level": -1.0}, {"most": 0.0}, {"most": 0.5}, {"level": np.nan}]
)
def test_parameters_that_make_no_sense(given):
    with pytest.raises(wj.WhiskjaxError, match=r"level and most lie between 0 and 0\.5"):
        wj.Blunders(**given)


def test_a_robust_loss_answers_the_same_question(flight):
    with pytest.raises(wj.WhiskjaxError, match="answer the same question twice"):
        wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, blunders=wj.Blunders(), loss=wj.Huber(2.0))


def textbook_descent(it, u, bound):
    """One start after the other, by numpy's least squares: the weight narrows from nine in ten residuals to the bound."""
    kept = it.here.whitened[it.used] - it.here.rows[it.used] @ it.here.u, it.here.rows[it.used]
    squared = lambda u: ((kept[0] + kept[1] @ u) ** 2).sum(axis=1)
    c = max(bound, np.quantile(squared(u), 0.9))
    left = 20
    while True:
        root = (c / (c + squared(u)))[:, None]
        rows = np.concatenate([(root[:, :, None] * kept[1]).reshape(-1, it.k), it.ready.prior])
        right = np.concatenate([(root * kept[0]).ravel(), np.zeros(it.k)])
        last, u = u, np.linalg.lstsq(rows, -right, rcond=None)[0]
        left -= c <= bound
        if c <= bound and (np.abs(u - last).max() < 1e-4 or left == 0):
            return u
        c = max(bound, c / 2)


@pytest.mark.parametrize("has_prior", [(True, True, True, False, False), (False,) * 5])
def test_descents_side_by_side_are_those_of_one_after_the_other(has_prior):
    it, rng, bound = MadeUp(3, n=70, has_prior=has_prior), np.random.default_rng(5), wj.Blunders().bound
    wrong = rng.random(70) < 0.3
    it.here = it.here._replace(whitened=it.here.whitened + 30 * wrong[:, None] * rng.normal(size=(70, 2)))
    linear = Linear(it.here.whitened[it.used] - it.here.rows[it.used] @ it.here.u, it.here.rows[it.used], it.ready.prior)
    starts = 3 * rng.normal(size=(12, it.k))
    found = descend(linear, starts, bound)
    for u, start in zip(found, starts, strict=True):
        np.testing.assert_allclose(u, textbook_descent(it, start, bound), rtol=0, atol=1e-7)
    share = rng.random((2, len(linear.residual)))
    for u, part in zip(linear.settled(starts[:1], share), share, strict=True):
        root = np.sqrt(part)[:, None]
        rows = np.concatenate([(root[:, :, None] * linear.rows).reshape(-1, it.k), it.ready.prior])
        right = np.concatenate([(root * linear.residual).ravel(), np.zeros(it.k)])
        np.testing.assert_allclose(u, np.linalg.lstsq(rows, -right, rcond=None)[0], rtol=0, atol=1e-9)


def test_an_unknown_that_nothing_holds_stays_where_it_is():
    it = MadeUp(4, has_prior=(True, True, True, True, False))
    linear = Linear(it.here.whitened, it.here.rows * [1, 1, 1, 1, 0], it.ready.prior)
    start = np.ones((1, 5))
    assert linear.settled(start, np.ones((1, len(it.used))))[0, 4] == 1.0


@pytest.mark.parametrize("n", [200, 1300])
def test_what_the_search_looks_at_does_not_grow(monkeypatch, n):
    """As many descents, and no more than a thousand observations in each, however many there are."""
    it, looked = MadeUp(6, n=n), []

    def seen(linear, u, bound):
        looked.append((len(u), len(linear.residual)))
        return u

    monkeypatch.setattr(search, "descend", seen)
    monkeypatch.setattr(search, "linearise", lambda ready, u: u)
    monkeypatch.setattr(search, "_follow", lambda ready, here, control, bound: here)
    search._robust(it.ready, it.here, it.used, 13.8)
    assert looked == [(61, min(n - 6, 1000))]


def test_what_is_looked_at_is_enough_for_the_unknowns():
    control, draw = np.arange(9000) % 9 > 0, np.random.default_rng(0)
    for k, size in ((15, 1000), (300, 3000), (2000, 8000)):
        chosen = search.sample(control, k, draw)
        assert len(np.unique(chosen)) == len(chosen) == size and control[chosen].all()


def test_the_search_is_not_silent(flight):
    said = []
    with wj.telling(said.append):
        wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, blunders=wj.Blunders(), reweigh=wj.Reweigh())
    assert said[0].startswith("calibrate: 15 unknowns from 130 control observations")
    assert "blunders: 61 of 61 descents" in said and "weights: round 1" in said
    assert any(one.startswith("blunders: round 1, ") for one in said)
