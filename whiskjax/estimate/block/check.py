"""What the check points of a block say of it: all of them together, beside coordinates that took no part."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Array, Bool, Float

from ..check_points import UNTESTED, CheckTest, Shift, check_test
from .prepare import Prepared
from .solve import Solved, reduce


def checked(
    prepared: Prepared,
    solved: Solved,
    used: Bool[np.ndarray, " rays"],
    point_m: Float[np.ndarray, "points 3"],
    covariance_m2: Float[np.ndarray, "points 3 3"],
) -> CheckTest:
    """Adjusted less given coordinates of the check points, whose errors come from one trajectory and so hang together.

    What all of them weigh jointly is what the cost of the block rises by when they become control points: the least |residuals|^2
    with their coordinates less that without them is e^T (C + S)^-1 e, with C the joint covariance of the adjusted points and S
    that of the given ones (the innovation of a Kalman update; C itself, (3 n)^2 numbers, is never made). The rise is that of the
    block as it is linear at the solution.

    **Arguments:** `point_m`, `covariance_m2`: of the solution.
    """
    block, state = prepared.block, solved.state
    which = (block.role == "check") & block.seen & ~prepared.lone(used) & np.isfinite(covariance_m2).all(axis=(1, 2))
    if not which.any():
        return UNTESTED
    weight = np.where(used[:, None], 1 / block.sigma_px, 0.0)

    def least(shift_m: Float[np.ndarray, "3"]) -> float:
        """The least cost with check points as control points that lie elsewhere."""
        position = np.where(which[:, None], block.position_m + shift_m, block.position_m)
        control = dataclasses.replace(block, role=np.where(which, "control", block.role), position_m=position)
        with_them, _ = reduce(dataclasses.replace(prepared, block=control).weighted(weight, state).ready, state)
        return float(with_them.cost) - _gain(with_them.matrix, with_them.right)

    costs = least(np.zeros(3)), float(solved.reduced.cost) - _gain(solved.reduced.matrix, solved.reduced.right)
    index = np.flatnonzero(which)
    error = (point_m - block.position_m)[index]
    spread = covariance_m2[index] + block.covariance_m2[index]
    own = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[..., 0])
    shift = _shift(least, costs[0], float(np.sqrt(np.einsum("nii->", spread) / spread.shape[0] / 3)))
    return check_test(max(costs[0] - costs[1], 0.0), own, 3, lambda i: block.point_label(int(index[i])), shift)


def _shift(least: Callable[[np.ndarray], float], at_rest: float, size_m: float) -> Shift:
    """The shift of all check points with the least cost, which is a parabola of it: six more costs give it, and three crossed."""
    axes = size_m * np.eye(3)
    ahead, behind = np.array([least(a) for a in axes]), np.array([least(-a) for a in axes])
    curved = np.diag(ahead + behind - 2 * at_rest)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        curved[i, j] = curved[j, i] = least(axes[i] + axes[j]) - ahead[i] - ahead[j] + at_rest
    slope = (ahead - behind) / 2
    size = -np.linalg.lstsq(curved, slope, rcond=1e-9)[0]
    return Shift(float(-slope @ size) / 2, size * size_m)


def _gain(matrix: Array, right: Array) -> float:
    """What a step to the minimum of the linear block takes off the cost."""
    return float(np.asarray(right) @ np.linalg.solve(np.asarray(matrix), np.asarray(right)))
