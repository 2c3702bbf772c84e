"""What the check points of a block say of it: all of them together, beside coordinates that took no part."""

import dataclasses

import numpy as np
from jaxtyping import Array, Bool, Float

from ..check_points import UNTESTED, CheckTest, check_test
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
    joined = dataclasses.replace(prepared, block=dataclasses.replace(block, role=np.where(which, "control", block.role)))
    weight = np.where(used[:, None], 1 / block.sigma_px, 0.0)
    with_them, _ = reduce(joined.weighted(weight, state).ready, state)
    costs = [float(one.cost) - _gain(one.matrix, one.right) for one in (with_them, solved.reduced)]
    index = np.flatnonzero(which)
    error = (point_m - block.position_m)[index]
    spread = covariance_m2[index] + block.covariance_m2[index]
    own = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[..., 0])
    return check_test(max(costs[0] - costs[1], 0.0), own, 3, lambda i: block.point_label(int(index[i])))


def _gain(matrix: Array, right: Array) -> float:
    """What a step to the minimum of the linear block takes off the cost."""
    return float(np.asarray(right) @ np.linalg.solve(np.asarray(matrix), np.asarray(right)))
