"""ceres_block.cpp called with numpy arrays: the block adjustment of a three-line camera.

What every peer of this problem is given, and the residuals in plain numpy. World, body, IMU and camera frames, the chain between
them and the parameters are those in the header of ceres_block.cpp. Lengths are in metres, angles in radians, pixels are (sample,
line offset).
"""

import json
import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from .. import one_thread
from .build import ceres_program

Derivatives = Literal["nodes", "motion"]

ACTING, MOUNT, DEFORMATION = 4, 6, 8  # nodes that act on a ray; parameters of the mount and of the deformation of a view


class Solution(NamedTuple):
    """The parameters.

    **Arguments**: node (nodes, 6): turn and shift; shared (6 + 8 views,): boresight angles ex, ey, ez and the camera's place
    behind them, then for each view the coefficients of 1, s, s^2, s^3 along and across the line, px; point_m (points, 3).
    """

    node: np.ndarray
    shared: np.ndarray
    point_m: np.ndarray


@dataclass(frozen=True)
class BlockArrays:
    """A block adjustment in numbers: whitened residuals of rays, control points, nodes and shared parameters.

    **Arguments** (rays, points, nodes, views; controls: control points; rows, entries: of the prior of the nodes):

    - `focal_px`, `principal_sample_px`, `half_width_px`: of the lines of all views; `offset_px` (views,).
    - `body_from_imu` (3, 3): a signed permutation.
    - `quaternion_xyzw` (rays, 4), `position_m` (rays, 3): the base pose world_from_body of each ray.
    - `first_node` (rays,), `weight` (rays, 4): the four neighbouring nodes that act on a ray, and how much.
    - `view`, `point` (rays,); `pixel_px`, `sigma_px` (rays, 2): what is measured, and its 1-sigma.
    - `start`: where the adjustment begins.
    - `shared_held` (6 + 8 views,): True for what stays as it starts; `shared_mean`, `shared_sigma`: prior, sigma 0 for none.
    - `prior_start` (rows + 1,), `prior_axis` (rows,), `prior_node`, `prior_coefficient` (entries,): row k is the residual
      sum coefficient * node[., axis k] over the entries prior_start[k] to prior_start[k + 1].
    - `control` (controls,), `control_m` (controls, 3), `control_whitening` (controls, 3, 3): the points that are known, their
      coordinates, and L^-1 of their covariance L L^T.
    """

    focal_px: float
    principal_sample_px: float
    half_width_px: float
    offset_px: np.ndarray
    body_from_imu: np.ndarray
    quaternion_xyzw: np.ndarray
    position_m: np.ndarray
    first_node: np.ndarray
    weight: np.ndarray
    view: np.ndarray
    point: np.ndarray
    pixel_px: np.ndarray
    sigma_px: np.ndarray
    start: Solution
    shared_held: np.ndarray
    shared_mean: np.ndarray
    shared_sigma: np.ndarray
    prior_start: np.ndarray
    prior_axis: np.ndarray
    prior_node: np.ndarray
    prior_coefficient: np.ndarray
    control: np.ndarray
    control_m: np.ndarray
    control_whitening: np.ndarray

    def write(self, path: Path) -> None:
        """Seven counts as int64, then the floats as float64 and the indices as int32, in the order ceres_block.cpp reads.

        **Raises:** `ValueError` for an array of another shape than it says, which would be read as something else.
        """
        node, shared, point_m = self.start
        rays, rows, views = len(self.point), len(self.prior_axis), len(self.offset_px)
        counts = rays, len(point_m), len(node), views, rows, len(self.prior_node), len(self.control)
        camera = np.r_[self.focal_px, self.principal_sample_px, self.half_width_px, self.body_from_imu.ravel()]
        floats = {
            "offset_px": (views,), "quaternion_xyzw": (rays, 4), "position_m": (rays, 3), "weight": (rays, ACTING),
            "pixel_px": (rays, 2), "sigma_px": (rays, 2),
        }  # fmt: skip
        more = {
            "shared_mean": shared.shape, "shared_sigma": shared.shape, "prior_coefficient": self.prior_node.shape,
            "control_m": (len(self.control), 3), "control_whitening": (len(self.control), 3, 3),
        }  # fmt: skip
        indices = {
            "first_node": (rays,), "view": (rays,), "point": (rays,), "shared_held": shared.shape, "prior_start": (rows + 1,),
            "prior_axis": (rows,), "prior_node": self.prior_node.shape, "control": self.control.shape,
        }  # fmt: skip
        for name, shape in (floats | more | indices).items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {shape}")
        axes = self.body_from_imu
        if not (np.isin(axes, (-1, 0, 1)).all() and np.array_equal(axes @ axes.T, np.eye(3))):
            raise ValueError(f"body_from_imu is no signed permutation: {axes.tolist()}")
        with open(path, "wb") as file:
            np.array(counts, np.int64).tofile(file)
            values = [camera, *(getattr(self, n) for n in floats), *self.start, *(getattr(self, n) for n in more)]
            for value in values:
                np.asarray(value, np.float64).tofile(file)
            for name in indices:
                getattr(self, name).astype(np.int32).tofile(file)


@dataclass(frozen=True)
class CeresAnswer:
    """What Ceres found, and what it took.

    **Arguments**: costs are half the sum of squared residuals; iterations: steps tried; cpu_s: of all of ceres::Solve;
    step_s: CPU time of the fastest iteration that gained something, free of what is prepared once; the shares of the time of
    ceres::Solve that went into preparing the problem, Jacobians, linear algebra and costs alone; peak_gb: peak resident memory of
    the process; library: which Ceres, with what.
    """

    initial_cost: float
    final_cost: float
    iterations: int
    converged: bool
    cpu_s: float
    step_s: float
    preprocessor_share: float
    jacobian_share: float
    linear_solver_share: float
    residual_share: float
    peak_gb: float
    library: str
    solution: Solution

    @property
    def cpu_per_iteration_s(self) -> float:
        """CPU time of ceres::Solve over its iterations."""
        return self.cpu_s / self.iterations


def run(
    arrays: BlockArrays,
    iterations: int = 50,
    tolerances: tuple[float, float, float] = (1e-14, 1e-14, 1e-14),
    derivatives: Derivatives = "motion",
) -> CeresAnswer:
    """The adjustment by Levenberg-Marquardt on one thread, in a process of its own.

    **Arguments**: iterations: at most; tolerances: of Ceres on cost, gradient and parameters; zeros make all iterations;
    derivatives: by what the Jets of a ray differentiate, its four nodes or its own motion, which is faster.

    **Raises:** `NotInstalled` where libceres-dev is missing; `RuntimeError` with what the process said where it fails.
    """
    program = ceres_program("ceres_block")
    node, shared, point_m = arrays.start
    with tempfile.TemporaryDirectory() as folder:
        problem, solution = Path(folder) / "problem", Path(folder) / "solution"
        arrays.write(problem)
        done = subprocess.run(
            [program, problem, str(iterations), *map(repr, tolerances), derivatives, solution],
            env=os.environ | one_thread.ENVIRONMENT,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(f"{program.name} failed:\n{done.stderr}")
        values = np.split(np.fromfile(solution), np.cumsum([node.size, shared.size]))
    return CeresAnswer(
        **json.loads(done.stdout), solution=Solution(values[0].reshape(node.shape), values[1], values[2].reshape(point_m.shape))
    )


class Imaged(NamedTuple):
    """A ray's pixel and what led to it.

    **Arguments**: from_body (rays, 3): the point in the body frame less the shift; turn_rad (rays, 3) and turn (rays, 3, 3), its
    rotation; imu (rays, 3): the point in the IMU's axes; q (rays, 3) in the camera's; image_px (rays, 2): x and y; s_px (rays,):
    the centred sample; pixel_px (rays, 2).
    """

    from_body: np.ndarray
    turn_rad: np.ndarray
    turn: np.ndarray
    imu: np.ndarray
    q: np.ndarray
    image_px: np.ndarray
    s_px: np.ndarray
    pixel_px: np.ndarray


def rotation_from_quaternion(q: np.ndarray) -> np.ndarray:
    """(..., 3, 3) of unit quaternions x, y, z, w (..., 4)."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def skew(v: np.ndarray) -> np.ndarray:
    """[v]x, (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), (0, 1), (-2, -1))


def rodrigues(turn_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """exp([turn]x), and J with exp([turn + d]x) = exp([J d]x) exp([turn]x) to first order, (..., 3, 3) each."""
    squared = np.sum(turn_rad**2, axis=-1)[..., None, None]
    small = squared < 1e-6
    angle = np.sqrt(np.where(small, 1.0, squared))
    # sin(a) / a, (1 - cos a) / a^2 and (a - sin a) / a^3; the next terms of their series are below 1e-16 here.
    first = np.where(small, 1 - squared / 6 * (1 - squared / 20), np.sin(angle) / angle)
    second = np.where(small, 0.5 - squared / 24 * (1 - squared / 30), (1 - np.cos(angle)) / angle**2)
    third = np.where(small, 1 / 6 - squared / 120 * (1 - squared / 42), (angle - np.sin(angle)) / angle**3)
    k = skew(turn_rad)
    kk, one = k @ k, np.eye(3)
    return one + first * k + second * kk, one + second * k + third * kk


def boresight(angles_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rx(ex) Ry(ey) Rz(ez), and as columns the axes about which each angle turns it, (3, 3) each."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(angles_rad), np.cos(angles_rad)
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    xy = x @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return xy @ np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]), np.stack([np.eye(3)[0], x[:, 1], xy[:, 2]], -1)


def deformation(arrays: BlockArrays, shared: np.ndarray) -> np.ndarray:
    """Coefficients of each ray's view, (rays, 2, 4): along and across the line."""
    return shared[MOUNT:].reshape(-1, 2, 4)[arrays.view]


def cubic(coefficients: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The sum of c_k u^k over the last axis."""
    c0, c1, c2, c3 = np.moveaxis(coefficients, -1, 0)
    return c0 + u * (c1 + u * (c2 + u * c3))


def image(arrays: BlockArrays, at: Solution) -> Imaged:
    """Every ray's point through the chain."""
    acting = at.node[arrays.first_node[:, None] + np.arange(ACTING)]
    turn_rad, shift_m = np.split(np.einsum("rk,rka->ra", arrays.weight, acting), 2, axis=-1)
    turn, _ = rodrigues(turn_rad)
    rotation = rotation_from_quaternion(arrays.quaternion_xyzw)
    from_body = np.einsum("rji,rj->ri", rotation, at.point_m[arrays.point] - arrays.position_m) - shift_m
    imu = np.einsum("rji,rj->ri", turn, from_body) @ arrays.body_from_imu
    q = imu @ boresight(at.shared[:3])[0] - at.shared[3:MOUNT]
    image_px = -arrays.focal_px * q[:, :2] / q[:, 2:]
    coefficients = deformation(arrays, at.shared)
    s_px = image_px[:, 1]
    for _ in range(6):  # each step leaves some thousandths of the error
        s_px = image_px[:, 1] - cubic(coefficients[:, 0], s_px / arrays.half_width_px)
    offset_px = image_px[:, 0] - arrays.offset_px[arrays.view] - cubic(coefficients[:, 1], s_px / arrays.half_width_px)
    pixel_px = np.stack([arrays.principal_sample_px + s_px, offset_px], -1)
    return Imaged(from_body, turn_rad, turn, imu, q, image_px, s_px, pixel_px)


def residual(arrays: BlockArrays, at: Solution) -> np.ndarray:
    """Whitened: of the rays measured - projected, then the priors of nodes, control points and shared parameters."""
    of_rays = (arrays.pixel_px - image(arrays, at).pixel_px) / arrays.sigma_px
    row = np.repeat(np.arange(len(arrays.prior_axis)), np.diff(arrays.prior_start))
    terms = arrays.prior_coefficient * at.node[arrays.prior_node, arrays.prior_axis[row]]
    of_nodes = np.bincount(row, terms, minlength=len(arrays.prior_axis))
    of_controls = np.einsum("cij,cj->ci", arrays.control_whitening, at.point_m[arrays.control] - arrays.control_m)
    known = arrays.shared_sigma > 0
    of_shared = (at.shared - arrays.shared_mean)[known] / arrays.shared_sigma[known]
    return np.concatenate([of_rays.ravel(), of_nodes, of_controls.ravel(), of_shared])
