"""Local frames against scipy's rotations and against PROJ's differences."""

import numpy as np
import pytest
from hypothesis import given

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import latitudes, longitudes
from whiskjax.earth.frames import ecef_from_enu, ecef_from_ned


@given(latitudes(), longitudes())
def test_ned_agrees_with_two_turns_of_scipy(lat, lon):
    np.testing.assert_allclose(wj.ned_rotation(lat, lon), oracles.ecef_from_ned(lat, lon).as_matrix(), rtol=0, atol=1e-15)


@given(latitudes(), longitudes())
def test_enu_is_ned_with_its_axes_exchanged(lat, lon):
    ned, enu = wj.ned_rotation(lat, lon), wj.enu_rotation(lat, lon)
    np.testing.assert_array_equal(enu, np.stack([ned[..., 1], ned[..., 0], -ned[..., 2]], axis=-1))


@pytest.mark.parametrize("lat, lon", np.radians([[0, 0], [43.3, 84.2], [-33, 180], [89, -10]]))
def test_columns_point_north_east_and_up(lat, lon):
    step = 1e-6
    north = oracles.ecef(lat + step, lon, 0.0) - oracles.ecef(lat - step, lon, 0.0)
    east = oracles.ecef(lat, lon + step, 0.0) - oracles.ecef(lat, lon - step, 0.0)
    up = oracles.ecef(lat, lon, 10.0) - oracles.ecef(lat, lon, -10.0)
    expected = np.stack([v / np.linalg.norm(v) for v in (east, north, up)], axis=-1)
    # Chords of 12 m (0.2 m in longitude at 89 deg) of coordinates that are rounded to 1e-9 m.
    np.testing.assert_allclose(wj.enu_rotation(lat, lon), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("rotation", [wj.ned_rotation, wj.enu_rotation])
@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_batches_agree_with_a_loop(rotation, shape):
    rng = np.random.default_rng(5)
    lat, lon = rng.uniform(-1.5, 1.5, shape), rng.uniform(-3, 3, shape)
    got = rotation(lat, lon)
    assert got.shape == (*shape, 3, 3)
    for i in np.ndindex(shape):
        np.testing.assert_allclose(got[i], rotation(lat[i], lon[i]), rtol=0, atol=1e-16)


@pytest.mark.parametrize("rotation", [wj.ned_rotation, wj.enu_rotation])
def test_latitude_and_longitude_broadcast(rotation):
    lon = np.array([0.1, 0.2, 0.3])
    got = rotation(0.5, lon)
    np.testing.assert_allclose(got, rotation(np.full(3, 0.5), lon), rtol=0, atol=1e-16)
    np.testing.assert_allclose(rotation(lon, 0.5), rotation(lon, np.full(3, 0.5)), rtol=0, atol=1e-16)


@pytest.mark.parametrize("frame", [ecef_from_ned, ecef_from_enu])
def test_derivatives(frame):
    places = np.radians([[90, 0], [-90, 30], [0, 180], [45, -100]])
    # One of the nine entries is the structural zero.
    assert_derivatives(
        lambda v: [c for row in frame(*v) for c in row if not isinstance(c, int)], places, step=1e-2, tolerance=1e-11
    )
