"""What the check points of a block say of it: all of them together, beside coordinates that took no part."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..check_points import UNTESTED, CheckTest, Shift, check_test
from .fitted import BlockFitted
from .prepare import Prepared


def checked(
    prepared: Prepared,
    used: Bool[np.ndarray, " rays"],
    point_m: Float[np.ndarray, "points 3"],
    covariance_m2: Float[np.ndarray, "points 3 3"],
    information: Float[np.ndarray, "m m"],
    fitted: Callable[[], BlockFitted],
) -> CheckTest:
    """Adjusted less given coordinates e of the check points, whose errors come from one trajectory and so hang together.

    Together they are e^T (C + S)^-1 e, with C the joint covariance of the adjusted points and S that of the given ones (the
    innovation of a Kalman update). C = V^-1 + B^T N^-1 B, B = W V^-1, is blocks of three and what all of them have in common of
    motions and unknowns, whose reduced normal matrix is N. With D = V^-1 + S the inverse of C + S is
    D^-1 - D^-1 B^T (N + B D^-1 B^T)^-1 B D^-1 (Woodbury 1950): C itself, (3 n)^2 numbers, is never made.

    **Arguments:** `point_m`, `covariance_m2`: of the solution; `information`: N; `fitted`: gives the points' own parts.
    """
    block = prepared.block
    which = (block.role == "check") & block.seen & ~prepared.lone(used) & np.isfinite(covariance_m2).all(axis=(1, 2))
    if not which.any():
        return UNTESTED
    index = np.flatnonzero(which)
    error = (point_m - block.position_m)[index]
    own, crossed = fitted().points(index)
    each = np.linalg.inv(own + block.covariance_m2[index])
    shifted = np.concatenate([error.reshape(-1, 1), np.tile(np.eye(3), (len(index), 1))], axis=1)
    weighed = _by_blocks(each, shifted)
    inner = information + crossed @ _by_blocks(each, crossed.T)
    weighed = weighed - _by_blocks(each, crossed.T @ np.linalg.solve(inner, crossed @ weighed))
    slope, normal = shifted[:, 1:].T @ weighed[:, 0], shifted[:, 1:].T @ weighed[:, 1:]
    size = np.linalg.lstsq(normal, slope, rcond=1e-9)[0]
    spread = covariance_m2[index] + block.covariance_m2[index]
    alone = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[..., 0])
    joint = max(float(shifted[:, 0] @ weighed[:, 0]), 0.0)
    return check_test(joint, alone, 3, lambda i: block.point_label(int(index[i])), Shift(float(slope @ size), size))


def _by_blocks(blocks: Float[np.ndarray, "n 3 3"], columns: Any) -> Float[np.ndarray, "m k"]:
    """Products with a matrix of blocks of three on its diagonal."""
    return (blocks @ columns.reshape(len(blocks), 3, -1)).reshape(columns.shape)
