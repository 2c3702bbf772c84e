"""Looks that are gated, missed or unseen, and whether the answer says that it may be believed."""

import jax
import numpy as np
import pytest
from scipy import stats

import whiskjax as wj
from tests.locate.textbooks import EXACT, TABLE_1, differentiated, kalman, least_squares, noise_of
from whiskjax.flights import tianshan

GATE = 1e-3
GROSS = {7: (3000.0, -1000.0), 23: (-500.0, 2000.0)}
METHODS = ["iterated", "batch"]


@pytest.fixture(scope="module")
def spoilt(run):
    """Two looks registered to the wrong feature."""
    pixel = run.pixel_px.copy()
    for k, off in GROSS.items():
        pixel[k] += off
    return pixel


def without(pixel, looks):
    kept = pixel.copy()
    kept[list(looks), 0] = np.nan  # half a measurement is none
    return kept


@pytest.mark.parametrize("method", METHODS)
def test_gross_errors_are_gated_and_listed_and_change_nothing(run, spoilt, method):
    options = {"method": method, "errors": tianshan.frame_errors(), "throw": False}
    found = run.locate(run.looks_at(spoilt), gate=GATE, **options)
    assert found.gated == (7, 23)
    assert any("2 of 40 looks did not pass the gate: look 7, look 23" in said for said in found.warnings)
    assert found.is_sound and found.freedom == 76
    clean = run.locate(run.looks_at(without(spoilt, GROSS)), **options)
    np.testing.assert_allclose(found.line_m, clean.line_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.covariance_enu_m2, clean.covariance_enu_m2, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.chi_square, clean.chi_square, rtol=1e-6)
    # Without a gate they spoil it, and that is said.
    believed = run.locate(run.looks_at(spoilt), **options)
    assert not believed.is_sound and np.linalg.norm(np.asarray(believed.line_m) - np.asarray(clean.line_m)) > 5


def refitted(run, pixel, used):
    """The NIS of each look beside least squares of all others that were used, by the textbook."""
    nis = []
    for k in range(40):
        others = without(pixel, [i for i in range(40) if i == k or not used[i]])
        fit = least_squares(run.image, others, np.zeros(3), run.prior, sigma_w=TABLE_1, steps=4)
        rows = differentiated(lambda s, k=k: run.image(k, s, EXACT), fit.state)
        spread = noise_of(run.image, k, fit.state, 2.0, TABLE_1) + rows @ fit.formal @ rows.T
        residual = pixel[k] - run.image(k, fit.state, EXACT)
        nis.append(residual @ np.linalg.solve(spread, residual))
    return np.array(nis)


@pytest.mark.parametrize("method", METHODS)
def test_the_gate_is_that_of_chi_square_with_two_freedoms_beside_all_other_looks(run, spoilt, method):
    gate = 0.05  # which takes good looks, too
    found = run.locate(run.looks_at(spoilt), gate=gate, errors=tianshan.frame_errors(), method=method, throw=False)
    passes = np.asarray(found.looks.passes)
    assert 2 < (~passes).sum() < 8
    np.testing.assert_array_equal(passes, refitted(run, spoilt, passes) <= stats.chi2.isf(gate, 2))
    if method == "iterated":
        plain = kalman(
            run.image, without(spoilt, np.flatnonzero(~passes)), np.zeros(3), run.prior, sigma_w=TABLE_1, relinearised=5
        )
        sigma = np.sqrt(np.diag(plain.covariance[-1]))
        assert np.abs((np.asarray(found.line_m) - run.anchor_m - plain.state[-1]) / sigma).max() < 1e-6
        np.testing.assert_allclose(np.asarray(found.looks.nis)[passes], plain.nis[passes], rtol=1e-5)


PLACES = {"first": range(8), "in the middle": range(16, 24), "last": range(32, 40), "scattered": range(1, 40, 5)}


@pytest.mark.parametrize("method", METHODS)
def test_a_gate_takes_the_same_looks_wherever_wrong_ones_stand(run, method):
    """32 good looks, and 8 wrong ones among them: of the same good looks the answer is the same."""
    answers = []
    for places in PLACES.values():
        wrong = np.isin(np.arange(40), list(places))
        order = np.empty(40, dtype=int)
        order[wrong], order[~wrong] = np.arange(8), np.arange(8, 40)
        pixel = run.pixel_px[order] + np.where(wrong, 1.0, 0.0)[:, None] * [2500.0, -1500.0]
        sensor = tianshan.sensor(jax.tree.map(lambda a, order=order: np.asarray(a)[order], run.recorded))
        found = run.locate(run.looks_at(pixel), sensor=sensor, gate=GATE, errors=tianshan.frame_errors(), method=method)
        assert found.gated == tuple(places)
        answers.append(found)
    first, sigma = answers[0], np.sqrt(np.diag(answers[0].covariance_enu_m2))
    for other in answers[1:]:
        away = np.asarray(first.world_from_enu).T @ (np.asarray(other.point_m) - np.asarray(first.point_m))
        assert (np.abs(away) < 1e-6 * sigma).all()


def repeated(run, times):
    """Each look so many times in a row, its records with it."""
    each = np.repeat(np.arange(40), times)
    sensor = tianshan.sensor(jax.tree.map(lambda a: np.asarray(a)[each], run.recorded))
    return sensor, run.time_s[each], run.pixel_px[each]


@pytest.mark.parametrize("method", METHODS)
def test_looks_that_repeat_an_earlier_one_are_counted_once(run, method):
    sensor, time_s, pixel = repeated(run, 3)
    options = {"method": method, "errors": tianshan.frame_errors()}
    once, found = run.locate(**options), run.locate(wj.Looks(wj.Shot(time_s=time_s), pixel, (2.0, 2.0)), sensor=sensor, **options)
    (said,) = (one for one in found.reasons if one.kind == "looks repeated")
    assert said.grade == "caution" and said.figures["looks"] == [i for i in range(120) if i % 3]
    assert found.is_sound and found.freedom == 80 and not any(one.kind == "copies" for one in found.reasons)
    sigma = np.sqrt(np.diag(once.covariance_enu_m2))
    assert (np.abs(np.asarray(found.point_m) - np.asarray(once.point_m)) < 1e-6 * sigma.min()).all()
    np.testing.assert_allclose(found.covariance_enu_m2, once.covariance_enu_m2, rtol=1e-6)

    def traced(time_s, pixel):
        looks = wj.Looks(wj.Shot(time_s=time_s), pixel, (2.0, 2.0))
        return wj.locate(sensor, looks, guess=run.guess, throw=False, **options)

    inside = jax.jit(traced)(time_s, pixel)
    np.testing.assert_array_equal(inside.looks.is_repeat, np.arange(120) % 3 > 0)
    np.testing.assert_allclose(inside.point_m, found.point_m, rtol=0, atol=1e-6)


def test_looks_of_one_moment_at_different_pixels_are_no_repeats_and_near_copies_fail(run):
    sensor, time_s, pixel = repeated(run, 2)
    near = pixel + 1e-6 * (np.arange(80) % 2)[:, None]
    found = run.locate(wj.Looks(wj.Shot(time_s=time_s), near, (2.0, 2.0)), sensor=sensor, errors=tianshan.frame_errors())
    assert not np.asarray(found.looks.is_repeat).any()
    assert any(one.kind == "copies" and one.grade == "failure" for one in found.reasons)


def test_a_filter_says_how_far_it_ended_from_least_squares_of_its_looks(run):
    for method in ("extended", "iterated"):
        found = run.locate(method=method, errors=tianshan.frame_errors())
        dense = least_squares(run.image, run.pixel_px, np.zeros(3), run.prior, sigma_w=TABLE_1)
        away = np.asarray(found.point_m) - run.anchor_m - dense.state
        expected = np.sqrt(away @ np.linalg.solve(dense.formal, away))
        (said,) = (one for one in found.reasons if one.kind == "filter and all looks")
        assert said.grade == "note" and said.figures["sigmas"] == pytest.approx(expected, rel=1e-3)
    assert not any(one.kind == "filter and all looks" for one in run.locate(method="batch").reasons)
    # From far away an extended filter ends where it began to err.
    far = wj.Guess.around(run.anchor_m + 3000.0 * run.anchor_m / np.linalg.norm(run.anchor_m), np.full(3, 3000.0))
    found = run.locate(guess=far, method="extended", errors=tianshan.frame_errors(), throw=False)
    grade = {one.grade for one in found.reasons if one.kind == "filter and all looks"}
    off = float(found.off_optimum_sigmas)
    assert grade == {"failure" if off > 1 else "caution" if off > 0.5 else "note"} and off > 0.5


@pytest.mark.parametrize("method", METHODS)
def test_a_gate_that_shuts_out_most_looks_makes_the_answer_unsound(run, method):
    pixel = run.pixel_px + np.where(np.arange(40)[:, None] % 3 > 0, [0.0, 5000.0], 0.0) * np.cos(np.arange(40))[:, None]
    found = run.locate(run.looks_at(pixel), gate=GATE, method=method, errors=tianshan.frame_errors(), throw=False)
    if len(found.gated) > 20:
        assert not found.is_consistent
    assert not found.is_sound


@pytest.mark.parametrize("method", METHODS)
def test_missed_looks_change_nothing_and_are_counted(run, method):
    missed = [0, 5, 6, 39]
    pixel = without(run.pixel_px, missed)
    found = run.locate(run.looks_at(pixel), method=method, errors=tianshan.frame_errors())
    assert found.missed == 4 and found.freedom == 72
    assert any("4 of 40 looks have no measurement" in said for said in found.warnings)
    assert np.isnan(np.asarray(found.looks.innovation_px)[missed]).all()
    assert not np.asarray(found.looks.is_used)[missed].any()
    assert found.is_sound and np.isfinite(np.asarray(found.looks.point_m)).all()
    if method == "iterated":
        plain = kalman(run.image, pixel, np.zeros(3), run.prior, sigma_w=TABLE_1, relinearised=5)
        sigma = np.sqrt(np.diagonal(plain.covariance, axis1=1, axis2=2))
        error = np.asarray(found.looks.point_m) - run.anchor_m - plain.state
        assert np.abs(error / sigma).max() < 1e-6
        np.testing.assert_allclose(found.chi_square, np.nansum(plain.nis), rtol=1e-6)
        np.testing.assert_array_equal(found.looks.point_m[0], run.anchor_m)


def test_the_paper_s_filter_is_unsound_and_says_why(run):
    found = run.locate(method="extended", throw=False)
    assert not found.is_consistent and not found.is_sound
    assert found.tail_probability < 1e-4
    assert any("errors of the recorded poses are missing" in said for said in found.warnings)
    honest = run.locate(method="extended", errors=tianshan.frame_errors(), throw=False)
    # What can be said of any gimbal whose zeros nobody estimates is the only thing left to say.
    assert honest.is_sound and {one.kind for one in honest.reasons if one.grade != "note"} == {"silent errors"}
    np.testing.assert_allclose(honest.tail_probability, stats.chi2.sf(float(honest.chi_square), 80), rtol=1e-6)


# Many runs, in one compiled function.

RUNS = 400


@pytest.fixture(scope="module")
def runs(run):
    recorded, pixel = tianshan.draw_runs(run.scene, RUNS, 11)
    noise = tianshan.frame_errors()

    def one(recorded, pixel):
        looks = wj.Looks(wj.Shot(time_s=run.time_s), pixel, (2.0, 2.0))
        sensor = tianshan.sensor(recorded)
        paper = wj.locate(sensor, looks, guess=run.guess, method="extended")
        return paper, wj.locate(sensor, looks, guess=run.guess, errors=noise)

    return recorded, pixel, jax.jit(jax.vmap(one))(recorded, pixel)


def nees_of(found, target_m):
    error = np.einsum("rji,rj->ri", found.world_from_enu, np.asarray(found.line_m) - target_m)
    return np.einsum("ri,ri->r", error, np.linalg.solve(found.looks.covariance_enu_m2[:, -1], error[..., None])[..., 0])


def test_the_covariance_of_the_iterated_filter_with_full_r_is_honest(run, runs):
    """scenarios.md: NEES in [2.65, 3.45]."""
    _, _, (_, full) = runs
    assert (np.asarray(full.result == wj.RESULTS.successful)).all()
    assert 2.65 < nees_of(full, run.target_m).mean() < 3.45


def test_nis_is_chi_square_of_two_freedoms(runs):
    _, _, (_, full) = runs
    nis = np.asarray(full.looks.nis)[:, 5:]  # the guess is the paper's, not drawn from the prior: the first looks see that
    assert stats.kstest(nis.ravel(), stats.chi2(2).cdf).pvalue > 1e-3
    assert stats.kstest(nis.sum(axis=1), stats.chi2(70).cdf).pvalue > 1e-3
    # Innovations of one run are white: one look says nothing of the next.
    lag = np.corrcoef(nis[:, 1:].ravel(), nis[:, :-1].ravel())[0, 1]
    assert abs(lag) < 4 / np.sqrt(nis[:, 1:].size)


def test_the_paper_s_filter_is_inconsistent_in_every_run_and_the_other_in_none_but_by_chance(run, runs):
    _, _, (paper, full) = runs
    assert nees_of(paper, run.target_m).mean() > 100
    unlikely = stats.chi2.sf(np.asarray(paper.chi_square), 80)
    assert (unlikely < 1e-4).all()
    assert (stats.chi2.sf(np.asarray(full.chi_square), 80) < 1e-4).mean() < 0.01


def test_jit_and_vmap_are_the_loop(run, runs):
    recorded, pixel, batched = runs
    for i in range(3):
        options = {"guess": run.guess, "throw": False}
        sensor = tianshan.sensor(jax.tree.map(lambda a, i=i: a[i], recorded))
        looks = run.looks_at(pixel[i])
        loop = (
            wj.locate(sensor, looks, method="extended", **options),
            wj.locate(sensor, looks, errors=tianshan.frame_errors(), **options),
        )
        for got, expected in zip(jax.tree.leaves(jax.tree.map(lambda a, i=i: a[i], batched)), jax.tree.leaves(loop), strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)


def test_numbers_of_the_camera_are_suspected(run):
    """A principal point 400 px aside, 9 sigma: it is named, though reasons are told in numpy; nothing of the camera was asked."""
    links = dict(zip(run.sensor.names, run.sensor.links, strict=True))
    off = wj.Sensor(links, wj.FrameCamera(run.sensor.camera.focal_px, (400.0, 0.0)))
    found = run.locate(sensor=off, errors=tianshan.frame_errors(), throw=False)
    names = found.evidence.suspects.names
    assert "camera.principal_point_px[0]" in names and "camera.focal_px" in names
    (reason,) = [one for one in found.reasons if one.kind == "a number taken as known"]
    assert "camera.principal_point_px[0]" in reason.figures["numbers"]
