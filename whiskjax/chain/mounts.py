"""Constant links: a mount with lever arm and small angles, and a signed permutation of axes."""

import re
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import IDENTITY, ZERO, Mat3, scale, unstack
from ..rules import RESULTS, WhiskjaxError
from .link import AbstractLink
from .pose import Pose
from .rotations import check_order, rotation_from_angles
from .shot import Shot


def _three_or_none(value: Any) -> Any:
    if value is None:
        return None
    value = jnp.asarray(value, dtype=float)
    if value.shape[-1:] != (3,):
        raise WhiskjaxError(f"a mount has three lengths and three angles, got shape {value.shape}")
    return value


class Mount(AbstractLink):
    """A constant lever arm and small angles, what gets calibrated: p_outer = R p_inner + lever_sign * lever_arm_m.

    R = R_order[0](angles[0]) R_order[1](angles[1]) R_order[2](angles[2]), active. `lever_sign` is +1 where the lever arm leads
    from the outer origin to the inner one (paper 000: antenna to platform), -1 where it leads back (paper 001: projection centre
    to antenna). None is exactly zero and costs nothing.
    """

    lever_arm_m: Float[Array, "*batch 3"] | None = eqx.field(default=None, converter=_three_or_none)
    angles_rad: Float[Array, "*batch 3"] | None = eqx.field(default=None, converter=_three_or_none)
    order: str = eqx.field(default="xyz", static=True)
    lever_sign: int = eqx.field(default=1, static=True)

    def __check_init__(self):
        check_order(self.order)
        if self.lever_sign not in (1, -1):
            raise WhiskjaxError(f"lever_sign is +1 or -1, not {self.lever_sign!r}")

    def pose(self, shot: Shot) -> Pose:
        """The same for every shot."""
        translation = ZERO if self.lever_arm_m is None else scale(self.lever_sign, unstack(self.lever_arm_m))
        rotation = IDENTITY if self.angles_rad is None else rotation_from_angles(unstack(self.angles_rad), self.order)
        return Pose(rotation, translation)

    def check(self, shot: Shot) -> RESULTS:
        """Always known."""
        return RESULTS.successful


class Axes(AbstractLink):
    """A named signed permutation: for the inner x, y and z axis, the outer axis along which it lies.

    `Axes("x -y -z")` turns forward-right-down into forward-left-up: inner x along x, inner y along -y, inner z along -z.
    """

    axes: str = eqx.field(static=True)

    def __check_init__(self):
        words = self.axes.split()
        if not all(re.fullmatch("[+-]?[xyz]", w) for w in words) or sorted(w[-1] for w in words) != ["x", "y", "z"]:
            raise WhiskjaxError(f"axes are three signed names, as 'x -y -z', not {self.axes!r}")
        if np.linalg.det(np.array(self._rotation(), dtype=float)) < 0:
            raise WhiskjaxError(f"axes {self.axes!r} are left-handed: one sign is wrong")

    def _rotation(self) -> Mat3:
        images = [(-1 if w[0] == "-" else 1, "xyz".index(w[-1])) for w in self.axes.split()]
        rows = tuple(tuple(sign if row == axis else 0 for sign, axis in images) for row in range(3))
        return rows

    def pose(self, shot: Shot) -> Pose:
        """The same for every shot, all structural."""
        return Pose(self._rotation())

    def check(self, shot: Shot) -> RESULTS:
        """Always known."""
        return RESULTS.successful
