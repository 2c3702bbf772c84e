"""Mounts and axes."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.derivatives import assert_derivatives
from whiskjax.algebra.vectors import IDENTITY, ZERO

LEVER_M, ANGLES = np.array([0.1, -2.0, 30.0]), np.array([0.4, -0.9, 2.5])
POINT = np.array([5.0, -7.0, 11.0])
SHOT = wj.Shot()
ORDERS = ["".join(p) for p in itertools.permutations("xyz")]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_mount_turns_then_shifts(order, sign):
    """p_outer = R p_inner + sign lever, R = R_order[0] R_order[1] R_order[2]: scipy's intrinsic sequence."""
    pose = wj.Mount(LEVER_M, ANGLES, order=order, lever_sign=sign).pose(SHOT)
    expected = Rotation.from_euler(order.upper(), ANGLES).apply(POINT) + sign * LEVER_M
    np.testing.assert_allclose(np.array(pose.point(tuple(POINT))), expected, rtol=0, atol=1e-14)


def test_what_is_absent_is_structurally_zero():
    assert wj.Mount().pose(SHOT).rotation == IDENTITY
    assert wj.Mount().pose(SHOT).translation == ZERO
    assert wj.Mount(lever_arm_m=LEVER_M).pose(SHOT).rotation == IDENTITY
    assert wj.Mount(angles_rad=ANGLES).pose(SHOT).translation == ZERO


def test_derivatives():
    def f(x):
        return wj.Mount(x[:3], x[3:], order="zxy", lever_sign=-1).pose(SHOT).point(tuple(POINT))

    assert_derivatives(f, [np.zeros(6), np.r_[LEVER_M, ANGLES]], step=[1.0] * 3 + [1e-2] * 3, tolerance=1e-9)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"order": "xyy"}, "x, y and z once"),
        ({"lever_sign": 2}, r"\+1 or -1, not 2"),
        ({"lever_arm_m": [1.0, 2.0]}, r"shape \(2,\)"),
        ({"angles_rad": 0.1}, r"shape \(\)"),
    ],
)
def test_a_wrong_mount_is_refused(arguments, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Mount(**arguments)


def signed_permutations():
    for names in itertools.permutations("xyz"):
        for signs in itertools.product(["", "-"], repeat=3):
            matrix = np.zeros((3, 3))
            for inner, (name, sign) in enumerate(zip(names, signs, strict=True)):
                matrix["xyz".index(name), inner] = -1 if sign else 1
            yield " ".join(s + n for s, n in zip(signs, names, strict=True)), matrix


ALL = list(signed_permutations())


@pytest.mark.parametrize("text, matrix", [(t, m) for t, m in ALL if np.linalg.det(m) > 0])
def test_right_handed_axes_are_structural_rotations(text, matrix):
    pose = wj.Axes(text).pose(SHOT)
    assert all(type(c) is int for row in pose.rotation for c in row)
    np.testing.assert_array_equal(np.array(pose.rotation), matrix)
    # Inner x lies along the first named axis.
    np.testing.assert_array_equal(pose.direction((1, 0, 0)), matrix[:, 0])


@pytest.mark.parametrize("text", [t for t, m in ALL if np.linalg.det(m) < 0])
def test_left_handed_axes_are_refused(text):
    with pytest.raises(wj.WhiskjaxError, match="left-handed"):
        wj.Axes(text)


def test_there_are_24_rotations_among_the_48():
    assert sum(np.linalg.det(m) > 0 for _, m in ALL) == 24


def test_a_plus_sign_may_be_written():
    assert wj.Axes("+x -y -z").pose(SHOT).rotation == wj.Axes("x -y -z").pose(SHOT).rotation


@pytest.mark.parametrize("text", ["x y", "x y w", "x x z", "", "xyz", "x -y -z z", "--x y z", "+-x -y z"])
def test_axes_that_name_no_permutation_are_refused(text):
    with pytest.raises(wj.WhiskjaxError, match="three signed names"):
        wj.Axes(text)
