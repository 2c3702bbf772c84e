"""Rotations and quaternions against scipy, for every attitude."""

import itertools

import jax
import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import attitudes, numbers
from whiskjax import WhiskjaxError
from whiskjax.algebra.vectors import ZERO
from whiskjax.chain.rotations import (
    angles_from_rotation,
    check_order,
    quaternion_from_vector,
    quaternion_product,
    rotation_from_angles,
    rotation_from_quaternion,
    rotation_from_vector,
)
from whiskjax.chain.samples import (
    matrices_from_quaternions,
    ned_from_body_matrices,
    quaternions_from_matrices,
    relative_turns,
    sign_continuous,
    unit_quaternions,
)

ORDERS = ["".join(p) for p in itertools.permutations("xyz")]
ROUNDING = {"rtol": 0, "atol": 4e-15}  # of the entries of a rotation matrix, or rad


def matrices(rows):
    """Components of a rotation (numbers among them) as an array."""
    return oracles.matrix(rows)


@pytest.mark.parametrize("order", ORDERS)
@given(angles=numbers(-7, 7, (8, 3)))
def test_angles_in_every_order_are_scipys_intrinsic_ones(order, angles):
    got = matrices(rotation_from_angles(oracles.split(angles), order))
    np.testing.assert_allclose(got, Rotation.from_euler(order.upper(), angles).as_matrix(), **ROUNDING)


@pytest.mark.parametrize("order", ORDERS)
@given(turn=attitudes())
def test_every_attitude_comes_back_from_its_angles(order, turn):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    angles = angles_from_rotation(tuple(tuple(rotation[:, i, j] for j in range(3)) for i in range(3)), order)
    assert (np.abs(np.asarray(angles[1])) <= np.pi / 2).all()
    again = Rotation.from_euler(order.upper(), oracles.array(angles))
    # Near +-90 deg of the middle angle its arc sine keeps half of the digits.
    assert (Rotation.from_matrix(rotation).inv() * again).magnitude().max() < 3e-8


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [np.pi / 2, -np.pi / 2])
def test_an_attitude_comes_back_from_its_angles_where_the_outer_axes_coincide(order, middle):
    rotation = Rotation.from_euler(order.upper(), [0.3, middle, -1.1])
    rows = tuple(tuple(float(c) for c in row) for row in rotation.as_matrix())
    again = Rotation.from_euler(order.upper(), [float(a) for a in angles_from_rotation(rows, order)])
    assert (rotation.inv() * again).magnitude() < 3e-8


@pytest.mark.parametrize("order", ["xy", "xyx", "XYZ", "abc", ""])
def test_an_order_names_every_axis_once(order):
    with pytest.raises(WhiskjaxError, match="each of x, y and z once"):
        check_order(order)


def rows(turn):
    return matrices(rotation_from_vector(oracles.split(turn)))


@given(attitudes())
def test_a_rotation_vector_is_scipys(turn):
    np.testing.assert_allclose(rows(turn), Rotation.from_rotvec(turn).as_matrix(), **ROUNDING)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 0.99e-4, 1.01e-4, 1.0])
def test_small_rotation_vectors_meet_their_safe_branch(size):
    # The branch changes at 1e-4 rad; on both sides it is exact.
    turn = size * np.array([0.6, -0.48, 0.64])
    exact = Rotation.from_rotvec(turn).as_quat()
    np.testing.assert_allclose(np.asarray(quaternion_from_vector(tuple(turn))), exact, rtol=1e-15, atol=1e-16)


def test_the_structural_zero_is_the_identity():
    np.testing.assert_array_equal(matrices(rotation_from_angles(ZERO, "zyx")), np.eye(3))


def test_derivatives_of_rotations():
    x = [[0.0, 0.0, 0.0], [1e-5, 0.0, 0.0], [7e-5, 7e-5, 1e-6], [0.3, -2.0, 1.0], [np.pi, 0.0, 0.0]]
    assert_derivatives(lambda v: [c for row in rotation_from_vector(v) for c in row], x, step=1e-2, tolerance=1e-10)
    assert_derivatives(
        lambda v: [c for row in rotation_from_angles(v, "zyx") for c in row if not isinstance(c, int)], x[1:], 1e-2, 1e-10
    )
    inside = [[0.1, 0.2, 0.3], [-2.0, 1.2, 3.0]]
    assert_derivatives(lambda v: angles_from_rotation(rotation_from_angles(v, "xyz"), "xyz"), inside, 1e-3, 1e-11)


def test_the_derivative_of_a_small_turn_is_the_cross_product():
    derivative = jax.jacfwd(lambda v: np.array(1.0) * jax.numpy.stack([c for row in rotation_from_vector(v) for c in row]))
    generators = np.asarray(derivative(jax.numpy.zeros(3))).reshape(3, 3, 3)
    for axis, e in enumerate(np.eye(3)):
        np.testing.assert_allclose(generators[:, :, axis], np.cross(e, np.eye(3)).T, rtol=0, atol=1e-16)


@given(attitudes(), attitudes())
def test_quaternion_products_are_scipys(a, b):
    p, q = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    product = oracles.array(quaternion_product(oracles.split(p.as_quat()), oracles.split(q.as_quat())))
    np.testing.assert_allclose(Rotation.from_quat(product).as_matrix(), (p * q).as_matrix(), **ROUNDING)


@given(attitudes())
def test_a_quaternion_and_its_negative_are_one_rotation(turn):
    q = Rotation.from_rotvec(turn).as_quat()
    expected = Rotation.from_rotvec(turn).as_matrix()
    for sign in (1, -1):
        np.testing.assert_allclose(matrices(rotation_from_quaternion(oracles.split(sign * q))), expected, **ROUNDING)


@given(attitudes())
def test_host_matrices_and_quaternions_are_scipys(turn):
    rotation = Rotation.from_rotvec(turn)
    q = quaternions_from_matrices(rotation.as_matrix())
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), rotation.as_matrix(), **ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, **ROUNDING)
    np.testing.assert_allclose(matrices_from_quaternions(rotation.as_quat()), rotation.as_matrix(), **ROUNDING)


@given(numbers(-np.pi, np.pi), numbers(-np.pi / 2, np.pi / 2), numbers(-np.pi, 2 * np.pi))
def test_roll_pitch_heading_are_scipys(roll, pitch, heading):
    expected = oracles.body_in_ned(roll, pitch, heading).as_matrix()
    np.testing.assert_allclose(ned_from_body_matrices(roll, pitch, heading), expected, **ROUNDING)


@given(attitudes(), numbers(-1, 1))
def test_sample_signs_become_continuous(turn, coin):
    q = Rotation.from_rotvec(turn).as_quat() * np.where(coin < 0, -1.0, 1.0)[:, None]
    made = sign_continuous(unit_quaternions(3 * q, "sample"))
    np.testing.assert_allclose(np.abs(np.sum(made * q, axis=-1)), 1, **ROUNDING)
    assert (np.sum(made[1:] * made[:-1], axis=-1) >= -1e-15).all()


@given(attitudes())
def test_relative_turns_lead_from_each_sample_to_the_next(turn):
    rotation = Rotation.from_rotvec(turn)
    step = relative_turns(sign_continuous(unit_quaternions(rotation.as_quat(), "sample")))
    # A half turn has two shortest ways; sign continuity decides, and both arrive.
    assert (np.linalg.norm(step, axis=-1) <= np.pi + 1e-12).all()
    again = rotation[:-1] * Rotation.from_rotvec(step)
    assert (rotation[1:].inv() * again).magnitude().max() < 1e-14


def test_a_quaternion_of_no_length_is_named():
    with pytest.raises(WhiskjaxError, match="sample 1 has length 0"):
        unit_quaternions(np.array([[0, 0, 0, 1.0], [0, 0, 0, 0], [0, 0, 0, 1]]), "sample")
