"""A target on a surface whose height is known so well: from one place, where looks alone give a line."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from tests.locate.conftest import Run
from tests.locate.textbooks import EXACT, TABLE_1, differentiated, enu, noise_of
from whiskjax.flights import tianshan

LOOKS, SIGMA_M = 12, 8.0
FAR = (2000.0, 2000.0, 2000.0)


@pytest.fixture(scope="module")
def hovering():
    """All looks from one place, 45 degrees off nadir, with the errors of Table 1."""
    scene = tianshan.Scene("orbit", looks=LOOKS, spacing_m=0.0)
    recorded, pixel = tianshan.draw(jax.random.key(1), scene)
    return Run(scene, recorded, np.asarray(pixel))


def located(run, *, method="batch", **options):
    surface = wj.HeightSurface(tianshan.TARGET.height_m)
    return wj.locate(
        run.sensor, run.looks, surface=surface, sigma_enu_m=FAR, errors=tianshan.frame_errors(), method=method, **options
    )


def by_hand(run):
    """Least squares of looks and one height, dense: the height over the ellipsoid by PROJ."""
    state, anchor = np.zeros(3), run.target_m

    def image(k, x, w):
        return run.chain.image(k, anchor + x, w)

    for _ in range(8):
        rows = [differentiated(lambda s, k=k: image(k, s, EXACT), state) for k in range(LOOKS)]
        residual = [run.pixel_px[k] - image(k, state, EXACT) for k in range(LOOKS)]
        weight = [np.linalg.inv(noise_of(image, k, state, 2.0, TABLE_1)) for k in range(LOOKS)]
        up, height = enu(anchor + state)[:, 2], oracles.geodetic(anchor + state)[2]
        normal = np.einsum("kan,kab,kbm->nm", rows, weight, rows) + np.outer(up, up) / SIGMA_M**2
        slope = np.einsum("kan,kab,kb->n", rows, weight, residual) + up * (tianshan.TARGET.height_m - height) / SIGMA_M**2
        state = state + np.linalg.solve(normal, slope)
    return anchor + state, np.linalg.inv(normal)


@pytest.mark.parametrize("method", ["iterated", "batch"])
def test_ray_and_height_give_a_point_and_its_covariance(hovering, method):
    found = located(hovering, method=method, surface_sigma_m=SIGMA_M)
    point, covariance = by_hand(hovering)
    axes, sigma = enu(point), np.sqrt(np.diag(enu(point).T @ covariance @ enu(point)))
    assert (np.abs(axes.T @ (np.asarray(found.point_m) - point)) < 0.02 * sigma).all()
    np.testing.assert_allclose(found.covariance_enu_m2, axes.T @ covariance @ axes, rtol=0, atol=2e-2 * sigma.max() ** 2)
    assert sigma[2] == pytest.approx(SIGMA_M, rel=0.05) and found.is_sound


def test_it_is_said_that_the_height_decides_the_distance(hovering, run):
    found = located(hovering, surface_sigma_m=SIGMA_M)
    (said,) = (one for one in found.reasons if one.kind == "height")
    assert said.grade == "caution" and said.figures["surface_sigma_m"] == SIGMA_M
    assert said.figures["distance_sigma_m"] < 20 < 1e3 < said.figures["sigma_m"]
    # Where looks from many places know it as well, it does not.
    found = located(run, surface_sigma_m=100.0)
    assert not any(one.kind == "height" for one in found.reasons)


def test_without_the_statement_there_is_a_line(hovering):
    recorded, pixel = tianshan.draw(jax.random.key(1), hovering.scene, errors=())
    hovering = Run(hovering.scene, recorded, np.asarray(pixel))
    with pytest.raises(wj.SensorError, match="The line: through"):
        located(hovering)


def test_of_many_draws_errors_are_as_the_covariance_says(hovering):
    """Records and heights drawn anew: NEES of the target."""
    runs, rng = 300, np.random.default_rng(2)
    recorded, pixel = tianshan.draw_runs(hovering.scene, runs, 4)
    height = tianshan.TARGET.height_m + SIGMA_M * rng.standard_normal(runs)

    def one(record, pixel, height):
        looks = wj.Looks(wj.Shot(time_s=hovering.time_s), pixel, (2.0, 2.0))
        found = wj.locate(
            tianshan.sensor(record), looks, surface=wj.HeightSurface(height), sigma_enu_m=FAR, surface_sigma_m=SIGMA_M,
            errors=tianshan.frame_errors(), throw=False,
        )  # fmt: skip
        return found.point_m, found.covariance_enu_m2, found.world_from_enu

    point, spread, axes = (np.asarray(part) for part in jax.jit(jax.vmap(one))(recorded, pixel, height))
    error = np.einsum("rji,rj->ri", axes, point - hovering.target_m)
    nees = wj.nees(error, spread)
    low, high = wj.nees_band(3, runs)
    assert low < nees.mean() < high


def test_a_slope_tilts_the_plane(hovering):
    """A plane of a hill, in the world's own axes: the target lies on it, beside the ray."""
    axes = enu(hovering.target_m)
    normal = axes @ np.array([0.3, -0.2, 1.0])
    hill = wj.Plane(hovering.target_m, normal)
    options = {"sigma_enu_m": FAR, "errors": tianshan.frame_errors(), "method": "batch"}
    found = wj.locate(hovering.sensor, hovering.looks, surface=hill, surface_sigma_m=0.1, **options)
    assert abs((np.asarray(found.point_m) - hovering.target_m) @ normal) / np.linalg.norm(normal) < 0.3


def test_a_first_look_without_a_pose_is_left_out():
    """The surface is met by the first look that has one."""
    flight = tianshan.simulate(2)
    looks, _ = flight.looks([0])
    time = np.array(looks.shot.time_s)
    time[0] -= 1e4  # long before the record
    looks = wj.Looks(wj.Shot(time_s=time), looks.pixel_px, (2.0, 2.0))
    guess = wj.Guess.around(np.asarray(flight.points.position_m)[0], (500.0, 500.0, 500.0))
    surface = wj.HeightSurface(tianshan.TARGET.height_m)
    given = {"guess": guess, "surface": surface, "errors": flight.errors, "surface_sigma_m": 10.0}
    answer = wj.locate(flight.sensor, looks, method="batch", throw=False, **given)
    assert answer.result == wj.RESULTS.successful and not bool(answer.looks.is_used[0]) and bool(answer.looks.is_used[1:].all())
