"""The block adjustment of ceres_block.cpp by scipy: residuals in numpy, their analytic derivatives as a sparse matrix."""

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from . import MissingPeer
from .ceres_block import (
    ACTING,
    DEFORMATION,
    MOUNT,
    BlockArrays,
    Solution,
    boresight,
    deformation,
    image,
    residual,
    rodrigues,
    rotation_from_quaternion,
    skew,
)

try:
    from scipy import sparse
    from scipy.optimize import least_squares
except ImportError as error:
    raise MissingPeer("scipy is not installed: pip install 'whiskjax[bench]'") from error

# With scipy's own settings (1e-6, no more inner steps than unknowns) LSMR solves so poorly that 300 steps leave the cost of a
# small block wrong in its sixth digit; with these 6 steps are enough.
LSMR = {"atol": 1e-10, "btol": 1e-10, "conlim": 0.0, "maxiter": 5000}


@dataclass(frozen=True)
class ScipyAnswer:
    """What scipy found, and what it took: half the sum of squared residuals, steps tried, CPU time of all of least_squares."""

    final_cost: float
    iterations: int
    cpu_s: float
    solution: Solution

    @property
    def cpu_per_iteration_s(self) -> float:
        """CPU time of least_squares over its iterations."""
        return self.cpu_s / self.iterations


@dataclass(frozen=True)
class ScipyBlock:
    """One adjustment. Its unknowns are all parameters that are not held: nodes, shared, points, in this order."""

    arrays: BlockArrays

    @cached_property
    def all_start(self) -> np.ndarray:
        """The start, what is held included."""
        return np.concatenate([part.ravel() for part in self.arrays.start])

    @cached_property
    def free(self) -> np.ndarray:
        """Which parameters are not held."""
        held = np.zeros(self.all_start.size, bool)
        node, shared, _ = self.arrays.start
        held[node.size : node.size + shared.size] = self.arrays.shared_held
        return ~held

    def solution(self, x: np.ndarray) -> Solution:
        """The parameters of some unknowns."""
        node, shared, point_m = self.arrays.start
        full = self.all_start.copy()
        full[self.free] = x
        values = np.split(full, np.cumsum([node.size, shared.size]))
        return Solution(values[0].reshape(node.shape), values[1], values[2].reshape(point_m.shape))

    def residual(self, x: np.ndarray) -> np.ndarray:
        """`ceres_block.residual` of the unknowns."""
        return residual(self.arrays, self.solution(x))

    @cached_property
    def _priors(self) -> Any:
        """The rows of the priors, which are linear."""
        a, (node, shared, _) = self.arrays, self.arrays.start
        row = np.repeat(np.arange(len(a.prior_axis)), np.diff(a.prior_start))
        of_nodes = sparse.coo_array(
            (a.prior_coefficient, (row, node.shape[1] * a.prior_node + a.prior_axis[row])),
            shape=(len(a.prior_axis), self.all_start.size),
        )
        at_point = node.size + shared.size + 3 * a.control[:, None, None] + np.arange(3)
        at_row = (3 * np.arange(len(a.control))[:, None] + np.arange(3))[:, :, None]
        where = [np.broadcast_to(i, a.control_whitening.shape).ravel() for i in (at_row, at_point)]
        of_controls = sparse.coo_array((a.control_whitening.ravel(), where), shape=(3 * len(a.control), self.all_start.size))
        known = np.flatnonzero(a.shared_sigma > 0)
        of_shared = sparse.coo_array(
            (1 / a.shared_sigma[known], (np.arange(len(known)), node.size + known)), shape=(len(known), self.all_start.size)
        )
        return sparse.vstack([of_nodes, of_controls, of_shared]).tocsc()[:, self.free].tocsr()

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the rows of the rays: which of their derivatives are by unknowns, (rays, 2, 41), those columns, and row starts."""
        a, (node, shared, _) = self.arrays, self.arrays.start
        width = node.shape[1]
        parts = [
            width * a.first_node[:, None] + np.arange(ACTING * width),  # neighbouring nodes are neighbouring columns
            np.broadcast_to(node.size + np.arange(MOUNT), (len(a.view), MOUNT)),
            node.size + MOUNT + DEFORMATION * a.view[:, None] + np.arange(DEFORMATION),
            node.size + shared.size + 3 * a.point[:, None] + np.arange(3),
        ]
        column = np.repeat(np.concatenate(parts, axis=1)[:, None], 2, axis=1)
        wanted = self.free[column]
        unknown = (np.cumsum(self.free) - 1).astype(np.int32)
        start = np.concatenate([[0], np.cumsum(wanted.sum(axis=-1).ravel())]).astype(np.int32)
        return wanted, unknown[column[wanted]], start

    def jacobian(self, x: np.ndarray) -> Any:
        """Derivatives of the residuals by the unknowns, sparse."""
        a, at = self.arrays, self.solution(x)
        seen = image(a, at)
        b, axes = boresight(at.shared[:3])
        _, from_the_left = rodrigues(seen.turn_rad)
        by_q = np.zeros((len(a.view), 2, 3))  # of (x, y)
        by_q[:, [0, 1], [0, 1]] = -a.focal_px / seen.q[:, 2:]
        by_q[:, :, 2] = -seen.image_px / seen.q[:, 2:]
        # A turn by d about axis w of the frame in which the point is p shifts it by p x w d.
        at_imu = by_q @ b.T
        at_body = at_imu @ a.body_from_imu.T @ seen.turn.transpose(0, 2, 1)
        by_motion = np.concatenate([at_body @ skew(seen.from_body) @ from_the_left, -at_body], axis=-1)
        by_mount = np.concatenate([at_imu @ skew(seen.imu) @ axes, -by_q], axis=-1)
        by_point = at_body @ rotation_from_quaternion(a.quaternion_xyzw).transpose(0, 2, 1)
        image_by = np.concatenate(
            [(a.weight[:, None, :, None] * by_motion[:, :, None]).reshape(len(a.view), 2, -1), by_mount, by_point], axis=-1
        )
        u = seen.s_px / a.half_width_px
        power = np.stack([np.ones_like(u), u, u * u, u**3], -1)
        slope = np.einsum("rak,rk->ra", deformation(a, at.shared)[:, :, 1:], power[:, :3] * [1, 2, 3]) / a.half_width_px
        s_by_y = 1 / (1 + slope[:, 0])
        pixel_by = np.empty_like(image_by)
        pixel_by[:, 0] = s_by_y[:, None] * image_by[:, 1]
        pixel_by[:, 1] = image_by[:, 0] - slope[:, 1, None] * pixel_by[:, 0]
        by_deformation = np.zeros((len(a.view), 2, DEFORMATION))
        by_deformation[:, 0, :4] = -s_by_y[:, None] * power
        by_deformation[:, 1, :4] = -slope[:, 1, None] * by_deformation[:, 0, :4]
        by_deformation[:, 1, 4:] = -power
        rows = np.concatenate([pixel_by[:, :, :-3], by_deformation, pixel_by[:, :, -3:]], axis=-1)
        rows /= -a.sigma_px[:, :, None]
        wanted, column, start = self._pattern
        of_rays = sparse.csr_array((rows[wanted], column, start), shape=(2 * len(a.view), x.size))
        return sparse.vstack([of_rays, self._priors], format="csr")

    def solve(self, iterations: int | None = None, tolerance: float = 1e-12) -> ScipyAnswer:
        """By trust regions in the plane of the gradient and LSMR's Gauss-Newton step, scaled by the columns of the Jacobian.

        **Arguments**: iterations: steps tried at most; tolerance: on cost, gradient and step.
        """
        jacobian: Any = self.jacobian  # scipy's annotations know no sparse derivatives
        start_cpu = time.process_time()
        found = least_squares(
            self.residual,
            self.all_start[self.free],
            jac=jacobian,
            method="trf",
            tr_solver="lsmr",
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            tr_options=LSMR,
            max_nfev=None if iterations is None else iterations + 1,
        )
        return ScipyAnswer(found.cost, found.nfev - 1, time.process_time() - start_cpu, self.solution(found.x))
