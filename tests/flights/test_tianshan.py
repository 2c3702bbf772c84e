"""The simulated target location against the scenario and an independent chain."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from tests.locate.textbooks import TABLE_1, Chain, noise_of
from whiskjax.flights import tianshan

PATHS = ["orbit", "race", "fly"]


def scene_of(path, **options):
    return tianshan.Scene(path, **options)


def target_of(scene):
    lat, lon, height = scene.target
    return oracles.ecef(np.radians(lat), np.radians(lon), height)


def in_body(scene):
    """Line of sight to the target in the body frame: forward, right, down."""
    true = tianshan.true_records(scene)
    chain = Chain(true)
    away = target_of(scene) - chain.platform
    return true, chain, np.einsum("kji,kj->ki", chain.ecef_from_body, away)


SCENES = [
    tianshan.Scene("orbit", 180),
    tianshan.Scene("race", 180),
    tianshan.Scene("fly"),
    tianshan.Scene("orbit", off_nadir_rad=np.radians(75.0)),
    tianshan.Scene("fly", off_nadir_rad=np.radians(78.0), height_m=9800.0, target=tianshan.FLIGHT_TARGET),
]


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: f"{s.path}-{s.looks}-{np.degrees(s.off_nadir_rad):.0f}")
def test_the_gimbal_points_at_the_target(scene):
    true, chain, body = in_body(scene)
    for k in range(scene.looks):
        # 1e-9 px are 1e-14 rad: 2e-10 m at the target, which ECEF in float64 does not hold; 1e-9 m are 1e-8 px.
        assert np.abs(chain.image(k, target_of(scene))).max() < 5e-8
    pixel = wj.project(tianshan.sensor(true), wj.Shot(time_s=tianshan.time_s(scene)), np.tile(target_of(scene), (scene.looks, 1)))
    assert np.abs(pixel.pixel_px).max() < 5e-8
    assert (body[:, 1] > 0).all(), "the target is on the right"
    assert (body[:, 2] > 0).all()


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: f"{s.path}-{s.looks}-{np.degrees(s.off_nadir_rad):.0f}")
def test_height_and_spacing(scene):
    chain = in_body(scene)[1]
    height = oracles.geodetic(chain.platform)[2]
    np.testing.assert_allclose(height, scene.height_m, rtol=0, atol=1e-6)
    steps = np.linalg.norm(np.diff(chain.platform, axis=0), axis=-1)
    # A sphere stands for the ellipsoid: its radii of curvature differ from the mean by 0.2 %.
    np.testing.assert_allclose(steps, 500.0, rtol=3e-3)
    np.testing.assert_allclose(tianshan.time_s(scene), 3.0 * np.arange(scene.looks))


def off_nadir_and_azimuth(scene):
    true = tianshan.true_records(scene)
    chain = Chain(true)
    ned = oracles.ecef_from_ned(np.asarray(true.lat_rad), np.asarray(true.lon_rad)).inv().apply(target_of(scene) - chain.platform)
    return np.degrees(np.arctan2(np.hypot(ned[:, 0], ned[:, 1]), ned[:, 2])), np.degrees(np.arctan2(ned[:, 1], ned[:, 0]))


@pytest.mark.parametrize("off_nadir_deg", [15, 45, 75])
def test_an_orbit_keeps_its_angle_off_nadir_and_starts_at_the_azimuth(off_nadir_deg):
    off, azimuth = off_nadir_and_azimuth(scene_of("orbit", off_nadir_rad=np.radians(off_nadir_deg)))
    np.testing.assert_allclose(off, off_nadir_deg, rtol=0, atol=0.1)
    assert azimuth[0] == pytest.approx(-44.0, abs=0.2)
    assert (np.diff(np.unwrap(np.radians(azimuth))) > 0).all(), "clockwise"


@pytest.mark.parametrize("path, broadside", [("race", [20]), ("fly", [19, 20])])
def test_a_straight_path_has_the_angles_at_broadside(path, broadside):
    off, azimuth = off_nadir_and_azimuth(scene_of(path))
    body = in_body(scene_of(path))[2]
    assert off.argmin() in broadside
    for k in broadside:
        assert off[k] == pytest.approx(45.0, abs=0.1)
        assert azimuth[k] == pytest.approx(-44.0, abs=2.0 if path == "fly" else 0.3)
        assert abs(body[k, 0]) < 260.0
    assert body[0, 0] > 5000 and body[-1, 0] < -5000, "from behind the target to beyond it"


def test_a_race_turns_back_after_20_km_onto_the_same_line():
    true, chain, _ = in_body(scene_of("race", looks=180))
    p = chain.platform
    np.testing.assert_allclose(np.linalg.norm(p[40] - p[0]), 20e3, rtol=3e-3)
    np.testing.assert_allclose(p[50], p[30], rtol=0, atol=1e-6)
    np.testing.assert_allclose(p[80], p[0], rtol=0, atol=1e-6)
    heading = np.asarray(true.heading_rad)
    np.testing.assert_array_equal(heading, heading[0])  # the target stays on the right


def test_errors_have_the_sigmas_of_table_1():
    scene, runs = scene_of("orbit"), 500
    recorded, pixel = tianshan.draw_runs(scene, runs, 3)
    true = tianshan.true_records(scene)
    n = runs * scene.looks
    platform = oracles.ecef(*(np.asarray(a) for a in (true.lat_rad, true.lon_rad, true.height_m)))
    moved = oracles.ecef(*(np.asarray(a) for a in (recorded.lat_rad, recorded.lon_rad, recorded.height_m)))
    ned = np.stack(
        [
            oracles.ecef_from_ned(np.asarray(true.lat_rad)[k], np.asarray(true.lon_rad)[k]).inv().apply(moved[:, k] - platform[k])
            for k in range(scene.looks)
        ]
    ).reshape(-1, 3)
    # A sigma of n draws is known to 1 / sqrt(2 n): 0.5 %; four of that.
    tolerance = 4 / np.sqrt(2 * n)
    np.testing.assert_allclose(ned.std(axis=0), [10.0, 10.0, 20.0], rtol=tolerance)
    for name, sigma_deg in {"heading": 0.08, "pitch": 0.03, "roll": 0.03, "gimbal_roll": 0.01, "gimbal_pitch": 0.01}.items():
        error = np.asarray(getattr(recorded, f"{name}_rad")) - np.asarray(getattr(true, f"{name}_rad"))
        np.testing.assert_allclose(np.degrees(error.std()), sigma_deg, rtol=tolerance)
        assert abs(error.mean()) < 4 * error.std() / np.sqrt(n)
        # White: the next look knows nothing of this one.
        assert abs(np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]) < 4 / np.sqrt(n)
    np.testing.assert_allclose(np.asarray(pixel).std(), 2.0, rtol=tolerance)


def test_constant_errors_are_the_same_at_all_looks_of_a_run():
    recorded, pixel = tianshan.draw_runs(scene_of("race"), 200, 4, tianshan.frame_errors(correlation_s=np.inf), 0.0)
    true = tianshan.true_records(scene_of("race"))
    error = np.asarray(recorded.heading_rad) - np.asarray(true.heading_rad)
    assert np.ptp(error, axis=1).max() < 1e-12
    np.testing.assert_allclose(np.degrees(error[:, 0].std()), 0.08, rtol=4 / np.sqrt(400))
    assert (np.asarray(pixel) == 0).all()


def test_the_noise_of_frames_is_that_of_table_1():
    """The covariance of pixels over draws, against the sum that the filter uses; 500 draws know a variance to 6 %."""
    scene = scene_of("orbit", looks=3)
    recorded, _ = tianshan.draw_runs(scene, 500, 9)
    pixel = np.array(
        [[Chain(jax.tree.map(lambda a, r=r: a[r], recorded)).image(k, target_of(scene)) for k in (0, 2)] for r in range(500)]
    )
    chain = Chain(tianshan.true_records(scene))
    for i, k in enumerate((0, 2)):
        expected = noise_of(lambda k, x, w: chain.image(k, x, w), k, target_of(scene), 1e-9, TABLE_1)
        got = np.cov(pixel[:, i].T)
        sigma = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            got / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), rtol=0, atol=4 * np.sqrt(2 / 500)
        )


def test_seeds_differ_and_repeat():
    a, b, c = (tianshan.draw_runs(scene_of("orbit", looks=4), 2, seed) for seed in (1, 1, 2))
    for x, y, z in zip(*(jax.tree.leaves(d) for d in (a, b, c)), strict=True):
        np.testing.assert_array_equal(x, y)
        assert np.abs(x - z).max() > 0
