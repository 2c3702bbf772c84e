"""WGS-84 both ways against PROJ, poles and date line included."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import BATCH, latitudes, longitudes, numbers
from whiskjax.earth.ellipsoid import ecef_from_geodetic, geodetic_from_ecef, height_and_up

LOW_M, HIGH_M = -5000.0, 4e7
EPS = np.finfo(float).eps
PLACES = np.radians(
    [[90, 0], [-90, 0], [90, 123], [0, 180], [0, -180], [45, 180], [-45, -180], [0, 0], [30, 123], [-50, -70], [89.9999999, 77]]
)


@pytest.fixture(scope="module")
def forward():
    return jax.jit(wj.geodetic_to_ecef)


@pytest.fixture(scope="module")
def back():
    return jax.jit(wj.ecef_to_geodetic)


def rounding_m(point):
    """A few ulp of the distance from the centre of the Earth: 4e-9 m on the ground."""
    return 3 * EPS * np.linalg.norm(point, axis=-1)


def assert_geodetic(got, lat, lon, height, allowed_m):
    """Latitude, longitude and height agree to so many metres on the ground."""
    radius = 6.4e6 + height
    assert (np.abs(got[0] - lat) * radius <= allowed_m).all(), "latitude"
    turn = np.abs(np.exp(1j * np.asarray(got[1])) - np.exp(1j * lon))  # -180 and +180 deg are one longitude
    assert (turn * np.cos(lat) * radius <= allowed_m).all(), "longitude"
    assert (np.abs(got[2] - height) <= allowed_m).all(), "height"


@given(latitudes(), longitudes(), numbers(LOW_M, HIGH_M))
def test_geodetic_to_ecef_agrees_with_proj(forward, lat, lon, height):
    expected = oracles.ecef(lat, lon, height)
    assert (np.linalg.norm(forward(lat, lon, height) - expected, axis=-1) <= rounding_m(expected)).all()


@given(latitudes(), longitudes(), numbers(LOW_M, HIGH_M))
def test_ecef_to_geodetic_inverts_proj(back, lat, lon, height):
    # PROJ's forward formula is closed and exact; its inverse is iterated and good to less.
    point = oracles.ecef(lat, lon, height)
    assert_geodetic(back(point), lat, lon, height, rounding_m(point))


@given(numbers(-1, 1, (BATCH, 3)), numbers(np.log10(6.3e6), np.log10(5e7)))
def test_round_trip_from_any_point_of_space(forward, back, direction, log_radius):
    length = np.linalg.norm(direction, axis=-1, keepdims=True)
    point = np.where(length > 1e-3, direction / np.where(length > 1e-3, length, 1), [0.0, 0.0, 1.0]) * 10 ** log_radius[:, None]
    lat, lon, height = back(point)
    assert (np.abs(lat) <= np.pi / 2).all() and (np.abs(lon) <= np.pi).all()
    assert (np.linalg.norm(forward(lat, lon, height) - point, axis=-1) <= rounding_m(point)).all()


@pytest.mark.parametrize("lat, lon", PLACES)
@pytest.mark.parametrize("height", [LOW_M, 0.0, 9000.0, HIGH_M])
def test_poles_and_date_line(forward, back, lat, lon, height):
    point = oracles.ecef(lat, lon, height)
    np.testing.assert_allclose(forward(lat, lon, height), point, rtol=0, atol=rounding_m(point))
    assert_geodetic(back(point), lat, lon, height, rounding_m(point))


@pytest.mark.parametrize("z", [6356752.314245179 + 100.0, -6356752.314245179 - 100.0])
def test_exactly_at_a_pole(z):
    lat, lon, height = wj.ecef_to_geodetic([0.0, 0.0, z])
    assert lat == np.copysign(np.pi / 2, z)
    assert np.isfinite(lon)
    np.testing.assert_allclose(height, 100.0, rtol=0, atol=2e-9)


def test_a_latitude_is_found_deep_inside_the_earth():
    # The docstring: good from 5000 km below the surface.
    lat, lon = np.radians([[-89.0, -45.0, 0.0, 30.0, 60.0, 90.0], [0.0, 170.0, -170.0, 1.0, 2.0, 3.0]])
    point = oracles.ecef(lat, lon, -5e6)
    assert_geodetic(wj.ecef_to_geodetic(point), lat, lon, np.full(6, -5e6), 2e-9)


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_batches_agree_with_a_loop(shape):
    rng = np.random.default_rng(4)
    lat, lon, height = rng.uniform(-1.5, 1.5, shape), rng.uniform(-3, 3, shape), rng.uniform(0, 1e4, shape)
    points = wj.geodetic_to_ecef(lat, lon, height)
    assert points.shape == (*shape, 3)
    found = wj.ecef_to_geodetic(points)
    assert [v.shape for v in found] == [shape] * 3
    for i in np.ndindex(shape):
        np.testing.assert_allclose(points[i], wj.geodetic_to_ecef(lat[i], lon[i], height[i]), rtol=1e-15)
        *angles, up = wj.ecef_to_geodetic(points[i])
        np.testing.assert_allclose([v[i] for v in found[:2]], angles, rtol=1e-14)
        np.testing.assert_allclose(found[2][i], up, rtol=0, atol=2e-9)  # two units in the last place of the Earth's radius


def test_a_height_for_one_place_broadcasts():
    points = wj.geodetic_to_ecef(0.5, 1.0, [0.0, 100.0])
    np.testing.assert_allclose(points, oracles.ecef(0.5, 1.0, [0.0, 100.0]), rtol=0, atol=2e-9)


def test_derivatives_of_geodetic_to_ecef():
    x = [[lat, lon, h] for lat, lon in PLACES[:-1] for h in (0.0, 4e5)]
    # 1e-3 rad and 100 m; metres out. Rounding of the four values is 4e-9 m, the fifth order of the sine 1e-9 m.
    assert_derivatives(lambda v: ecef_from_geodetic(*v), x, step=[1e-3, 1e-3, 100.0], tolerance=3e-8)


def test_derivatives_of_ecef_to_geodetic():
    places = np.radians([[0, 0], [0, 179.99999], [45, -120], [-60, 30], [89, 10], [-89, 100]])
    x = [oracles.ecef(lat, lon, h) for lat, lon in places for h in (-4000.0, 0.0, 4e5, 3e7)]
    # Steps of 30 m: radians and metres out, rounding 1e-15 rad (64 times as much for the longitude at 89 deg) and 4e-9 m.
    # Only two of the places lie on the date line side where a step could cross it.
    x = [p for p in x if not (p[0] < 0 and abs(p[1]) < 100)]
    assert_derivatives(lambda p: geodetic_from_ecef(*p), x, step=30.0, tolerance=[4e-15, 6e-14, 3e-8])


def test_derivative_of_the_longitude_across_the_date_line():
    gradient = jax.grad(lambda p: geodetic_from_ecef(*p)[1])
    west, east = (np.asarray(gradient(oracles.ecef(0.3, lon, 0.0))) for lon in (-np.pi, np.pi))
    np.testing.assert_allclose(west, east, rtol=0, atol=1e-20)
    # One metre to the east is 1 / (N cos(lat)) rad, and there the east is -y.
    circle = np.hypot(*oracles.ecef(0.3, 0.0, 0.0)[:2])
    np.testing.assert_allclose(west, [0, -1 / circle, 0], rtol=0, atol=1e-20)


def test_derivatives_of_height_and_up():
    places = [oracles.ecef(lat, lon, h) for lat, lon in PLACES for h in (-4000.0, 0.0, 3e7)]
    # A pole is a point like any other, and so is what lies a nanometre or a metre beside it.
    poles = [[aside, 0.5 * aside, sign * 6357000.0] for aside in (0.0, 1e-9, 1e-3, 1.0) for sign in (1, -1)]
    # Over 100 m the normal turns by 1.6e-5 rad.
    assert_derivatives(lambda p: height_and_up(*p), places + poles, step=100.0, tolerance=[5e-8, 1e-14, 1e-14, 1e-14])


def test_second_and_third_derivatives_of_the_height():
    x = [oracles.ecef(lat, lon, 300.0) for lat, lon in PLACES]
    # The gradient turns by 1.6e-5 rad over 100 m, and the derivative of that is the curvature.
    assert_derivatives(jax.grad(lambda p: height_and_up(*p)[0]), x, step=100.0, tolerance=1e-14)
    # The curvature (1.6e-7 rad a metre) changes by 0.5 % over 30 km. The third derivative loses digits within a metre of a pole.
    x = [p for p in x if np.hypot(p[0], p[1]) > 1]
    assert_derivatives(jax.jacfwd(lambda p: jnp.stack(height_and_up(*p))[1:]), x, step=3e4, tolerance=2e-14)


@given(latitudes(), longitudes(), numbers(LOW_M, HIGH_M))
def test_up_is_the_normal_of_the_ellipsoid(lat, lon, height):
    found, *up = height_and_up(*oracles.split(oracles.ecef(lat, lon, height)))
    normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
    np.testing.assert_allclose(oracles.array(up), normal, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found, height, rtol=0, atol=3 * EPS * 5e7)


def test_derivatives_at_a_pole_are_finite():
    for f in (jax.jacfwd, jax.jacrev):
        value = f(lambda p: jnp.stack(geodetic_from_ecef(*p)))(jnp.array([0.0, 0.0, 6.4e6]))
        assert np.isfinite(value).all()
        np.testing.assert_allclose(value[2], [0, 0, 1], rtol=0, atol=1e-15)
