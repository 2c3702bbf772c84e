"""Line cameras and look tables."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import BATCH, numbers
from whiskjax.rules.results import is_successful

R = wj.RESULTS
PIXEL = 1e-8  # rounding of a pixel, px
DEFORMATION = np.array([[5.0, 9.0, 4.0, -2.0], [-3.0, 3.0, 2.0, 1.5]])
HALF = 4000.0


def camera(along="x", along_sign=1.0, across_sign=1.0, deformation=None, focal=9000.0, offset=3000.0):
    return wj.LineCamera(
        focal,
        principal_sample_px=4000.5,
        offset_px=offset,
        along_sign=along_sign,
        across_sign=across_sign,
        deformation_px=deformation,
        half_width_px=HALF,
        samples_px=(0.0, 8000.0),
        along=along,
    )


SIGNS = [(a, c) for a in (1.0, -1.0) for c in (1.0, -1.0)]
KINDS = [camera(along, *signs, deformation) for along in "xy" for signs in SIGNS for deformation in (None, DEFORMATION)]
IDS = [
    f"{c.along}{float(c.along_sign):+.0f}{float(c.across_sign):+.0f}{'' if c.deformation_px is None else ' deformed'}"
    for c in KINDS
]
by_kind = pytest.mark.parametrize("line", KINDS, ids=IDS)


def textbook_direction(line, sample, offset):
    """Image point (x, y, -f) of a (sample, line offset), from the docstring of LineCamera."""
    s = sample - 4000.5
    u = s / HALF
    d = np.zeros((2, 4)) if line.deformation_px is None else np.asarray(line.deformation_px)
    dx, dy = (sum(c * u**k for k, c in enumerate(row)) for row in d)
    along = float(line.along_sign) * (s + dx)
    across = float(line.across_sign) * offset + 3000.0 + dy
    x, y = (along, across) if line.along == "x" else (across, along)
    return np.stack([x, y, np.full_like(x, -9000.0)], -1)


@by_kind
@given(numbers(0, 8000), numbers(-50, 50))
def test_samples_lie_where_the_text_says(line, sample, offset):
    got = oracles.array(line.direction((sample, offset)))
    np.testing.assert_allclose(got, textbook_direction(line, sample, offset), rtol=0, atol=PIXEL)


@pytest.fixture(scope="module")
def imaged():
    return jax.jit(lambda line, q: line.pixel(tuple(q.T)))


@by_kind
@given(numbers(0, 8000), numbers(-50, 50), numbers(0.1, 1e4))
def test_a_pixel_comes_back_from_its_direction(imaged, line, sample, offset, length):
    """Deformations of ten pixels over 8000 are undone to rounding."""
    q = textbook_direction(line, sample, offset) * length[:, None]
    np.testing.assert_allclose(oracles.array(imaged(line, q)), np.stack([sample, offset], -1), rtol=0, atol=PIXEL)


def turned(q, axis, angle):
    """Directions turned about an axis of the camera by each of the angles."""
    return oracles.about(axis, angle).apply(q)


@by_kind
def test_the_miss_vanishes_on_the_line_and_has_the_sign_of_the_offset(line):
    sample = np.linspace(0, 8000, 9)
    on = oracles.split(textbook_direction(line, sample, 0 * sample))
    np.testing.assert_allclose(line.miss(on), 0, rtol=0, atol=1e-15)
    for offset in (-100.0, -1e-3, 1e-3, 100.0):
        q = oracles.split(textbook_direction(line, sample, 0 * sample + offset))
        np.testing.assert_array_equal(np.sign(line.miss(q)), np.sign(offset))
        # Tangent of half the angle: a pixel is half of 1/f, shortened by the distance from the principal point.
        angle = 2 * np.arctan(np.abs(line.miss(q)))
        assert (angle < 1.01 * abs(offset) / 9000).all() and (angle > 0.4 * abs(offset) / 9000).all()


@by_kind
def test_the_miss_is_monotone_while_the_camera_turns_over_the_point(line):
    """What the line search needs: over a swing of +-80 deg about the line, also where the point is far behind the focal plane."""
    for sample in (0.0, 2000.0, 4000.5, 8000.0):
        on = textbook_direction(line, np.array([sample]), np.zeros(1))[0]
        angle = np.radians(np.linspace(-80, 80, 321))
        miss = np.asarray(line.miss(oracles.split(turned(on, line.along, angle))))
        steps = np.diff(miss)
        assert np.isfinite(miss).all()
        assert (steps > 0).all() or (steps < 0).all()
        assert abs(miss[160]) < 1e-14


def test_the_detector_has_ends():
    sample = np.array([-0.6, -0.5, 8000.5, 8000.6])
    np.testing.assert_array_equal(camera().sees((sample, 0 * sample)), [False, True, True, False])
    assert wj.LineCamera(100.0).sees((1e9, 0.0)) is True


def test_what_lies_behind_is_flagged():
    result = camera().check_direction((np.zeros(3), np.zeros(3), np.array([-1.0, 0.0, 1.0])))
    np.testing.assert_array_equal(is_successful(result), [True, False, False])


@pytest.mark.parametrize(
    "arguments, message", [({"focal_px": -5.0}, "must be above 0"), ({"focal_px": 5.0, "along": "z"}, "along x or y, not 'z'")]
)
def test_a_wrong_line_camera_is_refused(arguments, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.LineCamera(**arguments)


def made(x, along="x"):
    return wj.LineCamera(x[0], x[1], x[2], -1.0, 1.0, deformation_px=x[3:11].reshape(2, 4), half_width_px=HALF, along=along)


INNER = np.r_[9000.0, 4000.5, 3000.0, DEFORMATION.ravel()]
STEP = [30.0, 1.0, 1.0] + [1.0] * 8


@pytest.mark.parametrize("along", "xy")
def test_derivatives_of_pixels_and_misses(along):
    x = [
        np.r_[INNER, q / 1000]
        for q in textbook_direction(camera(along, -1.0, 1.0, DEFORMATION), np.array([10.0, 5000.0]), np.array([3.0, -8.0]))
    ]
    assert_derivatives(lambda v: made(v, along).pixel(tuple(v[11:])), x, step=STEP + [0.01] * 3, tolerance=1e-6)
    assert_derivatives(lambda v: made(v, along).miss(tuple(v[11:])), x, step=STEP + [0.01] * 3, tolerance=1e-11)


def test_derivatives_of_directions():
    x = [np.r_[INNER, 10.0, 3.0], np.r_[INNER, 7000.0, 0.0]]
    assert_derivatives(lambda v: made(v).direction((v[11], v[12])), x, step=STEP + [10.0, 1.0], tolerance=1e-7)


# Look tables.

SAMPLE = np.array([0.0, 100.0, 250.0, 300.0, 480.0])
LOOK = np.stack([0.002 * (SAMPLE - 240), 0.05 + 1e-6 * (SAMPLE - 200) ** 2, -1.0 - 1e-4 * SAMPLE], -1)
TABLE = wj.LookTable(SAMPLE, LOOK * np.linspace(0.5, 3, 5)[:, None])


def segment_formula(sample):
    """Linear interpolation of the image points at focal length 1."""
    slope = LOOK[:, :2] / -LOOK[:, 2:]
    return np.stack(
        [np.interp(sample, SAMPLE, slope[:, 0]), np.interp(sample, SAMPLE, slope[:, 1]), np.full_like(sample, -1)], -1
    )


def test_looks_are_linear_between_samples():
    sample = np.linspace(0, 480, 97)
    got = oracles.array(TABLE.direction((sample, 0 * sample)))
    np.testing.assert_allclose(got, segment_formula(sample), rtol=0, atol=1e-14)
    again = TABLE.pixel(oracles.split(7 * segment_formula(sample)))
    np.testing.assert_allclose(oracles.array(again), np.stack([sample, 0 * sample], -1), rtol=0, atol=1e-9)


@given(numbers(5, 475), numbers(-0.5, 0.5))
def test_pixels_beside_the_line_come_back(sample, offset):
    # Away from the corners of the table, where the strips beside two segments overlap or part.
    keep = np.abs(sample[:, None] - SAMPLE).min(axis=1) > 4
    got = oracles.array(TABLE.pixel(TABLE.direction((sample, offset))))
    np.testing.assert_allclose(got[keep], np.stack([sample, offset], -1)[keep], rtol=0, atol=1e-9)


def test_the_miss_of_a_look_table_vanishes_on_it_and_has_the_sign_of_the_offset():
    sample = np.linspace(3, 477, 33)
    np.testing.assert_allclose(TABLE.miss(oracles.split(segment_formula(sample))), 0, rtol=0, atol=1e-15)
    for offset in (-3.0, -1e-3, 1e-3, 3.0):
        q = TABLE.direction((sample, 0 * sample + offset))
        np.testing.assert_array_equal(np.sign(TABLE.miss(q)), np.sign(offset))


def test_the_miss_of_a_look_table_is_monotone_while_the_camera_turns_over_the_point():
    for sample in (10.0, 240.0, 470.0):
        on = segment_formula(np.array([sample]))[0]
        angle = np.radians(np.linspace(-80, 80, 321))
        steps = np.diff(np.asarray(TABLE.miss(oracles.split(turned(on, "x", angle)))))
        assert (steps > 0).all() or (steps < 0).all()


def test_a_look_table_ends():
    np.testing.assert_array_equal(TABLE.sees((np.array([-0.6, 0.0, 480.5, 480.6]), np.zeros(4))), [False, True, True, False])
    assert bool(TABLE.check_direction((0.0, 0.0, 1.0)) == R.point_behind_camera)


@pytest.mark.parametrize(
    "sample, direction, message",
    [
        ([0.0], [[0, 0, -1.0]], "at least two samples"),
        (
            [0.0, 1.0],
            [[0, 0, -1.0]],
            r"direction has shape \(1, 3\), expected \(n, 3\): one direction for each sample with n = 2",
        ),
        ([0.0, 0.0], [[0, 0, -1.0], [1, 0, -1.0]], "must increase"),
        ([0.0, 1.0], [[0, 0, 1.0], [1, 0, 1.0]], "looks along -z"),
        ([0.0, 1.0], [[0, 0, np.nan], [1, 0, -1.0]], "looks along -z"),
        ([0.0, 1.0, 2.0], [[0, 0, -1.0], [2, 0, -1.0], [1, 0, -1.0]], "must advance"),
        ([0.0, 1.0], [[np.nan, 0, -1.0], [1, 0, -1.0]], "must advance"),
    ],
)
def test_a_wrong_look_table_is_refused(sample, direction, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.LookTable(sample, direction)


def test_derivatives_of_a_look_table():
    q = segment_formula(np.array([50.0, 200.0, 400.0])) + [0.0, 1e-3, 0.0]
    assert_derivatives(lambda v: TABLE.pixel(tuple(v)), q, step=1e-3, tolerance=1e-8)
    assert_derivatives(lambda v: TABLE.miss(tuple(v)), q, step=1e-3, tolerance=1e-12)
    assert_derivatives(lambda v: jnp.stack(TABLE.direction((v[0], v[1]))[:2]), [[50.0, 0.1], [400.0, 0.0]], 1.0, 1e-12)


def test_batches_agree_with_a_loop():
    q = textbook_direction(KINDS[1], np.linspace(0, 8000, BATCH), np.linspace(-5, 5, BATCH)).reshape(4, 2, 3)
    for line in (KINDS[1], KINDS[-1], TABLE):
        batch = oracles.array(line.pixel(oracles.split(q)))
        for i in np.ndindex(4, 2):
            np.testing.assert_allclose(batch[i], line.pixel(tuple(q[i])), rtol=0, atol=PIXEL)
