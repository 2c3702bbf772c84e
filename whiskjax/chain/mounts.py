"""Constant links: a mount with lever arm and small angles, and a signed permutation of axes."""

import itertools
import re

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import IDENTITY, ZERO, Mat3, scale, unstack
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, need
from .camera import common_batch, parameter
from .link import AbstractLink
from .pose import Pose
from .rotations import check_order, rotation_from_angles
from .shot import Shot


class Mount(AbstractLink):
    """A constant lever arm and small angles, what gets calibrated: p_outer = R p_inner + lever_sign * lever_arm_m.

    R = R_order[0](angles[0]) R_order[1](angles[1]) R_order[2](angles[2]), active. `lever_sign` is +1 where the lever arm leads
    from the outer origin to the inner one (Jin et al. 2024: antenna to platform), -1 where it leads back (Wang et al. 2018:
    projection centre to antenna). None is exactly zero and costs nothing.
    """

    lever_arm_m: Float[Array, "*batch 3"] | None = eqx.field(converter=parameter)
    angles_rad: Float[Array, "*batch 3"] | None = eqx.field(converter=parameter)
    order: str = eqx.field(static=True)
    lever_sign: int = eqx.field(static=True)

    def __init__(
        self,
        lever_arm_m: Float[Numbers, "*batch 3"] | None = None,
        angles_rad: Float[Numbers, "*batch 3"] | None = None,
        order: str = "xyz",
        lever_sign: int = 1,
    ):
        """**Raises:** `WhiskjaxError` for other shapes, angles in degrees, an order or a sign that is none."""
        arrays = Arrays("Mount")
        self.lever_arm_m = arrays.take("lever_arm_m", lever_arm_m, "... 3", optional=True, finite=True, meaning="x, y, z")
        self.angles_rad = arrays.take(
            "angles_rad", angles_rad, "... 3", optional=True, finite=True, within_rad=2 * np.pi, meaning=f"in the order {order!r}"
        )
        self.order = check_order(order)
        if lever_sign not in (1, -1):
            raise WhiskjaxError(f"Mount: lever_sign is +1 or -1, not {lever_sign!r}")
        self.lever_sign = lever_sign

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """No lever arm, no turn."""
        return np.zeros(3) if field in ("lever_arm_m", "angles_rad") else None

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of lever arm and angles."""
        return common_batch((self.lever_arm_m, 1), (self.angles_rad, 1))

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
        need("Axes", "axes", self.axes, str)
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


def _right_handed(axes: str) -> bool:
    is_even = axes.replace("-", "") in ("x y z", "y z x", "z x y")
    return is_even == (axes.count("-") % 2 == 0)


# All that axes can be: the 24 signed permutations that are rotations.
CONVENTIONS = tuple(
    axes
    for order in itertools.permutations("xyz")
    for signs in itertools.product(("", "-"), repeat=3)
    if _right_handed(axes := " ".join(map("".join, zip(signs, order, strict=True))))
)
