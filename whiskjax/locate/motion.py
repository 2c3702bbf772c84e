"""A target that moves: constant velocity, with accelerations as white noise."""

from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Mat3, add, matmul, mul, transpose
from ..chain.camera import parameter
from ..rules import Arrays, Numbers
from .update import Covariance, State


class ConstantVelocity(eqx.Module):
    """A target that moves evenly, more or less.

    **Arguments:**

    - `sigma_enu_mps`: 1-sigma of the velocity's components east, north, up before the first look; their mean is zero.
    - `acceleration_enu`: spectral density of the accelerations, (3,) in m^2/s^3: in a time t the velocity wanders by
      sqrt(density t). Zero is an even motion.
    """

    sigma_enu_mps: Float[Array, "3"] = eqx.field(converter=parameter)
    acceleration_enu: Float[Array, "3"] = eqx.field(converter=parameter)

    def __init__(self, sigma_enu_mps: Float[Numbers, "3"], acceleration_enu: Float[Numbers, "3"] = (0.0, 0.0, 0.0)):
        """**Raises:** `WhiskjaxError` where there are not three numbers of each, or one is negative or not finite."""
        arrays, axes = Arrays("ConstantVelocity"), "east, north, up"
        self.sigma_enu_mps = arrays.take("sigma_enu_mps", sigma_enu_mps, "3", finite=True, least=0.0, meaning=axes)
        self.acceleration_enu = arrays.take("acceleration_enu", acceleration_enu, "3", finite=True, least=0.0, meaning=axes)


class Transition(NamedTuple):
    """What happens between two looks: seconds, and the spectral density of the acceleration in the axes of the state."""

    step_s: Component
    density: Mat3


def predict(state: State, covariance: Covariance, transition: Transition) -> tuple[State, Covariance]:
    """Position and velocity, the first six of the state, one step later (Liu et al. 2019, equations 14 and 15).

    Bar-Shalom, Li and Kirubarajan (2001), section 6.2.2: the discretised white-noise acceleration.
    """
    t, q = transition
    n = len(state)
    forward = tuple(tuple(t if (i < 3 and j == i + 3) else int(i == j) for j in range(n)) for i in range(n))
    moved = tuple(add(a, t * b) for a, b in zip(state[:3], state[3:6], strict=True))
    spread = matmul(matmul(forward, covariance), transpose(forward))
    added = {(0, 0): t * t * t / 3, (0, 3): t * t / 2, (3, 0): t * t / 2, (3, 3): t}
    wider = [list(row) for row in spread]
    for (a, b), factor in added.items():
        for i in range(3):
            for j in range(3):
                wider[a + i][b + j] = add(wider[a + i][b + j], factor * q[i][j])
    return (*moved, *state[3:]), tuple(tuple(row) for row in wider)


def in_world(diagonal: Float[Array, "3"], level: Mat3) -> Mat3:
    """A diagonal matrix in east, north and up, in the axes of the world."""
    return matmul(tuple(tuple(mul(c, diagonal[j]) for j, c in enumerate(row)) for row in level), transpose(level))
