"""Which model: every number against its formula, on small calibrations; and one whiskbroom whose swings share their truth."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.stats

import whiskjax as wj
from tests.estimate.textbooks import Stations
from whiskjax.flights import haian


def calibrated(seed, models=("angles", "focal"), **changed):
    it = Stations(seed)
    chosen = {"angles": it.angles, "focal": it.unknowns}
    observations = dataclasses.replace(it.observations, **changed)
    return {name: wj.calibrate(it.sensor, observations, chosen[name]) for name in models}


@pytest.fixture(scope="module")
def models():
    return calibrated(1)


def cost(model):
    """Squares of residuals over sigmas of the control points, and of unknowns over prior sigmas (their means are zero)."""
    used = model.observations.is_control
    whitened = (model.residual_after_px / model.observations.sigma_px)[used]
    pulled = [value / x.sigma for x, value in zip(model.unknowns, model.value, strict=True) if x.sigma is not None]
    return (whitened**2).sum() + np.square(pulled).sum()


def test_numbers_are_their_formulas(models):
    found = wj.compare(dict(reversed(models.items())))
    small, large = found.candidates
    assert (small.name, small.unknowns, large.name, large.unknowns) == ("angles", 3, "focal", 4)
    costs = [cost(models["angles"]), cost(models["focal"])]
    np.testing.assert_allclose([small.cost, large.cost], costs, rtol=1e-9)
    assert small.ratio == 0 and math.isnan(small.tail)
    assert large.ratio == pytest.approx(costs[0] - costs[1], abs=1e-8)
    assert large.tail == pytest.approx(scipy.stats.chi2(1).sf(costs[0] - costs[1]), rel=1e-6)
    aic = np.array([costs[0] + 2 * 3, costs[1] + 2 * 4])
    bic = np.array([costs[0] + math.log(40) * 3, costs[1] + math.log(40) * 4])  # 20 control points, two coordinates
    np.testing.assert_allclose([small.aic, large.aic], aic - aic.min(), atol=1e-8)
    np.testing.assert_allclose([small.bic, large.bic], bic - bic.min(), atol=1e-8)
    assert found.recommended == ("angles", "focal")[int(np.argmin(bic))]
    check = ~models["angles"].observations.is_control
    for candidate in found.candidates:
        model = models[candidate.name]
        rms = math.sqrt(np.mean(model.residual_after_px[check] ** 2))
        assert candidate.check_rms_px == pytest.approx(rms, rel=1e-12)
        assert candidate.check_log_density == model.check_log_density


@pytest.mark.parametrize("seed", range(2, 12))
def test_an_extra_unknown_never_costs(seed):
    """The smaller model is the larger one with the focal length held where it starts."""
    assert wj.compare(calibrated(seed)).candidates[1].ratio >= -1e-9


def test_the_reason_names_the_runner_up_and_the_check_points(models):
    found = wj.compare(models)
    other = "focal" if found.recommended == "angles" else "angles"
    assert f"{found.recommended} has the smallest BIC ({other} is" in found.reason
    assert f"an unknown has to save {math.log(40):.1f}" in found.reason
    density = {c.name: c.check_log_density for c in found.candidates}
    agree = max(density, key=lambda name: density[name]) == found.recommended
    assert ("the check points agree" in found.reason) == agree


def test_without_check_points_they_are_not_asked():
    found = wj.compare(calibrated(1, is_control=np.ones(24, bool)))
    assert all(math.isnan(c.check_rms_px) and math.isnan(c.check_log_density) for c in found.candidates)
    assert "check points" not in found.reason


def test_a_real_difference_is_seen():
    """With a focal length that is off by 20 px, eight sigmas of it, the larger model is taken."""
    it = Stations(1)
    long = wj.assign(it.sensor, it.unknowns, [0.0, 0.0, 0.0, 1020.0])
    pixel = np.asarray(wj.project(long, it.shot, it.point_m).pixel_px)
    found = wj.compare(calibrated(1, pixel_px=pixel + it.observations.pixel_px - Stations().observations.pixel_px))
    assert found.recommended == "focal" and found.candidates[1].tail < 1e-6


@pytest.mark.parametrize(
    "changed",
    [
        {"is_control": np.arange(24) > 3},
        {"sigma_px": np.full((24, 2), 1.5)},
        {"pixel_px": np.zeros((24, 2)) + np.arange(24)[:, None]},
        {"point_m": Stations().point_m + 1.0},
        {"shot": wj.Shot(time_s=np.zeros(24), image=np.repeat([1, 0], 12))},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_calibrations_of_other_data_are_not_compared(models, changed):
    other = calibrated(1, models=("focal",), **changed)
    with pytest.raises(wj.WhiskjaxError, match="other observations or other weights than angles"):
        wj.compare({"angles": models["angles"], **other})


def test_one_model_is_no_choice(models):
    with pytest.raises(wj.WhiskjaxError, match="at least two calibrations"):
        wj.compare({"angles": models["angles"]})


def shared_unknowns():
    """12: R_pos of both swings is one."""
    pairs = [(f"platform.left.angles_rad[{i}]", f"platform.right.angles_rad[{i}]") for i in range(3)]
    one = [dataclasses.replace(x, name=x.name[:-5], where=w) for x, w in zip(haian.unknowns()[3:6], pairs, strict=True)]
    return [*haian.unknowns()[:3], *one, *haian.unknowns()[9:]]


@pytest.mark.parametrize("truth, recommended", [("shared", "12 shared"), ("split", "15 split")])
def test_swings_are_told_apart_where_they_differ(truth, recommended):
    values = haian.TABLE_4._replace(right_rad=haian.TABLE_4.left_rad) if truth == "shared" else haian.TABLE_4
    flight = haian.simulate(11, truth=values)
    models = {
        "12 shared": wj.calibrate(flight.sensor, flight.observations(), shared_unknowns()),
        "15 split": wj.calibrate(flight.sensor, flight.observations(), flight.unknowns),
    }
    found = wj.compare(models)
    assert [c.unknowns for c in found.candidates] == [12, 15]
    assert found.recommended == recommended
