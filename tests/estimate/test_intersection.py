"""Forward intersection against scipy's least squares and against Monte Carlo."""

import functools

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives

R = wj.RESULTS
MICROMETRE_M = 1e-6
IMAGES, FOCAL_PX = 6, 4000.0
RNG = np.random.default_rng(71)
ORIGIN = oracles.ecef(0.8, 0.3, 0.0)
TO_ECEF = oracles.ecef_from_ned(0.8, 0.3)


def world(ned_m):
    return ORIGIN + TO_ECEF.apply(ned_m)


# Six images from 1 km above, 200 m apart, all looking down: camera z up.
CENTRES = world(np.stack([200.0 * np.arange(IMAGES) - 500, RNG.normal(0, 60, IMAGES), np.full(IMAGES, -1000.0)], -1))
DOWN = Rotation.from_matrix(np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]))  # camera x east, y north, z up, in NED
ATTITUDES = TO_ECEF * Rotation.from_rotvec(RNG.normal(0, 0.05, (IMAGES, 3))) * DOWN
SENSOR = wj.Sensor({"body": wj.PosePerImage(CENTRES, ATTITUDES.as_quat())}, wj.FrameCamera(FOCAL_PX, (0.0, 0.0)))

POINTS = world(RNG.uniform([-300, -200, -30], [300, 200, 30], (5, 3)))
LOOKS = [(0, 1), (0, 1, 2, 3, 4, 5), (2, 3, 4), (1, 5), (0, 2, 4, 5)]
POINT = np.concatenate([np.full(len(images), p) for p, images in enumerate(LOOKS)])
IMAGE = np.concatenate(LOOKS)
ORDER = RNG.permutation(len(POINT))  # rays in any order
POINT, IMAGE = POINT[ORDER], IMAGE[ORDER]
SIGMA_PX = RNG.uniform(0.3, 2.0, (len(POINT), 2))


def collinearity(point, image):
    q = ATTITUDES[image].inv().apply(point - CENTRES[image])
    return np.stack([-FOCAL_PX * q[..., 0] / q[..., 2], FOCAL_PX * q[..., 1] / q[..., 2]], -1)


EXACT_PX = collinearity(POINTS[POINT], IMAGE)
NOISY_PX = EXACT_PX + RNG.normal(size=EXACT_PX.shape) * SIGMA_PX


def intersect(pixel, point=POINT, image=IMAGE, sigma=SIGMA_PX, **options):
    return wj.intersect(SENSOR, wj.Shot(image=image), pixel, point, sigma, **options)


def by_scipy(pixel, p):
    """Point and covariance of one point."""
    here = p == POINT

    def residuals(x):
        return ((pixel[here] - collinearity(x * 1e3 + POINTS[p], IMAGE[here])) / SIGMA_PX[here]).ravel()

    solution = least_squares(residuals, np.zeros(3), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    jacobian = solution.jac / 1e3
    return POINTS[p] + 1e3 * solution.x, np.linalg.inv(jacobian.T @ jacobian)


def test_exact_rays_meet_in_their_point():
    found = intersect(EXACT_PX)
    np.testing.assert_allclose(found.point_m, POINTS, rtol=0, atol=MICROMETRE_M)
    np.testing.assert_allclose(found.residual_px, 0, rtol=0, atol=1e-6)


def test_noisy_rays_meet_where_scipy_says_with_the_covariance_of_the_normal_equations():
    found = intersect(NOISY_PX)
    for p in range(len(LOOKS)):
        point, covariance = by_scipy(NOISY_PX, p)
        np.testing.assert_allclose(found.point_m[p], point, rtol=0, atol=3 * MICROMETRE_M)
        # Relative to its largest entry; scipy's own derivative is a difference quotient.
        np.testing.assert_allclose(found.covariance_m2[p], covariance, rtol=0, atol=1e-6 * np.abs(covariance).max())
    np.testing.assert_allclose(
        found.residual_px, NOISY_PX - collinearity(np.asarray(found.point_m)[POINT], IMAGE), rtol=0, atol=1e-6
    )


def test_the_covariance_is_the_scatter_of_many_draws():
    draws = 4000
    noise = np.random.default_rng(73).normal(size=(draws, *EXACT_PX.shape)) * SIGMA_PX
    many = jax.jit(lambda pixels: jax.lax.map(lambda p: intersect(p, throw=False), pixels, batch_size=100))
    found = many(EXACT_PX + noise)
    assert np.asarray(found.result == R.successful).all()
    error = np.asarray(found.point_m) - POINTS
    for p in range(len(LOOKS)):
        inverse = np.linalg.inv(intersect(EXACT_PX).covariance_m2[p])
        nees = np.einsum("ni,ij,nj->n", error[:, p], inverse, error[:, p])
        # The mean of chi-square with 3 degrees of freedom over 4000 draws: 3 +- 0.039; five standard deviations.
        assert abs(nees.mean() - 3) < 0.2


def test_the_order_of_the_rays_does_not_matter():
    shuffled = np.random.default_rng(75).permutation(len(POINT))
    again = intersect(NOISY_PX[shuffled], POINT[shuffled], IMAGE[shuffled], SIGMA_PX[shuffled])
    found = intersect(NOISY_PX)
    np.testing.assert_allclose(again.point_m, found.point_m, rtol=0, atol=1e-8)
    np.testing.assert_allclose(again.residual_px, np.asarray(found.residual_px)[shuffled], rtol=0, atol=1e-6)


def test_one_sigma_for_all_scales_the_covariance():
    one, two = (intersect(EXACT_PX, sigma=s).covariance_m2 for s in (1.0, 2.0))
    np.testing.assert_allclose(two, 4 * np.asarray(one), rtol=1e-9)


# Points that cannot be determined. Point 1 stays good in all of them.


def with_bad_first_point(pixels, images):
    """A first point seen by these pixels, a second by all six images."""
    good = np.arange(IMAGES)
    pixel = np.concatenate([pixels, collinearity(POINTS[1], good)])
    return pixel, np.r_[np.zeros(len(images), int), np.ones(IMAGES, int)], np.r_[images, good]


def assert_first_is(result, pixels, images):
    pixel, point, image = with_bad_first_point(np.asarray(pixels), np.asarray(images))
    found = intersect(pixel, point, image, 1.0, throw=False)
    np.testing.assert_array_equal(np.asarray(found.result == result), [True, False])
    assert bool((found.result == R.successful)[1])
    assert np.isnan(found.point_m[0]).all() and np.isnan(found.covariance_m2[0]).all()
    np.testing.assert_allclose(found.point_m[1], POINTS[1], rtol=0, atol=MICROMETRE_M)
    first = point == 0
    assert np.isnan(np.asarray(found.residual_px)[first]).all() and np.isfinite(np.asarray(found.residual_px)[~first]).all()
    with pytest.raises(wj.SensorError, match=r"1 of 2 .*index \(0,\)"):
        intersect(pixel, point, image, 1.0)


def test_one_ray_does_not_determine_a_point():
    assert_first_is(R.rank_deficient, [[10.0, 20.0]], [0])


def test_the_same_ray_twice_does_not_determine_a_point():
    assert_first_is(R.rank_deficient, [[10.0, 20.0]] * 3, [2, 2, 2])


def test_parallel_rays_do_not_determine_a_point():
    down = TO_ECEF.apply([0.1, -0.2, 1.0])
    pixels = [collinearity(CENTRES[i] + 1e3 * down, i) for i in (0, 3, 5)]
    assert_first_is(R.rank_deficient, pixels, [0, 3, 5])


def test_rays_that_meet_behind_the_cameras_are_refused():
    up = world(np.array([[0.0, 0.0, -2000.0]]))[0]
    assert_first_is(R.point_behind_camera, [collinearity(up, i) for i in (0, 2, 5)], [0, 2, 5])


def test_an_unknown_image_is_flagged():
    assert_first_is(R.unknown_key, [[0.0, 0.0], [1.0, 1.0]], [0, IMAGES])


def test_no_number_is_flagged():
    pixel, point, image = with_bad_first_point(np.array([[np.nan, 0.0], [1.0, 1.0]]), np.array([0, 1]))
    found = intersect(pixel, point, image, 1.0, throw=False)
    np.testing.assert_array_equal(np.asarray(found.result == R.successful), [False, True])
    assert np.isnan(found.point_m[0]).all()


@pytest.mark.parametrize(
    "pixel, point, message",
    [
        (np.zeros((3, 2)), np.array([0, 1]), r"point_index has shape \(2,\), expected \(rays,\) with rays = 3"),
        (np.zeros((2, 3)), np.array([0, 1]), r"pixel_px has shape \(2, 3\), expected \(rays, 2\)"),
        (np.zeros((2, 2)), np.array([0, 2]), "without holes"),
        (np.zeros((2, 2)), np.array([-1, 0]), "without holes"),
        (np.zeros((0, 2)), np.zeros(0, int), "no rays|at least one ray|without"),
    ],
)
def test_wrong_input_is_refused(pixel, point, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        intersect(pixel, point, np.zeros(len(point), int), 1.0)


def test_a_sigma_that_is_not_positive_is_refused():
    for sigma in (0.0, -1.0, np.nan):
        with pytest.raises(wj.WhiskjaxError, match="sigma"):
            intersect(EXACT_PX, sigma=sigma)


def test_derivatives_with_respect_to_the_pixels():
    rays = 4

    def f(x):
        found = intersect(x.reshape(rays, 2), np.zeros(rays, int), np.arange(rays), 1.0)
        return found.point_m

    # A pixel moves the point by up to a metre; ECEF is rounded to 1e-9 m and the least squares solved to 1e-8 m.
    assert_derivatives(f, collinearity(POINTS[1], np.arange(rays)).ravel() + 0.3, step=1.0, tolerance=1e-6)


# A line camera: the rays of one point come from different times.


@functools.cache
def line_sensor():
    time = np.linspace(0, 20, 41)
    track = world(np.stack([60 * time - 600, 0 * time, 0 * time - 1000], -1))
    attitude = TO_ECEF * Rotation.from_rotvec(np.outer(time, [0.001, 0.002, -0.003])) * DOWN
    cameras = {name: wj.LineCamera(5000.0, offset_px=o, along="x") for name, o in (("forward", 2000.0), ("backward", -1500.0))}
    return wj.Sensor({"body": wj.Trajectory(time, track, attitude.as_quat(), max_gap_s=1.0)}, wj.By("view", cameras))


def test_two_views_of_a_line_camera_meet():
    sensor, points = line_sensor(), world(np.array([[0.0, 50.0, -20.0], [40.0, -80.0, 5.0]]))
    times, samples = np.empty((2, 2)), np.empty((2, 2))
    for view in (0, 1):
        found = wj.ground_to_image(sensor, wj.Shot(view=view), points, (0.0, 20.0))
        times[view], samples[view] = found.time_s, found.pixel_px[:, 0]
    pixel = np.stack([samples.ravel(), np.zeros(4)], -1)
    found = wj.intersect(sensor, wj.Shot(time_s=times.ravel(), view=np.array([0, 0, 1, 1])), pixel, np.array([0, 1, 0, 1]))
    np.testing.assert_allclose(found.point_m, points, rtol=0, atol=1e-5)


@pytest.mark.parametrize("count", range(1, len(LOOKS)))
def test_points_do_not_depend_on_how_many_there_are(count):
    """Sizes are rounded up inside: none of what fills them is seen outside."""
    here = count > POINT
    some, everything = intersect(NOISY_PX[here], POINT[here], IMAGE[here], SIGMA_PX[here]), intersect(NOISY_PX)
    assert (some.point_m.shape, some.residual_px.shape) == ((count, 3), (here.sum(), 2))
    np.testing.assert_allclose(some.point_m, everything.point_m[:count], rtol=0, atol=1e-7)
    np.testing.assert_allclose(some.covariance_m2, everything.covariance_m2[:count], rtol=1e-9)
    np.testing.assert_allclose(some.residual_px, everything.residual_px[here], rtol=0, atol=1e-8)
