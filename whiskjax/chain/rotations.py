"""Rotations: named-order angles, quaternions (x, y, z, w), rotation vectors. All active, right-handed."""

from typing import TypeAlias

import jax.numpy as jnp

from ..algebra.angles import ELEMENTARY, sincos
from ..algebra.vectors import Component, Mat3, Vec3, dot, matmul, mul, scale, sub, vadd
from ..rules import WhiskjaxError

Quaternion: TypeAlias = tuple[Component, ...]
_AXES = "xyz"


def rotation_from_angles(angles_rad: Vec3, order: str) -> Mat3:
    """R = R_order[0](angles[0]) R_order[1](angles[1]) R_order[2](angles[2]).

    "xyz" with (omega, phi, kappa) is Rx(omega) Ry(phi) Rz(kappa); "zyx" with (heading, pitch, roll) is ned_from_body.
    """
    first, second, third = (ELEMENTARY[axis](a) for axis, a in zip(check_order(order), angles_rad, strict=True))
    return matmul(first, matmul(second, third))


def check_order(order: str) -> str:
    """The order itself, if it names each axis once."""
    if not isinstance(order, str) or sorted(order) != list(_AXES):
        raise WhiskjaxError(f"an order of rotations names each of x, y and z once, as 'xyz' or 'zyx', not {order!r}")
    return order


def angles_from_rotation(rotation: Mat3, order: str) -> Vec3:
    """The angles whose product in the given order is this rotation; the middle one lies in [-pi/2, pi/2].

    The last angle is that of what is left when the first turn is undone, so the three stay a decomposition of the rotation where
    the middle one is a right angle and the outer two are not unique.
    """
    i, j, k = (_AXES.index(axis) for axis in check_order(order))
    sign = 1 if (j - i) % 3 == 1 else -1
    r = rotation
    first = jnp.arctan2(-sign * r[j][k], r[k][k])
    s, c = sincos(first)
    left = tuple(c * a + sign * s * b for a, b in zip(r[j], r[k], strict=True))
    middle = jnp.arctan2(sign * r[i][k], c * r[k][k] - sign * s * r[j][k])
    return first, middle, jnp.arctan2(sign * left[i], left[j])


def rotation_from_quaternion(q: Quaternion) -> Mat3:
    """Rotation of a unit quaternion (x, y, z, w)."""
    x, y, z, w = q
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz, wx, wy, wz = x * y, x * z, y * z, w * x, w * y, w * z
    return (
        (1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)),
        (2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)),
        (2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)),
    )


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Hamilton product: first q, then p."""
    (*u, a), (*v, b) = p, q
    x = sub(mul(u[1], v[2]), mul(u[2], v[1]))
    y = sub(mul(u[2], v[0]), mul(u[0], v[2]))
    z = sub(mul(u[0], v[1]), mul(u[1], v[0]))
    vector = vadd((x, y, z), vadd(scale(a, v), scale(b, u)))
    return *vector, sub(mul(a, b), dot(u, v))


def quaternion_from_vector(turn_rad: Vec3) -> Quaternion:
    """Unit quaternion of a rotation vector (axis times angle), with a safe branch at zero."""
    squared = dot(turn_rad, turn_rad)
    small = squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    s, c = sincos(0.5 * angle)
    # sin(a/2)/a = 1/2 - a^2/48 + ..., cos(a/2) = 1 - a^2/8 + ...; the next terms are below 1e-17 here.
    factor = jnp.where(small, 0.5 - squared / 48.0, s / angle)
    return *scale(factor, turn_rad), jnp.where(small, 1.0 - squared / 8.0, c)


def quaternion_from_small_vector(turn_rad: Vec3) -> Quaternion:
    """The same for turns up to twice `SMALL_RAD` (from one POS sample to the next): a power series, without root or branch."""
    z = 0.25 * dot(turn_rad, turn_rad)
    half = 0.5 + z * (-1 / 12 + z * (1 / 240 + z * (-1 / 10080)))
    cosine = 1 + z * (-1 / 2 + z * (1 / 24 + z * (-1 / 720 + z * (1 / 40320))))
    return *scale(half, turn_rad), cosine


def rotation_from_vector(turn_rad: Vec3) -> Mat3:
    """Rotation by |turn| about the direction of turn; exact, differentiable at zero."""
    return rotation_from_quaternion(quaternion_from_vector(turn_rad))
