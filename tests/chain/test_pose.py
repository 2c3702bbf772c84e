"""Poses are a group that acts on points; small motions are its tangent vectors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from tests.derivatives import assert_derivatives
from tests.strategies import BATCH, attitudes, numbers
from whiskjax.algebra.vectors import IDENTITY, ZERO
from whiskjax.chain.rotations import rotation_from_vector

RADIUS_M = 7e6
ROUNDING_M = 2e-8  # about twenty ulp at the distance of the Earth's radius
TURN_ROUNDING = 4e-15


def poses_of(turn, shift):
    return wj.Pose(rotation_from_vector(oracles.split(turn)), oracles.split(shift))


def arrays(pose):
    """Rotation and translation of a batch, structural numbers filled in."""
    return jnp.broadcast_to(pose.matrix, (BATCH, 3, 3)), jnp.broadcast_to(pose.origin_m, (BATCH, 3))


@jax.jit
def both_sides(turns, shifts, point):
    """Left and right side of each axiom."""
    p, q, r = (poses_of(turn, shift) for turn, shift in zip(turns, shifts, strict=True))
    x = oracles.split(point)
    identity = wj.Pose()
    poses = {
        "associative": ((p @ q) @ r, p @ (q @ r)),
        "identity on the right": (p @ identity, p),
        "identity on the left": (identity @ p, p),
        "inverse on the right": (p @ p.inverse(), identity),
        "inverse on the left": (p.inverse() @ p, identity),
        "inverse of a product": ((p @ q).inverse(), q.inverse() @ p.inverse()),
    }
    points = {
        "acts on points": ((p @ q).point(x), p.point(q.point(x))),
        "acts on directions": ((p @ q).direction(x), p.direction(q.direction(x))),
        "into is the inverse": (p.into(x), p.inverse().point(x)),
    }
    return {k: (arrays(a), arrays(b)) for k, (a, b) in poses.items()}, {
        k: (jnp.stack(a, -1), jnp.stack(b, -1)) for k, (a, b) in points.items()
    }


lengths = numbers(-RADIUS_M, RADIUS_M, (BATCH, 3))


@given(attitudes((3, BATCH)), numbers(-RADIUS_M, RADIUS_M, (3, BATCH, 3)), lengths)
def test_group_axioms(turns, shifts, point):
    poses, points = both_sides(turns, shifts, point)
    for axiom, ((left, t_left), (right, t_right)) in poses.items():
        np.testing.assert_allclose(left, right, rtol=0, atol=TURN_ROUNDING, err_msg=axiom)
        np.testing.assert_allclose(t_left, t_right, rtol=0, atol=ROUNDING_M, err_msg=axiom)
    for axiom, (left, right) in points.items():
        np.testing.assert_allclose(left, right, rtol=0, atol=ROUNDING_M, err_msg=axiom)


@jax.jit
def carried(turn, shift, point):
    pose, x = poses_of(turn, shift), oracles.split(point)
    return [jnp.stack(v, -1) for v in (pose.point(x), pose.direction(x), pose.into(x))]


@given(attitudes(), lengths, lengths)
def test_points_and_directions_agree_with_scipy(turn, shift, point):
    rotation = Rotation.from_rotvec(turn)
    outside, direction, inside = carried(turn, shift, point)
    np.testing.assert_allclose(outside, rotation.apply(point) + shift, rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(direction, rotation.apply(point), rtol=0, atol=ROUNDING_M)
    np.testing.assert_allclose(inside, rotation.inv().apply(point - shift), rtol=0, atol=ROUNDING_M)


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_arrays_go_in_and_come_out(shape):
    rng = np.random.default_rng(7)
    rotation = Rotation.from_rotvec(rng.normal(size=(int(np.prod(shape)), 3))).as_matrix().reshape(*shape, 3, 3)
    shift = rng.normal(size=(*shape, 3))
    pose = wj.Pose.from_arrays(rotation, shift)
    np.testing.assert_array_equal(pose.matrix, rotation)
    np.testing.assert_array_equal(pose.origin_m, shift)
    x = rng.normal(size=(*shape, 3))
    expected = np.einsum("...ij,...j->...i", rotation, x) + shift
    np.testing.assert_allclose(oracles.array(pose.point(oracles.split(x))), expected, rtol=0, atol=1e-14)


def test_the_identity_is_structural():
    pose = wj.Pose() @ wj.Pose()
    assert pose.rotation == IDENTITY and pose.translation == ZERO
    x = (jnp.ones(2), jnp.zeros(2), jnp.ones(2))
    assert pose.point(x) == x
    np.testing.assert_array_equal(pose.matrix, np.eye(3))


def test_derivatives_of_a_pose():
    def f(x):
        p = wj.Pose(rotation_from_vector(x[:3]), tuple(x[3:6]))
        q = wj.Pose(rotation_from_vector(x[6:9]), tuple(x[9:12]))
        return (p @ q.inverse()).point(tuple(x[12:])), p.into(tuple(x[12:]))

    x = np.random.default_rng(8).normal(size=15)
    assert_derivatives(f, x, step=1e-2, tolerance=1e-9)


def perturbed(pose, motion):
    """The pose after a finite motion of its inner frame."""
    return pose @ wj.Pose(rotation_from_vector(motion[:3]), tuple(motion[3:]))


MOTION = np.array([0.3, -0.2, 0.5, 1.0, -2.0, 0.7])
OUTER = poses_of(np.array([0.4, 1.0, -0.3]), np.array([3.0, -4.0, 5.0]))
INNER = poses_of(np.array([-1.0, 0.2, 0.7]), np.array([1.0, 2.0, -1.5]))


def rate(f):
    """Derivative of f(size of the motion) at zero."""
    return jax.jvp(f, (jnp.zeros(()),), (jnp.ones(()),))[1]


def test_a_motion_moves_points_as_the_derivative_of_a_finite_motion():
    point = (10.0, 20.0, -30.0)
    motion = wj.Motion(tuple(MOTION[:3]), tuple(MOTION[3:]))
    # A point of the unmoved frame, seen from the moved one: the first-order part of `into`.
    exact = rate(lambda e: jnp.stack(perturbed(wj.Pose(), e * MOTION).into(point)))
    first_order = np.asarray(motion.into(point)) - np.asarray(point)
    np.testing.assert_allclose(first_order, exact, rtol=0, atol=1e-13)


def test_a_motion_seen_at_the_next_joint_is_the_same_motion():
    motion = wj.Motion(tuple(MOTION[:3]), tuple(MOTION[3:]))
    inner = motion.through(INNER)
    inner = np.array([float(c) for c in (*inner.turn, *inner.shift)])
    outside = rate(lambda e: jnp.stack((perturbed(OUTER, e * MOTION) @ INNER).point((1.0, 2.0, 3.0))))
    inside = rate(lambda e: jnp.stack(perturbed(OUTER @ INNER, e * inner).point((1.0, 2.0, 3.0))))
    np.testing.assert_allclose(inside, outside, rtol=0, atol=1e-13)


def test_a_motion_of_nothing_is_nothing():
    nothing = wj.Motion().through(INNER)
    np.testing.assert_array_equal(oracles.array((*nothing.turn, *nothing.shift)), np.zeros(6))


def test_the_derivative_of_a_pose_is_the_motion_that_made_it():
    derivative = jax.jvp(lambda e: perturbed(OUTER, e * MOTION), (jnp.zeros(()),), (jnp.ones(()),))[1]
    found = wj.Motion.from_derivative(OUTER, derivative)
    np.testing.assert_allclose(oracles.array((*found.turn, *found.shift)), MOTION, rtol=0, atol=1e-14)
