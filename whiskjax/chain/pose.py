"""Rigid transforms between frames, and the small motions of a frame."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

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


class Pose(eqx.Module):
    """The rigid transform a_from_b: p_a = rotation p_b + translation (metres).

    Components have any batch shape; structural zeros and ones stay Python ints. `matrix` and `origin_m` are views for people.
    """

    rotation: Mat3 = IDENTITY
    translation: Vec3 = ZERO

    @classmethod
    def from_arrays(cls, rotation: Float[ArrayLike, "... 3 3"], translation_m: Float[ArrayLike, "... 3"]) -> "Pose":
        """A pose from a rotation matrix (..., 3, 3) and a translation (..., 3) in metres."""
        rows = unstack(jnp.moveaxis(jnp.asarray(rotation), -2, -1))
        return cls(tuple(unstack(row) for row in rows), unstack(translation_m))

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


class Motion(eqx.Module):
    """A small motion of the frame at a joint, to first order: p_a = a_from_b(p_b + turn x p_b + shift).

    `turn` in radians, `shift` in metres, both in the moving frame b.
    """

    turn: Vec3 = ZERO
    shift: Vec3 = ZERO

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
