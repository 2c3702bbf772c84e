"""Wrong rays of points: found point by point, left out, and taken back where they turn out to be right.

The trajectory and the mounts rest on thousands of points, so a wrong ray shows in its own point. At the solution every point is
judged by the sum of its squared residuals (chi-square, two observations a ray less three unknowns), scaled by the size that the
residuals of most points have; a point that fails loses the one ray without which it passes (data snooping, Baarda 1968). Where
more than one ray would do, or none, the rays cannot tell which of them is wrong, and the point loses all.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...algebra.vectors import unstack
from ...chain.joints import joint_derivatives
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...rules.progress import tell
from ..blunders import Blunders
from ..model_test import chi_square_bound
from .block import Block
from .connect import seen_once
from .covariance import evaluate
from .prepare import Prepared, State
from .solve import Solved, gauss_newton, reduce

_ROUNDS = 12
_DELETIONS = 3  # rays that one point may lose before it loses all


def data_snooping(
    prepared: Prepared, solved: Solved, used: Bool[np.ndarray, " rays"], rule: Blunders, max_steps: int
) -> tuple[Prepared, Solved, Bool[np.ndarray, " rays"]]:
    """The solution without wrong rays, and which rays it uses. **Arguments:** `used`: the rays of the solution so far."""
    block, lonely = prepared.block, seen_once(prepared.block)
    seen: list[np.ndarray] = []
    for i in range(_ROUNDS):
        tell(f"wrong rays: round {i + 1}, {int((~used).sum())} of {len(used)} rays left out")
        judged = _judge(prepared, solved.state)
        kept = _kept(judged, block, rule) & ~lonely[block.point]
        seen.append(used)
        if any((kept == before).all() for before in seen):
            break
        used = kept
        prepared = prepared.weighted(np.where(used[:, None], 1 / block.sigma_px, 0.0), solved.state)
        solved = gauss_newton(prepared.ready, prepared.start, max_steps)
    return prepared, solved, used & ~prepared.lone(used)[block.point]


class Judged(NamedTuple):
    """Whitened residuals of all rays with every ray of a point in use, and their derivatives by the point (rays, 2, 3).

    `prior` is the whitened offset of control points, (points, 3) with its derivative (points, 3, 3); zero for others.
    """

    residual: Float[np.ndarray, "rays 2"]
    rows: Float[np.ndarray, "rays 2 3"]
    prior: Float[np.ndarray, "points 3"]
    prior_rows: Float[np.ndarray, "points 3 3"]


def _judge(prepared: Prepared, state: State) -> Judged:
    """Every point at its optimum from all of its rays, for the trajectory of the state."""
    block = prepared.block
    everything = prepared.weighted(1 / block.sigma_px, state)
    for _ in range(2):
        _, points = reduce(everything.ready, state)
        state = State(state.x, state.u, points)
    residual = prepared.by_ray(evaluate(everything.ready, state).residual_px) / block.sigma_px
    point = prepared.point_m(state)
    sensor = everything.ready.unknowns.put(everything.ready.sensor, state.x, state.u)
    at = jnp.asarray(np.where(np.isfinite(point), point, 0.0)[block.point])
    rows = np.asarray(_by_point(sensor, block.shots(), at)) / block.sigma_px[:, :, None]
    control = block.role == "control"
    root = np.zeros((len(block.role), 3, 3))
    root[control] = np.linalg.cholesky(block.information()[control]).swapaxes(1, 2)
    off = np.where(control[:, None], block.position_m - point, 0.0)
    return Judged(residual, rows, np.einsum("nij,nj->ni", root, np.nan_to_num(off)), root)


@eqx.filter_jit
def _by_point(sensor: Sensor, shot: Shot, point: Float[Array, "rays 3"]) -> Float[Array, "rays 2 3"]:
    derivative = joint_derivatives(sensor, shot, unstack(point)).derivatives["earth"]
    return jnp.stack([jnp.stack(row, -1) for row in derivative], -2)


def _kept(judged: Judged, block: Block, rule: Blunders) -> Bool[np.ndarray, " rays"]:
    points = len(block.role)
    used = np.ones(len(block), dtype=bool)
    test, freedom, _ = _tested(judged, block, used)
    asked = freedom > 0
    size = max(1.0, float(np.median(test[asked] / _median(freedom[asked])))) if asked.any() else 1.0
    for _ in range(_DELETIONS):
        test, freedom, gain = _tested(judged, block, used)
        failing = (freedom > 0) & (test > size * _bound(freedom, rule.level))
        if not failing.any():
            break
        # The ray whose loss helps most, how much the next best would, and whether the point passes without it.
        gain = np.where(used, gain, -np.inf)
        order = np.lexsort((-gain, block.point))
        begins = np.searchsorted(block.point[order], np.arange(points))
        best = order[np.minimum(begins, len(order) - 1)]
        second = order[np.minimum(begins + 1, len(order) - 1)]
        bound = size * _bound(freedom - 2, rule.level)
        passes = test - gain[best] <= bound
        unclear = (test - gain[second] <= bound) & (block.point[second] == np.arange(points))
        clear = failing & passes & ~unclear & (freedom > 2)
        used[best[clear]] = False
        lost = failing & ~clear & ~(failing & ~passes & (freedom > 4))
        used[lost[block.point]] = False
        again = failing & ~passes & (freedom > 4)  # more than one wrong ray: the worst goes, and the point is judged again
        used[best[again]] = False
    test, freedom, _ = _tested(judged, block, used)
    still = (freedom > 0) & (test > size * _bound(freedom, rule.level))
    return used & ~still[block.point]


def _tested(judged: Judged, block: Block, used: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each point the sum of squares at its optimum from used rays and its freedom; of each ray what its loss would gain."""
    points, of = len(block.role), block.point
    share = used.astype(float)[:, None]
    rows, residual = judged.rows * share[..., None], judged.residual * share
    normal, right = judged.prior_rows.swapaxes(1, 2) @ judged.prior_rows, np.einsum("nji,nj->ni", judged.prior_rows, judged.prior)
    np.add.at(normal, of, rows.swapaxes(1, 2) @ rows)
    np.add.at(right, of, np.einsum("nji,nj->ni", rows, residual))
    count = np.bincount(of[used], minlength=points)
    control = block.role == "control"
    freedom = np.where(control, 2 * count, 2 * count - 3)
    normal[~control & (count < 2)] = np.eye(3)
    inverse = np.linalg.inv(normal)
    step = np.einsum("nij,nj->ni", inverse, right)
    here = judged.residual - np.einsum("nij,nj->ni", judged.rows, step[of])
    pulled = judged.prior - np.einsum("nij,nj->ni", judged.prior_rows, step)
    test = (pulled**2).sum(axis=1) + np.bincount(of, weights=((here * share) ** 2).sum(axis=1), minlength=points)
    left = np.eye(2) - judged.rows @ inverse[of] @ judged.rows.swapaxes(1, 2)
    # A ray that the point cannot do without has no residual of its own: its share of redundancy vanishes.
    values, vectors = np.linalg.eigh(left)
    along = np.einsum("nji,nj->ni", vectors, here)
    gain = (np.where(values > 1e-6, along**2 / np.maximum(values, 1e-6), 0.0)).sum(axis=1)
    return np.where(freedom > 0, test, 0.0), freedom, np.where(used, gain, 0.0)


def _median(freedom: np.ndarray) -> np.ndarray:
    """Of chi-square (Wilson and Hilferty 1931)."""
    return freedom * (1 - 2 / (9 * freedom)) ** 3


def _bound(freedom: np.ndarray, level: float) -> np.ndarray:
    """What a chi-square variable exceeds with probability `level`; infinite without freedom."""
    degrees = np.unique(freedom)
    bounds = {int(k): chi_square_bound(level, int(k)) if k > 0 else math.inf for k in degrees}
    return np.array([bounds[int(k)] for k in freedom])
