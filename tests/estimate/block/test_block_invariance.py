"""What must not change an adjustment: the order of rays and points, the tiles, empty seats, who is called what."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from whiskjax.estimate.block import plan as tiling
from whiskjax.estimate.block import prepare as preparing
from whiskjax.estimate.block.solve import reduce
from whiskjax.estimate.block.station_errors import at_stations
from whiskjax.flights import songshan

UNKNOWNS, ERRORS = songshan.unknowns(SCENE), songshan.frame_errors(SCENE)


def adjust(drawn, block, unknowns=UNKNOWNS, errors=ERRORS):
    return wj.adjust(drawn.sensor, block, unknowns, errors=errors, retime=False)


def assert_same(found, expected, point: Any = slice(None), ray: Any = slice(None)):
    """Both solutions within a millionth of their sigma; rounding ends the iterations at different places."""
    assert found.cost == pytest.approx(expected.cost, rel=1e-10)
    np.testing.assert_allclose((found.value - expected.value) / expected.trust.sigma, 0, atol=1e-6)
    sigma = np.sqrt(np.diagonal(expected.covariance_m2, axis1=1, axis2=2))
    np.testing.assert_allclose(((found.point_m[point] - expected.point_m) / sigma), 0, atol=1e-6)
    np.testing.assert_allclose(found.residual_px[ray], expected.residual_px, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.trust.sigma, expected.trust.sigma, rtol=1e-6)
    np.testing.assert_allclose(found.covariance_m2[point], expected.covariance_m2, rtol=0, atol=1e-6 * sigma.max() ** 2)


def test_order_of_rays_and_points(drawn, adjusted):
    rng, block = np.random.default_rng(3), drawn.block
    rays, points = rng.permutation(len(block)), rng.permutation(len(block.role))
    place = np.argsort(points)  # where each of the old points is now
    shuffled = dataclasses.replace(
        block.keep(rays),
        point=place[block.point[rays]],
        position_m=block.position_m[points],
        covariance_m2=block.covariance_m2[points],
        role=block.role[points],
        points=[block.points[i] for i in points],
    )
    assert_same(adjust(drawn, shuffled), adjusted, point=place, ray=np.argsort(rays))


def test_all_sigmas_doubled(drawn, adjusted):
    """Nothing moves, covariances grow fourfold, the cost falls to a quarter."""
    block = dataclasses.replace(drawn.block, sigma_px=2 * drawn.block.sigma_px, covariance_m2=4 * drawn.block.covariance_m2)
    unknowns = [dataclasses.replace(x, sigma=2 * x.size) for x in UNKNOWNS]
    found = adjust(drawn, block, unknowns, songshan.frame_errors(SCENE, scale=2.0))
    assert 4 * found.cost == pytest.approx(adjusted.cost, rel=1e-9)
    assert found.freedom == adjusted.freedom
    np.testing.assert_allclose((found.value - adjusted.value) / adjusted.trust.sigma, 0, atol=1e-5)
    np.testing.assert_allclose(found.trust.covariance, 4 * adjusted.trust.covariance, rtol=1e-5, atol=0)
    np.testing.assert_allclose(found.trust.stations, 2 * adjusted.trust.stations, rtol=1e-6)
    np.testing.assert_allclose(found.trust.data_share, adjusted.trust.data_share, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.point_m, adjusted.point_m, rtol=0, atol=1e-6)
    largest = np.abs(adjusted.covariance_m2).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found.covariance_m2 / largest, 4 * adjusted.covariance_m2 / largest, rtol=0, atol=1e-5)


def test_control_of_no_weight_is_a_check_point(drawn, adjusted):
    """Check points are control points that nobody trusts, and coordinates of check points play no part."""
    block = drawn.block
    check = block.role == "check"
    role = np.where(check, "control", block.role)
    covariance = np.where(check[:, None, None], np.eye(3) * 1e6**2, block.covariance_m2)
    moved = block.position_m + np.where(check[:, None], [0.3, -0.2, 0.5], 0.0)
    found = adjust(drawn, dataclasses.replace(block, role=role, covariance_m2=covariance, position_m=moved))
    assert_same(found, adjusted)
    assert found.freedom == adjusted.freedom + 3 * check.sum()  # coordinates are observations now


@pytest.fixture(scope="module")
def reduced(drawn):
    """A function that reduces the block at the start of the adjustment, as it is tiled at the moment."""

    def of(block=drawn.block):
        motions = at_stations("adjust", ERRORS, drawn.sensor)
        ready = preparing.prepare(drawn.sensor, block, UNKNOWNS, motions, drawn.point_m)
        equations, points = reduce(ready.ready, ready.start)
        return ready, equations, ready.by_point(np.stack([np.asarray(c) for c in points], axis=-1))

    return of


@pytest.mark.parametrize(
    "constants, padding",
    [({"_RAYS_AT_ONCE": 300, "_TILE_POINTS": (16,)}, 3), ({"_TILE_POINTS": (64,), "_MOST_SLACK": 16}, 0)],
    ids=["small tiles", "large tiles"],
)
def test_tiles_and_empty_seats(reduced, monkeypatch, constants, padding):
    """However the points are cut into tiles and chunks, the reduced equations are the same."""
    ready, expected, points = reduced()
    for name, value in constants.items():
        monkeypatch.setattr(tiling, name, value)
    monkeypatch.setattr(preparing, "rounded", lambda n: n + padding)
    other, found, moved = reduced()
    assert other.plan.ray.shape != ready.plan.ray.shape
    assert other.ready.tiles.chunks.units.shape[0] == len(other.plan.units) + padding
    assert float(found.cost) == pytest.approx(float(expected.cost), rel=1e-12)
    size = np.sqrt(np.diag(expected.matrix))
    np.testing.assert_allclose((found.matrix - expected.matrix) / np.outer(size, size), 0, atol=1e-10)
    np.testing.assert_allclose((found.right - expected.right) / size, 0, atol=1e-8 * np.abs(expected.right / size).max())
    np.testing.assert_allclose(moved, points, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(found.matrix, found.matrix.T)
