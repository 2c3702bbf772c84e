"""Rays that meet a surface: the point is judged by PROJ and by the ray itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import BATCH, latitudes, longitudes, numbers
from whiskjax.rules.results import is_successful

R = wj.RESULTS
PROJ_M = 3e-6  # how well PROJ's inverse finds a height: beside a pole it takes a short cut
MILLIMETRE_M = 1e-3


@pytest.fixture(scope="module")
def meet():
    @jax.jit
    def meet(origin, direction, height):
        point, result = wj.HeightSurface(height).intersect(tuple(origin.T), tuple(direction.T))
        return jnp.stack(point, axis=-1), result

    return meet


def look(lat, lon, height, off_nadir, azimuth):
    """Origin and unit direction of a look, this far off the vertical towards this azimuth from north."""
    s, c = np.sin(off_nadir), np.cos(off_nadir)
    ned = oracles.array([s * np.cos(azimuth), s * np.sin(azimuth), c])
    return oracles.ecef(lat, lon, height), oracles.ecef_from_ned(lat, lon).apply(ned)


def horizon(above_m):
    """Angle between the nadir and the horizon, from the smaller radius of the Earth: safely before the true one."""
    return np.arcsin(6.33e6 / (6.33e6 + above_m))


def assert_on_surface(point, origin, direction, height):
    away = point - origin
    distance = np.sum(away * direction, axis=-1)
    rounding = 4e-9 + 4e-16 * distance
    assert (np.abs(oracles.geodetic(point)[2] - height) <= PROJ_M).all()
    # Rounding along an inclined ray becomes height by its sine: less, never more.
    assert (np.abs(oracles.exact_height(point) - height) <= rounding).all()
    assert (np.linalg.norm(np.cross(away, direction), axis=-1) <= rounding).all()
    assert (distance > 0).all()


@given(
    latitudes(), longitudes(), numbers(-400, 9000), numbers(1, 6), numbers(0, 0.999), numbers(-np.pi, np.pi)
)  # heights above ground from 10 m to 1000 km
def test_the_point_has_the_height_lies_on_the_ray_and_is_the_near_one(meet, lat, lon, ground, log_above, share, azimuth):
    above = 10**log_above
    off_nadir = share * horizon(above)
    origin, direction = look(lat, lon, ground + above, off_nadir, azimuth)
    point, result = meet(origin, direction, ground)
    assert is_successful(result).all()
    point = np.asarray(point)
    assert_on_surface(point, origin, direction, ground)
    # Nowhere before does the ray touch the surface.
    shares = np.linspace(0, 0.999, 30)[:, None, None]
    heights = oracles.geodetic(origin + shares * (point - origin))[2]
    assert (heights > ground).all()


@pytest.mark.parametrize("off_nadir_deg", [0, 30, 60, 78, 80, 85, 87.9])
def test_looks_far_off_nadir(meet, off_nadir_deg):
    lat, azimuth = np.radians(np.linspace(-90, 90, BATCH)), np.linspace(-3, 3, BATCH)
    origin, direction = look(lat, np.full(BATCH, 1.3), 3010.0, np.radians(off_nadir_deg), azimuth)
    point, result = meet(origin, direction, np.full(BATCH, 10.0))
    assert is_successful(result).all()
    assert_on_surface(np.asarray(point), origin, direction, 10.0)


@given(latitudes(), longitudes(), numbers(-np.pi, np.pi), st.floats(1e-9, 1e-3))
def test_at_the_horizon_a_point_is_right_or_refused(meet, lat, lon, azimuth, beside_rad):
    """Where the lengthened ellipsoid and the true surface disagree about a hit, no wrong point may pass as a success."""
    ground, above = np.full(BATCH, 8000.0), 10000.0
    origin, _ = look(lat, lon, ground + above, 0.0, azimuth)
    # The tangent angle at this place and azimuth, by bisection on the least height along the ray.
    low, high = np.full(BATCH, np.radians(85.0)), np.full(BATCH, np.radians(90.0))
    distances = np.linspace(3.2e5, 4.0e5, 400)[:, None, None]
    for _ in range(40):
        middle = (low + high) / 2
        _, direction = look(lat, lon, ground + above, middle, azimuth)
        hits = oracles.geodetic(origin + distances * direction)[2].min(axis=0) < ground
        low, high = np.where(hits, middle, low), np.where(hits, high, middle)
    offsets = np.linspace(-beside_rad, beside_rad, BATCH)
    _, direction = look(lat, lon, ground + above, low + offsets, azimuth)
    point, result = meet(origin, direction, ground)
    fine = np.asarray(is_successful(result))
    height = oracles.geodetic(np.asarray(point)[fine])[2]
    assert (np.abs(height - ground[fine]) < MILLIMETRE_M).all()


MISSES = {
    "upward": (1000.0, 100.0),
    "level": (1000.0, 90.0),
    "beyond the horizon": (1000.0, 89.5),
    "from below": (-50.0, 0.0),
    "from below, upward": (-50.0, 180.0),
}


@pytest.fixture(scope="module")
def miss():
    """Result of one ray, and the derivatives in both modes of what a masked batch keeps of it."""

    def meet(x):
        point, result = wj.HeightSurface(x[6]).intersect(tuple(x[:3]), tuple(x[3:6]))
        return jnp.where(result == R.successful, jnp.stack(point), 0.0), result

    def both(x):
        return meet(x)[1], jax.jacfwd(lambda x: meet(x)[0])(x), jax.jacrev(lambda x: meet(x)[0])(x)

    return jax.jit(both)


@pytest.mark.parametrize("case", MISSES)
def test_misses_are_flagged_with_finite_gradients(miss, case):
    above, off_nadir_deg = MISSES[case]
    origin, direction = look(0.6, -1.0, above, np.radians(off_nadir_deg), 0.4)
    result, forward, reverse = miss(np.array([*origin, *direction, 0.0]))
    assert bool(result == R.ray_misses_ground)
    # NaN times a zero cotangent would poison the good rays of a batch.
    assert np.isfinite(forward).all() and np.isfinite(reverse).all()


def test_the_true_surface_is_not_the_lengthened_ellipsoid():
    """Repaired equation (10) of Liu et al. (2019): 0.010 m on the ground at 78 deg off nadir; two orders above the tolerance."""
    origin, direction = look(np.radians(43.3), np.radians(84.2), 10000.0, np.radians(78), np.radians(-44))
    height = 1551.0
    scaled = np.array([6378137.0 + height] * 2 + [6356752.314245179 + height])
    p, v = origin / scaled, direction / scaled
    a, b, c = v @ v, p @ v, p @ p - 1
    lengthened = origin + (-b - np.sqrt(b * b - a * c)) / a * direction
    point, _ = wj.HeightSurface(height).intersect(tuple(origin), tuple(direction))
    difference = np.linalg.norm(np.asarray(point) - lengthened)
    assert 0.001 < difference < 0.1
    assert_on_surface(np.asarray(point), origin, direction, height)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e4])
def test_the_length_of_the_direction_does_not_matter(length):
    origin, direction = look(-0.4, 2.0, 5000.0, 0.9, 1.0)
    unit, _ = wj.HeightSurface(100.0).intersect(tuple(origin), tuple(direction))
    other, result = wj.HeightSurface(100.0).intersect(tuple(origin), tuple(direction * length))
    assert bool(is_successful(result))
    np.testing.assert_allclose(np.asarray(other), np.asarray(unit), rtol=0, atol=4e-9)


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_one_height_a_ray_agrees_with_a_loop(shape):
    rng = np.random.default_rng(6)
    lat, lon, height = rng.uniform(-1.5, 1.5, shape), rng.uniform(-3, 3, shape), rng.uniform(0, 2000, shape)
    origin, direction = look(lat, lon, 5000.0, rng.uniform(0, 1.4, shape), rng.uniform(-3, 3, shape))
    point, result = wj.HeightSurface(height).intersect(oracles.split(origin), oracles.split(direction))
    point = oracles.array(point)
    assert is_successful(result).shape == shape
    for i in np.ndindex(shape):
        one, _ = wj.HeightSurface(height[i]).intersect(tuple(origin[i]), tuple(direction[i]))
        np.testing.assert_allclose(point[i], np.asarray(one), rtol=0, atol=4e-9)


def test_derivatives_of_a_height_surface():
    looks = [(0.6, -1.0, 0.0), (1.5, 2.0, 1.2), (-np.pi / 2, 0.0, 0.5), (0.0, np.pi, 1.4)]
    x = [np.concatenate([*look(lat, lon, 3000.0, off, 0.4), [200.0]]) for lat, lon, off in looks]

    def f(x):
        return wj.HeightSurface(x[6]).intersect(tuple(x[:3]), tuple(x[3:6]))[0]

    # Steps of 10 m and 1e-4; the point moves by up to 350 m at 80 deg, rounding 2e-8 m there.
    assert_derivatives(f, x, step=[10.0] * 3 + [1e-4] * 3 + [10.0], tolerance=1e-5)
    # Without the grazing look the difference quotient is good to rounding.
    assert_derivatives(f, x[:3], step=[10.0] * 3 + [1e-4] * 3 + [10.0], tolerance=1e-7)


NORMAL = np.array([0.2, -0.1, 2.0])


@pytest.fixture(scope="module")
def meet_plane():
    plane = wj.Plane(np.array([1.0, 2.0, 3.0]), NORMAL)
    return jax.jit(lambda origin, direction: plane.intersect(tuple(origin.T), tuple(direction.T)))


@given(numbers(-100, 100, (BATCH, 3)), numbers(-1, 1, (BATCH, 3)))
def test_a_plane_agrees_with_the_formula(meet_plane, origin, direction):
    rise, climb = ([1.0, 2.0, 3.0] - origin) @ NORMAL, direction @ NORMAL
    clear = (np.abs(rise) > 1e-6) & (np.abs(climb) > 1e-6)  # else rounding decides whether the plane is met
    point, result = meet_plane(origin, direction)
    ahead = rise * climb > 0
    np.testing.assert_array_equal(is_successful(result)[clear], ahead[clear])
    keep = clear & ahead
    steps = (rise[keep] / climb[keep])[:, None]
    # Rounding of the climb grows with the distance to the point.
    error = np.abs(oracles.array(point)[keep] - (origin[keep] + steps * direction[keep]))
    assert (error <= 1e-13 + 1e-9 * steps).all()


@pytest.mark.parametrize("direction", [(1.0, 2.0, 0.0), (0.0, 0.0, 1.0)], ids=["parallel", "away"])
def test_a_plane_that_is_missed_is_flagged_with_finite_gradients(direction):
    def f(x):
        point, result = wj.Plane(jnp.zeros(3), jnp.array([0.0, 0.0, 1.0])).intersect(tuple(x[:3]), tuple(x[3:]))
        return jnp.where(result == R.successful, jnp.stack(point), 0.0), result

    x = jnp.array([1.0, 1.0, 5.0, *direction])
    assert bool(f(x)[1] == R.ray_misses_ground)
    for derivative in (jax.jacfwd, jax.jacrev):
        assert np.isfinite(jax.jit(derivative(lambda x: f(x)[0]))(x)).all()


def test_derivatives_of_a_plane():
    def f(x):
        return wj.Plane(x[6:9], x[9:]).intersect(tuple(x[:3]), tuple(x[3:6]))[0]

    x = np.array([1.0, -2.0, 100.0, 0.1, 0.2, -1.0, 0.5, 0.25, 3.0, *NORMAL])
    assert_derivatives(f, x, step=[1.0] * 3 + [1e-3] * 3 + [1.0] * 3 + [1e-3] * 3, tolerance=1e-8)


@given(latitudes(), longitudes(), numbers(-400, 9000))
def test_level_is_east_north_and_up_of_proj(lat, lon, height):
    axes = oracles.matrix(wj.HeightSurface(0.0).level(oracles.split(oracles.ecef(lat, lon, height))))
    inside = np.abs(lat) < np.pi / 2 - 1e-6  # at a pole east is what the longitude says, and a point has none
    north, east, down = np.moveaxis(oracles.ecef_from_ned(lat, lon).as_matrix(), -1, 0)
    # PROJ's point is good to 2e-9 m, which turns the horizontal axes beside a pole.
    atol = 1e-15 + 3e-9 / (6.3e6 * np.cos(lat[inside]))[:, None, None] + 4e-15
    error = np.abs(axes - np.stack([east, north, -down], axis=-1))[inside]
    assert (error <= atol).all()
    np.testing.assert_allclose(np.swapaxes(axes, 1, 2) @ axes, np.broadcast_to(np.eye(3), axes.shape), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(axes), 1, rtol=0, atol=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_level_of_a_plane_is_its_normal_upwards_and_the_y_axis_laid_into_it(sign):
    axes = oracles.matrix(wj.Plane(np.zeros(3), sign * NORMAL).level((1.0, 2.0, 3.0)))
    up = NORMAL / np.linalg.norm(NORMAL)
    north = np.array([0.0, 1, 0]) - up[1] * up
    north = north / np.linalg.norm(north)
    np.testing.assert_allclose(axes, np.stack([np.cross(north, up), north, up], axis=-1), rtol=0, atol=1e-15)
    flat = oracles.matrix(wj.Plane(np.zeros(3), np.array([0.0, 0.0, 5.0])).level((0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(flat, np.eye(3))


def test_derivatives_of_level():
    def axes(point):
        return jnp.concatenate([jnp.stack(row) for row in wj.HeightSurface(0.0).level(tuple(point))])

    point = np.array([oracles.ecef(lat, lon, 500.0) for lat, lon in ((0.7, 1.2), (-1.3, 3.0), (0.0, -2.0))])
    assert_derivatives(axes, point, step=1e3, tolerance=1e-11)
