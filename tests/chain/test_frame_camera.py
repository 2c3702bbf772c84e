"""The frame camera against the published Brown-Conrady formula."""

import jax
import numpy as np
import pytest
from hypothesis import given
from scipy.optimize import brentq

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import numbers
from whiskjax.rules.results import is_successful

R = wj.RESULTS
FOCAL_PX, CENTRE_PX = 4000.0, np.array([2000.3, 1499.6])
BROWN = np.array([-0.12, 0.05, -0.01, 1e-3, -5e-4])  # k1, k2, k3, p1, p2
PLAIN = wj.FrameCamera(FOCAL_PX, CENTRE_PX)
LENS = wj.FrameCamera(FOCAL_PX, CENTRE_PX, BROWN)
PIXEL = 1e-9  # rounding of a pixel coordinate, px


def opencv(q, focal, centre, brown):
    """cv2.projectPoints as its documentation prints it; the camera there looks along +z with y down, here along -z with y up."""
    x, y = q[..., 0] / -q[..., 2], -q[..., 1] / -q[..., 2]
    k1, k2, k3, p1, p2 = brown
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    x2 = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    y2 = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([focal * x2, focal * y2], -1) + centre


def pixels(camera, q):
    return oracles.array(camera.pixel(oracles.split(q)))


directions = numbers(-0.7, 0.7, (8, 2)).map(lambda xy: 5.0 * np.concatenate([xy, -np.ones((8, 1))], -1))


@given(directions)
def test_pixels_follow_the_published_formula(q):
    np.testing.assert_allclose(pixels(PLAIN, q), opencv(q, FOCAL_PX, CENTRE_PX, np.zeros(5)), rtol=0, atol=PIXEL)
    np.testing.assert_allclose(pixels(LENS, q), opencv(q, FOCAL_PX, CENTRE_PX, BROWN), rtol=0, atol=PIXEL)


def test_four_coefficients_are_refused_and_the_remedy_is_right():
    """As OpenCV gives them, k1, k2, p1, p2: taken as k1, k2, k3, p1 they were metres off on the ground, without a word."""
    k1, k2, p1, p2 = -0.12, 0.05, 1e-3, -5e-4
    with pytest.raises(wj.WhiskjaxError, match=r"distortion has shape \(4,\).*k1, k2, k3, p1, p2.*\[k1, k2, 0, p1, p2\] here"):
        wj.FrameCamera(FOCAL_PX, CENTRE_PX, [k1, k2, p1, p2])
    q = np.array([[0.3, 0.2, -1.0], [-0.4, 0.1, -1.0]])
    found = pixels(wj.FrameCamera(FOCAL_PX, CENTRE_PX, [k1, k2, 0, p1, p2]), q)
    np.testing.assert_allclose(found, opencv(q, FOCAL_PX, CENTRE_PX, (k1, k2, 0.0, p1, p2)), rtol=0, atol=PIXEL)


def test_the_image_is_photogrammetric():
    """Image point (x, y, -f): column grows with x to the right, row grows against y, the camera looks along -z."""
    np.testing.assert_allclose(pixels(PLAIN, np.array([0.1, 0.0, -1.0])), CENTRE_PX + [400.0, 0.0], rtol=0, atol=PIXEL)
    np.testing.assert_allclose(pixels(PLAIN, np.array([0.0, 0.1, -1.0])), CENTRE_PX + [0.0, -400.0], rtol=0, atol=PIXEL)


@pytest.fixture(scope="module")
def there_and_back():
    return jax.jit(lambda camera, column, row: (camera.pixel(camera.direction((column, row))), camera.check_pixel((column, row))))


@given(numbers(0, 4000), numbers(0, 3000))
def test_distortion_is_undone(there_and_back, column, row):
    for camera in (PLAIN, LENS):
        again, result = there_and_back(camera, column, row)
        assert is_successful(result).all()
        np.testing.assert_allclose(again, [column, row], rtol=0, atol=1e-8)


@given(directions)
def test_directions_come_back(q):
    again = LENS.direction(LENS.pixel(oracles.split(q)))
    np.testing.assert_allclose(oracles.array(again), q / 5.0, rtol=0, atol=1e-12)


def test_the_inverse_agrees_with_bisection():
    k1, k2, k3 = -0.3, 0.1, 0.0
    camera = wj.FrameCamera(1.0, (0.0, 0.0), (k1, k2, k3, 0.0, 0.0))
    for r in (0.05, 0.3, 0.6):
        expected = brentq(lambda u, r=r: u * (1 + u * u * (k1 + u * u * k2)) - r, 0, 1, xtol=1e-15)
        np.testing.assert_allclose(camera.direction((r, 0.0))[0], expected, rtol=0, atol=1e-14)


def fold_of(k1, k2, k3):
    """The smallest radius where the distorted radius stops growing, by dense search."""
    r = np.linspace(0, 5, 500001)
    slope = 1 + 3 * k1 * r**2 + 5 * k2 * r**4 + 7 * k3 * r**6
    return r[np.argmax(slope <= 0)] if (slope <= 0).any() else np.inf


@pytest.mark.parametrize("k", [(-0.3, 0.0, 0.0), (-1.0, 0.4, 0.0), (0.2, -0.1, 0.0), (-0.7, 0.1, 0.02)])
def test_beyond_the_fold_nothing_is_imaged(k):
    """Beyond the first fold of the polynomial a point would share its pixel with a nearer one."""
    camera = wj.FrameCamera(1000.0, (0.0, 0.0), (*k, 0.0, 0.0))
    fold = fold_of(*k)
    r = np.concatenate([fold * np.array([0.1, 0.9, 0.999, 1.001, 1.1]), np.linspace(1.1, 3, 30) * fold])
    result = camera.check_direction((r, 0 * r, 0 * r - 1))
    np.testing.assert_array_equal(is_successful(result), r < fold)


def test_a_pixel_outside_the_fold_has_no_direction():
    k1 = -0.3
    camera = wj.FrameCamera(1000.0, (0.0, 0.0), (k1, 0.0, 0.0, 0.0, 0.0))
    fold = fold_of(k1, 0, 0)
    edge = 1000 * fold * (1 + k1 * fold**2)
    column = np.array([0.0, 0.5, 0.99, 1.01, 1.5]) * edge
    result = camera.check_pixel((column, 0 * column))
    np.testing.assert_array_equal(is_successful(result), [True, True, True, False, False])
    assert bool(camera.check_pixel((1.5 * edge, 0.0)) == R.distortion_not_invertible)


def test_what_lies_behind_is_flagged():
    for camera in (PLAIN, LENS):
        result = camera.check_direction((np.zeros(3), np.zeros(3), np.array([-1.0, 0.0, 1.0])))
        np.testing.assert_array_equal(is_successful(result), [True, False, False])
        assert bool(camera.check_direction((0.0, 0.0, 1.0)) == R.point_behind_camera)


ZOOM = wj.FrameCamera([1000.0, 1100.0, 1200.0], CENTRE_PX, per_image=True)


def test_a_zoom_lens_has_a_focal_length_for_each_image():
    q = oracles.split(np.array([[0.1, 0.2, -1.0]] * 3))
    column, row = ZOOM.at(wj.Shot(image=np.array([2, 0, 1]))).pixel(q)
    np.testing.assert_allclose(column - CENTRE_PX[0], [120.0, 100.0, 110.0], rtol=1e-12)
    np.testing.assert_allclose(row - CENTRE_PX[1], [-240.0, -200.0, -220.0], rtol=1e-12)
    one = ZOOM.at(wj.Shot(image=1)).pixel((0.1, 0.2, -1.0))
    np.testing.assert_allclose(one[0], column[2], rtol=1e-14)


def test_an_image_without_a_focal_length_is_flagged_and_a_missing_image_is_refused():
    result = ZOOM.check(wj.Shot(image=np.array([-1, 0, 2, 3])))
    np.testing.assert_array_equal(is_successful(result), [False, True, True, False])
    with pytest.raises(wj.WhiskjaxError, match=r"focal length differs per image.*Shot\(image=\.\.\.\)"):
        ZOOM.at(wj.Shot(time_s=1.0))


def test_the_frame_ends_half_a_pixel_beyond_the_outer_centres():
    camera = wj.FrameCamera(1000.0, (2.0, 2.0), size_px=(5, 4))
    column, row = np.array([-0.6, -0.5, 4.5, 4.6, 2.0, 2.0]), np.array([1.0, 1.0, 1.0, 1.0, 3.5, 3.6])
    np.testing.assert_array_equal(camera.sees((column, row)), [False, True, True, False, True, False])
    assert PLAIN.sees((1e9, 1e9)) is True


def test_a_frame_has_no_line_to_search():
    with pytest.raises(wj.WhiskjaxError, match="no line"):
        PLAIN.miss((0.0, 0.0, -1.0))


@pytest.mark.parametrize("focal", [0.0, -1000.0, [1000.0, -1.0], np.nan])
def test_a_focal_length_is_positive(focal):
    with pytest.raises(wj.WhiskjaxError, match=r"FrameCamera: focal_px .*(must be above 0|is not a finite number)"):
        wj.FrameCamera(focal, (0.0, 0.0), per_image=np.ndim(focal) > 0)


INNER = np.r_[FOCAL_PX, CENTRE_PX, BROWN]


def test_derivatives_of_pixels():
    def f(x):
        return wj.FrameCamera(x[0], x[1:3], x[3:8]).pixel(tuple(x[8:]))

    x = [np.r_[INNER, q] for q in ([0.3, -0.2, -1.0], [0.0, 0.0, -2.0], [-1.0, 1.2, -3.0])]
    assert_derivatives(f, x, step=[10.0, 1.0, 1.0] + [1e-3] * 5 + [1e-3] * 3, tolerance=1e-8)


def test_derivatives_of_directions_are_the_implicit_ones():
    def f(x):
        return wj.FrameCamera(x[0], x[1:3], x[3:8]).direction((x[8], x[9]))[:2]

    x = [np.r_[INNER, p] for p in ([100.0, 200.0], [2000.3, 1499.6], [3900.0, 2900.0])]
    assert_derivatives(f, x, step=[10.0, 1.0, 1.0] + [1e-3] * 5 + [10.0] * 2, tolerance=1e-11)
