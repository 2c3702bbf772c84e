"""Rigid transforms between frames, and the small motions of a frame."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import (
    IDENTITY,
    ZERO,
    Mat3,
    Vec3,
    apply,
    cross,
    dot,
    matmul,
    stack,
    transpose,
    unstack,
    vadd,
    vsub,
)
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced


class Pose(eqx.Module):
    """The rigid transform a_from_b: p_a = rotation p_b + translation (metres).

    Components have any batch shape; structural zeros and ones stay Python ints. `matrix` and `origin_m` are views for people.
    """

    rotation: Mat3 = IDENTITY
    translation: Vec3 = ZERO

    def __check_init__(self):
        _three("Pose", "rotation", self.rotation, "Pose.from_arrays(rotation, translation_m)")
        _three("Pose", "translation", self.translation, "Pose.from_arrays(rotation, translation_m)")
        for row in self.rotation:
            _three("Pose", "rotation", row, "Pose.from_arrays(rotation, translation_m)")

    @classmethod
    def from_arrays(cls, rotation: Float[Numbers, "... 3 3"], translation_m: Float[Numbers, "... 3"]) -> "Pose":
        """A pose from a rotation matrix (..., 3, 3) and a translation (..., 3) in metres.

        **Raises:** `WhiskjaxError` for other shapes, float32, or a matrix that is no rotation to within 1e-6.
        """
        arrays = Arrays("Pose.from_arrays")
        matrix = jnp.asarray(arrays.take("rotation", rotation, "... 3 3", absolute=True))
        translation = jnp.asarray(arrays.take("translation_m", translation_m, "... 3", absolute=True))
        if not is_traced(matrix):
            r = np.asarray(matrix)
            if not (np.abs(r @ np.swapaxes(r, -1, -2) - np.eye(3)) < 1e-6).all() or not (np.linalg.det(r) > 0).all():
                arrays.refuse("rotation", "is no rotation: its rows must be orthogonal unit vectors, right-handed")
        rows = unstack(jnp.moveaxis(matrix, -2, -1))
        return cls(tuple(unstack(row) for row in rows), unstack(translation))

    @property
    def matrix(self) -> Float[Array, "... 3 3"]:
        """Rotation a_from_b as an array."""
        return jnp.stack(jnp.broadcast_arrays(*[stack(row) for row in self.rotation]), axis=-2)

    @property
    def origin_m(self) -> Float[Array, "... 3"]:
        """Origin of frame b in frame a, metres."""
        return stack(self.translation)

    def __matmul__(self, b_from_c: "Pose") -> "Pose":
        return Pose(matmul(self.rotation, b_from_c.rotation), self.point(b_from_c.translation))

    def inverse(self) -> "Pose":
        """b_from_a."""
        back = transpose(self.rotation)
        return Pose(back, apply(back, vsub(ZERO, self.translation)))

    def direction(self, d_b: Vec3) -> Vec3:
        """A direction of frame b, in frame a."""
        return apply(self.rotation, d_b)

    def point(self, p_b: Vec3) -> Vec3:
        """A point of frame b, in frame a."""
        return vadd(apply(self.rotation, p_b), self.translation)

    def into(self, p_a: Vec3) -> Vec3:
        """A point of frame a, in frame b."""
        return apply(transpose(self.rotation), vsub(p_a, self.translation))


def _three(owner: str, name: str, value: Any, remedy: str) -> None:
    """Components along three axes; an array has its axes elsewhere, and which one is meant is not guessed."""
    if not isinstance(value, tuple) or len(value) != 3:
        raise WhiskjaxError(
            f"{owner}: {name} is three components (a tuple), not {type(value).__name__}; of arrays make it by {remedy}"
        )


class Motion(eqx.Module):
    """A small motion of the frame at a joint, to first order: p_a = a_from_b(p_b + turn x p_b + shift).

    `turn` in radians, `shift` in metres, both in the moving frame b.
    """

    turn: Vec3 = ZERO
    shift: Vec3 = ZERO

    def __check_init__(self):
        for name, value in (("turn", self.turn), ("shift", self.shift)):
            _three("Motion", name, value, "tuple(numpy.moveaxis(array, -1, 0)) of an array (..., 3)")

    def into(self, p: Vec3) -> Vec3:
        """Where a point of the unmoved frame b lies in the moved one."""
        return vsub(vsub(p, cross(self.turn, p)), self.shift)

    def through(self, b_from_c: Pose) -> "Motion":
        """The same motion, seen at the next joint inwards: turn_c = R^T turn_b, shift_c = R^T (shift_b + turn_b x t)."""
        back = transpose(b_from_c.rotation)
        shift = vadd(self.shift, cross(self.turn, b_from_c.translation))
        return Motion(apply(back, self.turn), apply(back, shift))

    @classmethod
    def from_derivative(cls, pose: Pose, derivative: Pose) -> "Motion":
        """The small motion that the derivative of a pose is: [turn]x = R^T dR, shift = R^T dt."""
        back, d = transpose(pose.rotation), transpose(derivative.rotation)
        turn = dot(back[2], d[1]), dot(back[0], d[2]), dot(back[1], d[0])
        return cls(turn, apply(back, derivative.translation))
