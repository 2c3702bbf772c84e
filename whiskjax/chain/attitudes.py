"""How the attitude turns from one POS sample to the next: evenly (slerp), or along a spline of continuous acceleration."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..algebra.angles import SMALL_RAD, sincos, sincos_of_small
from ..algebra.vectors import Vec3, unstack
from ..rules import arrays_of
from .knots import take
from .rotation_spline import attitude_rates
from .rotations import Quaternion, quaternion_from_small_vector, quaternion_from_vector
from .samples import relative_turns


class AbstractTurning(eqx.Module):
    """The turn from a sample towards the next."""

    @abc.abstractmethod
    def since(self, i: Int[Array, "..."], w: Float[Array, "..."]) -> Quaternion:
        """The rotation from sample i, in its body frame, when the fraction w of the interval has passed."""


class Slerp(AbstractTurning):
    """Each interval turns evenly about an axis of its own, the short way: the angular rate jumps at every sample."""

    axis: Vec3  # in the body frame, each (n - 1,), zero where nothing turns
    half_turn_rad: Float[Array, " n-1"]
    is_small: bool = eqx.field(static=True)

    def __init__(self, quaternion: Float[np.ndarray, "n 4"]):
        """**Arguments:** `quaternion`: sign-continuous."""
        turn = relative_turns(quaternion)
        math, squared = arrays_of(turn), (turn * turn).sum(axis=-1, keepdims=True)
        angle = math.sqrt(math.where(squared > 0, squared, 1.0))  # a root has no derivative at zero
        self.axis = unstack(turn / angle)
        self.half_turn_rad = jnp.asarray(math.where(squared > 0, 0.5 * angle, 0.0)[:, 0])
        self.is_small = math is np and bool((np.asarray(self.half_turn_rad) < SMALL_RAD).all())

    def since(self, i, w):
        """The share w of the turn."""
        half_turn = w * take(self.half_turn_rad, i)
        sine, cosine = sincos_of_small(half_turn) if self.is_small else sincos(half_turn)
        return *(sine * take(axis, i) for axis in self.axis), cosine


class TurnSpline(AbstractTurning):
    """The rotation vector since sample i is w (first + w (second + w third)), see rotation_spline.py."""

    first: Vec3  # rad, each (n - 1,)
    second: Vec3
    third: Vec3
    is_small: bool = eqx.field(static=True)

    def __init__(self, time_s: Float[np.ndarray, " n"], quaternion: Float[Any, "n 4"], is_gap: Bool[np.ndarray, " n-1"]):
        """**Arguments:** `quaternion`: sign-continuous; `is_gap`: intervals that the spline does not run across.

        **Raises:** `WhiskjaxError` where the samples turn too far, unless they are traced.
        """
        turn, leave, arrive = attitude_rates(time_s, quaternion, is_gap)
        step = np.diff(time_s)[:, None]
        first, last = step * leave, step * arrive
        terms = first, 3 * turn - 2 * first - last, first + last - 2 * turn
        self.first, self.second, self.third = map(unstack, terms)
        self.is_small = arrays_of(turn) is np and bool((np.linalg.norm(terms, axis=2).sum(axis=0) < 2 * SMALL_RAD).all())

    def since(self, i, w):
        """The rotation of the cubic."""
        turn: Vec3 = tuple(
            w * (take(a, i) + w * (take(b, i) + w * take(c, i)))
            for a, b, c in zip(self.first, self.second, self.third, strict=True)
        )
        return quaternion_from_small_vector(turn) if self.is_small else quaternion_from_vector(turn)
