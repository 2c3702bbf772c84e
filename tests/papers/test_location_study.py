"""The study of Liu et al. (2019): statistics, bound and what refraction does, against numpy, PROJ and a textbook's chain."""

import math

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from tests.locate.textbooks import EXACT, MOTIONS, TABLE_1, Chain, assert_in_sigmas, differentiated, enu, kalman, noise_of
from whiskjax.flights import tianshan
from whiskjax.papers.figure import Figure
from whiskjax.papers.location.open_questions import in_time, refraction
from whiskjax.papers.location.study import (
    CONSTANT,
    FAR_M,
    WHITE_BESIDE_CONSTANT,
    Trial,
    bound,
    guess_sigma_enu_m,
    point_of,
    single_look,
    to_enu,
    trial,
)

LOOKS = 12
PLACES = [tianshan.TARGET, tianshan.FLIGHT_TARGET, tianshan.Place(-71.0, -3.0, 250.0)]


def scene_at(off_nadir_deg=45.0, path="orbit"):
    return tianshan.Scene(path, LOOKS, off_nadir_rad=np.radians(off_nadir_deg))


def ecef_of(place):
    return oracles.ecef(np.radians(place.lat_deg), np.radians(place.lon_deg), place.height_m)


def test_statistics_of_a_trial_are_those_of_a_loop():
    rng = np.random.default_rng(2)
    runs = 7
    track = rng.normal(0, 60, (runs, 4, 3))
    track[::3, -1] *= 4
    root = rng.normal(0, 20, (runs, 3, 3))
    covariance = root @ root.transpose(0, 2, 1) + 30 * np.eye(3)
    found = Trial(track, covariance, np.zeros(runs, dtype=int))
    space, level, squared = [], [], []
    for run in range(runs):
        east, north, up = track[run, -1]
        space.append(math.sqrt(east**2 + north**2 + up**2))
        level.append(math.sqrt(east**2 + north**2))
        squared.append(track[run, -1] @ np.linalg.inv(covariance[run]) @ track[run, -1])
    far = sum(d > 100 for d in space)
    assert 0 < far < runs and FAR_M == 100
    assert found.mean_m == pytest.approx(sum(space) / runs, rel=1e-12)
    assert found.rmse_m == pytest.approx(math.sqrt(sum(d**2 for d in space) / runs), rel=1e-12)
    assert found.cep50_m == pytest.approx(sorted(level)[runs // 2], rel=1e-12)
    assert found.nees == pytest.approx(sum(squared) / runs, rel=1e-9)
    assert found.far_share == far / runs


@pytest.mark.parametrize("place", PLACES, ids=lambda place: f"{place.lat_deg:g}")
def test_places_and_the_sigma_of_the_guess_are_those_of_proj(place):
    """Equation 19 is in degrees: PROJ moves the place by a thousandth of each, to either side."""
    np.testing.assert_allclose(point_of(place), ecef_of(place), rtol=0, atol=1e-6)
    np.testing.assert_allclose(to_enu(place), enu(ecef_of(place)), rtol=0, atol=1e-9)

    def moved(d_lat_deg, d_lon_deg):
        ends = [
            ecef_of(place._replace(lat_deg=place.lat_deg + s * d_lat_deg, lon_deg=place.lon_deg + s * d_lon_deg))
            for s in (0.5e-3, -0.5e-3)
        ]
        return 1e3 * np.linalg.norm(ends[0] - ends[1])

    north, east = moved(0.015, 0), moved(0, 0.015)
    # The equation's metres lie on the ellipsoid, PROJ's at the height of the place: 2.4e-4 at 1551 m.
    radius = 1 + place.height_m / 6.38e6
    np.testing.assert_allclose(guess_sigma_enu_m(place) * [radius, radius, 1], np.array([east, north, 1500.0]), rtol=1e-5)


def least_covariance(scene, white, constant):
    """Covariance of target (east, north, up): prior and looks, constant motions beside the target, dense, by complex steps."""
    chain, target = Chain(tianshan.true_records(scene)), ecef_of(scene.target)
    axes = enu(target)
    sigma = [guess_sigma_enu_m(scene.target), np.zeros(0) if constant is None else constant]
    total = np.diag(np.concatenate(sigma) ** -2.0)
    for k in range(scene.looks):
        by_target = differentiated(lambda x, k=k: chain.image(k, x), target) @ axes
        by_motion = differentiated(lambda w, k=k: chain.image(k, target, w), np.zeros(MOTIONS))
        rows = by_target if constant is None else np.hstack([by_target, by_motion])
        total += rows.T @ np.linalg.inv(4 * np.eye(2) + by_motion @ np.diag(white**2) @ by_motion.T) @ rows
    return np.linalg.inv(total)[:3, :3]


TENTH = np.array([*np.radians([0.03, 0.03, 0.08]), 1.0, 1.0, 2.0, *np.radians([0.01, 0.01])])


@pytest.mark.parametrize("with_constant", [False, True], ids=["white", "constant"])
def test_the_bound_is_the_inverse_of_the_information(with_constant):
    scene = scene_at(path="race")
    if with_constant:
        got = bound(scene, WHITE_BESIDE_CONSTANT, CONSTANT)
        expected = least_covariance(scene, TABLE_1 * [0, 0, 0, 1, 1, 1, 0, 0], TENTH)
    else:
        got, expected = bound(scene), least_covariance(scene, TABLE_1, None)
        assert np.linalg.eigvalsh(bound(scene, prior=False) - got).min() > 0, "the prior helps in every direction"
    assert_in_sigmas(got, expected, expected, 1e-7)


def test_a_trial_of_the_printed_filter_is_the_textbook_s():
    """Started at the paper's first guess; R is that of the pixel alone."""
    scene, runs, seed = scene_at(), 2, 6
    found = trial(scene, runs, seed, guess=tianshan.FIRST_GUESS)
    recorded, pixel = tianshan.draw_runs(scene, runs, seed)
    anchor, target = ecef_of(tianshan.FIRST_GUESS), ecef_of(scene.target)
    axes = enu(anchor)
    prior = axes @ np.diag(guess_sigma_enu_m(scene.target) ** 2) @ axes.T
    for run in range(runs):
        chain = Chain(jax.tree.map(lambda a, run=run: a[run], recorded))
        expected = kalman(lambda k, x, w, c=chain: c.image(k, anchor + x, w), np.asarray(pixel[run]), np.zeros(3), prior)
        error = (anchor + expected.state - target) @ enu(target)
        np.testing.assert_allclose(found.track_enu_m[run], error, rtol=0, atol=1e-4)
    assert (found.code == 0).all()


def test_one_look_spreads_as_first_order_propagation_says():
    """The pixel and the height of the ground point are given: [d pixel / d x; up] dx = [noise; height error]."""
    scene, runs, height_sigma_m = scene_at(), 4000, 30.0
    chain, target = Chain(tianshan.true_records(scene)), ecef_of(scene.target)
    axes = enu(target)
    rows = np.vstack([differentiated(lambda x: chain.image(0, x), target) @ axes, [0, 0, 1]])
    given = np.zeros((3, 3))
    given[:2, :2] = noise_of(lambda k, x, w: chain.image(k, x, w), 0, target, 2.0, TABLE_1)
    given[2, 2] = height_sigma_m**2
    expected = np.linalg.inv(rows) @ given @ np.linalg.inv(rows).T
    error = single_look(scene, runs, 8, height_sigma_m)
    # A correlation or a relative variance over n runs has a sigma of at most sqrt(2 / n).
    assert_in_sigmas(np.cov(error.T), expected, expected, 4 * np.sqrt(2 / runs))
    assert (np.abs(error.mean(axis=0)) < 4 * np.sqrt(np.diag(expected) / runs) + 0.1).all()


# ../shared/scenarios.md: off-nadir angle in degrees, ground shift of one look, height bias after 40 looks of a straight path.
REFRACTION = [(45.0, 1.1, 1.4), (68.2, 9.9, 4.3), (74.3, 27.0, 7.9), (78.0, 62.0, 13.3)]


@pytest.mark.parametrize("off_nadir_deg, shift_m, straight_m", REFRACTION)
def test_refraction_lifts_the_target_by_the_ground_shift_over_the_tangent(off_nadir_deg, shift_m, straight_m):
    """On an orbit everything turns about the vertical of the target, so the apparent rays meet on it.

    The apparent ray of a look is straight and reaches the height of the target a ground shift d beyond it. There it is at the
    off-nadir angle z of the platform plus the central angle between the two (0.1 deg at 45, 0.4 deg at 78 deg). Above the target,
    d before that, it is d / tan(z) high: this is where all rays meet, and what the looks together find. On a straight path the
    rays of a wider angle off nadir meet higher.
    """
    off_nadir_rad = np.radians(off_nadir_deg)
    bent, straight = (refraction(tianshan.Scene(path, off_nadir_rad=off_nadir_rad)) for path in ("orbit", "fly"))
    np.testing.assert_allclose([bent.ground_shift_m, straight.height_bias_m], [shift_m, straight_m], rtol=0.1)
    assert straight.height_bias_m > bent.height_bias_m
    if off_nadir_deg == 45:
        np.testing.assert_allclose(bent.height_bias_m, bent.ground_shift_m / np.tan(off_nadir_rad), rtol=0.01)
    radius = np.sqrt(np.prod(tianshan.curvature_radii(np.radians(tianshan.TARGET.lat_deg))))
    at_target = np.arcsin((radius + 10_000) / (radius + 1551) * np.sin(off_nadir_rad))
    np.testing.assert_allclose(bent.height_bias_m, bent.ground_shift_m / np.tan(at_target), rtol=0.01)


@pytest.mark.parametrize("late_s", [0.0, 0.04])
def test_records_in_time_image_as_the_looks_do(late_s):
    """Where POS is stamped late, a delay by as much sets it right."""
    scene = scene_at(path="race")
    recorded, _ = tianshan.draw_runs(scene, 1, 3)
    recorded = jax.tree.map(lambda a: np.asarray(a[0]), recorded)
    shot = wj.Shot(time_s=tianshan.time_s(scene))
    points = np.tile(ecef_of(scene.target), (LOOKS, 1))
    chain = Chain(recorded)
    expected = [chain.image(k, points[k], EXACT) for k in range(LOOKS)]
    of = in_time(recorded, tianshan.time_s(scene), late_s)
    unknown = wj.Unknown("delay", "body.delay_s", 0.0, 0.05)
    # 1e-9 m of an ECEF coordinate are 1e-8 px.
    np.testing.assert_allclose(
        wj.project(wj.assign(of, [unknown], np.array([late_s])), shot, points).pixel_px, expected, rtol=0, atol=1e-6
    )
    if late_s:
        off = np.abs(
            np.asarray(wj.project(of, wj.Shot(time_s=tianshan.time_s(scene)[1:]), points[1:]).pixel_px) - expected[1:]
        ).max()
        # 167 m/s at 12 km are 1400 px a second.
        assert 20 < off < 120


@pytest.mark.parametrize(
    "low, high, reached, has_band, is_inside",
    [
        (1.0, 2.0, 1.5, True, True),
        (1.0, 2.0, 1.0, True, True),
        (1.0, 2.0, 2.0, True, True),
        (1.0, 2.0, 0.9, True, False),
        (1.0, 2.0, 2.1, True, False),
        (None, 2.0, -9.0, True, True),
        (None, 0.0, 0.1, True, False),
        (0.0, None, 9.0, True, True),
        (0.0, None, -0.1, True, False),
        (1.0, 2.0, math.nan, True, False),
        (None, 2.0, math.nan, True, False),
        (None, None, 1e9, False, True),
    ],
)
def test_a_figure_lies_in_its_band(low, high, reached, has_band, is_inside):
    figure = Figure("Figure 6", "mean error", "m", "", low, high, reached)
    assert figure.has_band == has_band and figure.is_inside == is_inside
