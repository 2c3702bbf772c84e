"""The peers of the block adjustment against whiskjax's chain and scipy's dense solver: a benchmark against a wrong program would
measure nothing."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import whiskjax as wj
from benchmarks.peers import build, ceres_block
from benchmarks.peers.ceres_block import BlockArrays, Solution
from benchmarks.peers.scipy_block import ScipyBlock

FOCAL_PX, PRINCIPAL_PX, HALF_PX = 26_000.0, 16_377.5, 16_378.0
VIEWS = {"forward": 27.0, "nadir": 0.0, "backward": -14.0}
OFFSET_PX = FOCAL_PX * np.tan(np.radians(list(VIEWS.values())))
HEIGHT_M, SPEED_MPS = 2450.0, 60.0
HEADINGS_DEG, SIDE_M = [0.0, 90.0, 180.0, 270.0], 875.0  # of strips, counter-clockwise from x; how far each is from the centre
TURN_SIGMA, SHIFT_SIGMA = np.radians([0.005, 0.005, 0.01]), np.array([0.05, 0.05, 0.08])
CORRELATION_S = np.array([60.0, 60.0, 120.0, 300.0, 300.0, 300.0])
MOUNT = np.r_[np.radians([0.2, -0.3, 0.5]), 0.1, -0.4, -1.2]
DEFORMATION_PX = np.array(
    [[[5, 9, 4, -2], [-3, 3, 2, 1.5]], [[0, 0, 3, 1.5], [0, 2, -2, 1]], [[-6, -8, -3, 2], [4, -3, 1, -1.5]]]
)
HELD = np.r_[np.zeros(6), np.zeros(8), 1, 1, 0, 0, 1, 0, 0, 0, np.zeros(8)].astype(bool)  # nadir: shifts and scale along


def lagrange(time_s, spacing_s, nodes):
    """First of the four nodes nearest to each time, and the weights of the cubic through them."""
    x = time_s / spacing_s
    first = np.clip(np.floor(x).astype(int) - 1, 0, nodes - 4)
    at = (x - first)[:, None]
    others = [[m for m in range(4) if m != k] for k in range(4)]
    return first, np.stack([np.prod((at - o) / (k - np.array(o)), axis=1) for k, o in enumerate(others)], -1)


def made_up(strips, nodes, spacing_s, points, field_m, controls, seed):
    """Strips that cross in the middle of a square field, each point seen by the three lines of every strip over it.

    Returns the arrays, time and strip of each ray, and the truth.
    """
    rng = np.random.default_rng(seed)
    duration_s = spacing_s * (nodes - 1)
    heading = np.radians(HEADINGS_DEG[:strips])
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], -1)
    spread = rng.uniform(-field_m, field_m, (20 * points, 2))
    covers = np.abs(spread @ left.T + SIDE_M) < 1300.0  # half a line is 1279 m wide on the mean ground
    keep = np.flatnonzero(covers.any(axis=1))[:points]
    assert len(keep) == points
    z = 420 + 110 * np.sin(spread[keep, 0] / 900) * np.cos(spread[keep, 1] / 1100)
    point_m = np.column_stack([spread[keep], z])
    point, strip, view = (i.ravel() for i in np.nonzero(np.repeat(covers[keep][:, :, None], 3, axis=2)))
    reach = (HEIGHT_M - point_m[point, 2]) * np.tan(np.radians(list(VIEWS.values())))[view]
    along = np.sum(point_m[point, :2] * ahead[strip], axis=1) - reach
    time_s = duration_s / 2 + along / SPEED_MPS
    assert time_s.min() > 0 and time_s.max() < duration_s
    first, weight = lagrange(time_s, spacing_s, nodes)

    # The body looks ahead, right and down; its attitude sways by a degree, faster than the nodes could follow.
    sway = np.radians(1.0) * np.stack([np.sin(time_s / p + strip) for p in (2.0, 3.0, 5.0)], -1)
    level = Rotation.from_rotvec(heading[strip, None] * [0, 0, 1]) * Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    quaternion = (level * Rotation.from_rotvec(sway)).as_quat()
    centre = along[:, None] * ahead[strip] - SIDE_M * left[strip]
    position_m = np.column_stack([centre, HEIGHT_M + 3 * np.sin(time_s / 7)])

    sigma = np.r_[TURN_SIGMA, SHIFT_SIGMA]
    rho = np.exp(-spacing_s / CORRELATION_S)
    node = sigma * rng.normal(size=(strips, nodes, 6))
    for k in range(1, nodes):
        node[:, k] = rho * node[:, k - 1] + np.sqrt(1 - rho**2) * node[:, k]
    axis, at, before = (i.ravel() for i in np.meshgrid(np.arange(6), np.arange(strips * nodes), [True, False], indexing="ij"))
    chained = at % nodes > 0
    per_sigma = 1 / (sigma[axis] * np.where(chained, np.sqrt(1 - rho[axis] ** 2), 1.0))
    coefficient = np.where(before, -rho[axis], 1.0) * per_sigma
    used = chained | ~before
    row = (axis * strips * nodes + at)[used]

    control = np.arange(controls)
    spread_m = np.linalg.cholesky(np.array([[9.0, 2.0, 1.0], [2.0, 9.0, -1.0], [1.0, -1.0, 16.0]]) * 1e-4)
    control_m = point_m[control] + rng.normal(size=(controls, 3)) @ spread_m.T
    shared = np.r_[MOUNT, DEFORMATION_PX.ravel()]
    shared_mean = np.r_[np.zeros(6), DEFORMATION_PX.ravel() + 0.5]
    sigma_px = np.where(point[:, None] < controls, 0.3, 0.5) * [1.0, 1.2]
    start = Solution(
        np.zeros((strips * nodes, 6)), np.where(HELD, shared, shared_mean), point_m + rng.normal(0, 3, point_m.shape)
    )
    arrays = BlockArrays(
        FOCAL_PX, PRINCIPAL_PX, HALF_PX, OFFSET_PX, np.diag([1.0, -1.0, -1.0]), quaternion, position_m,
        first + nodes * strip, weight, view, point, np.zeros_like(sigma_px), sigma_px, start,
        HELD, shared_mean, np.r_[np.radians([1.0, 1.0, 1.0]), 1, 1, 0, np.full(24, 5.0)],
        np.r_[0, np.cumsum(np.bincount(row))], np.repeat(np.arange(6), strips * nodes),
        at[used] - before[used], coefficient[used], control, control_m, np.tile(np.linalg.inv(spread_m), (controls, 1, 1)),
    )  # fmt: skip
    truth = Solution(node.reshape(-1, 6), shared, point_m)
    noise_px = sigma_px * rng.normal(size=sigma_px.shape)
    return replace(arrays, pixel_px=ceres_block.image(arrays, truth).pixel_px + noise_px), time_s, strip, truth


NODES, SPACING_S = 12, 7.0


@pytest.fixture(scope="module")
def block():
    """Two crossing strips; 40 points, about 200 rays."""
    return made_up(2, NODES, SPACING_S, points=40, field_m=800.0, controls=6, seed=3)


@pytest.fixture(scope="module")
def dense(block):
    """The adjustment by scipy's dense solver with differences in place of derivatives."""
    solver = ScipyBlock(block[0])
    start = solver.all_start[solver.free]
    return least_squares(solver.residual, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)


def test_the_arrays_are_as_large_as_they_say(block):
    arrays, *_ = block
    assert 180 <= len(arrays.point) <= 240
    assert set(np.bincount(arrays.point)) == {3, 6}


def test_numpy_images_as_whiskjax(block):
    arrays, time_s, strip, truth = block
    seen = ceres_block.image(arrays, truth).pixel_px
    assert np.abs(seen[:, 1]).max() > 50  # the boresight is worth many pixels
    camera = wj.By(
        "view",
        {
            name: wj.LineCamera(FOCAL_PX, PRINCIPAL_PX, offset, deformation_px=bend, half_width_px=HALF_PX, along="y")
            for name, offset, bend in zip(VIEWS, OFFSET_PX, DEFORMATION_PX, strict=True)
        },
    )
    for k in range(2):
        mine = np.flatnonzero(strip == k)
        mine = mine[np.argsort(time_s[mine])]
        at_s, (turn, shift) = time_s[mine], np.split(truth.node[NODES * k : NODES * (k + 1)], 2, axis=1)
        links = {
            "body": wj.Trajectory(at_s, arrays.position_m[mine], arrays.quaternion_xyzw[mine], max_gap_s=1e3),
            "pos_error": wj.Correction(wj.OrientationImages(0.0, SPACING_S, NODES), turn, shift),
            "imu": wj.Axes("x -y -z"),
            "boresight": wj.Mount(angles_rad=MOUNT[:3]),
            "lever": wj.Mount(lever_arm_m=MOUNT[3:]),
        }
        shot = wj.Shot(time_s=at_s, view=arrays.view[mine])
        found = wj.project(wj.Sensor(links, camera), shot, truth.point_m[arrays.point[mine]])
        np.testing.assert_allclose(found.pixel_px, seen[mine], rtol=0, atol=1e-9)


def test_residuals_of_the_truth_are_noise(block):
    arrays, *_, truth = block
    whitened = ceres_block.residual(arrays, truth)[: 2 * len(arrays.point) + len(arrays.prior_axis)]
    assert 0.9 < np.std(whitened) < 1.1


def test_priors_are_those_of_the_textbook(block):
    """An Ornstein-Uhlenbeck chain per strip and axis, a Gaussian per control point and shared parameter."""
    arrays, *_, truth = block
    expected = []
    for axis, sigma in enumerate([*TURN_SIGMA, *SHIFT_SIGMA]):
        lag = SPACING_S * np.abs(np.subtract.outer(np.arange(NODES), np.arange(NODES)))
        covariance = sigma**2 * np.exp(-lag / CORRELATION_S[axis])
        for k in range(2):
            v = truth.node[NODES * k : NODES * (k + 1), axis]
            expected.append(v @ np.linalg.solve(covariance, v))
    rays, chains = 2 * len(arrays.point), 6 * 2 * NODES
    whitened = ceres_block.residual(arrays, truth)
    of_nodes, of_controls, of_shared = np.split(whitened[rays:], [chains, chains + 3 * len(arrays.control)])
    np.testing.assert_allclose(np.sum(of_nodes.reshape(-1, NODES) ** 2, axis=1), expected, rtol=1e-10)
    off = truth.point_m[arrays.control] - arrays.control_m
    covariance = np.array([[9.0, 2.0, 1.0], [2.0, 9.0, -1.0], [1.0, -1.0, 16.0]]) * 1e-4
    mahalanobis = [d @ np.linalg.solve(covariance, d) for d in off]
    np.testing.assert_allclose(np.sum(of_controls.reshape(-1, 3) ** 2, axis=1), mahalanobis, rtol=1e-10)
    assert of_shared.size == 29  # one of the 30 has no prior


def test_scipy_has_the_right_derivatives(block):
    """By central differences, at large turns and deformations, where every term shows."""
    arrays, *_, truth = block
    rng = np.random.default_rng(1)
    node = truth.node + rng.normal(0, 0.1, truth.node.shape)
    steep = np.where(HELD, arrays.start.shared, truth.shared * np.r_[np.full(6, 10.0), np.full(24, 20.0)])
    solver = ScipyBlock(replace(arrays, start=Solution(node, steep, truth.point_m)))
    x = solver.all_start[solver.free]
    exact = solver.jacobian(x).toarray()
    assert exact.shape == (len(solver.residual(x)), len(x))
    for column in range(len(x)):
        # Radians are worth 26,000 px each, metres and pixels a hundredth of that and less.
        step = 1e-5 if np.abs(exact[:, column]).max() > 1e4 else 1e-3
        plus, minus = x.copy(), x.copy()
        plus[column] += step
        minus[column] -= step
        numeric = (solver.residual(plus) - solver.residual(minus)) / (plus[column] - minus[column])
        np.testing.assert_allclose(exact[:, column], numeric, rtol=0, atol=2e-6 * max(1.0, np.abs(numeric).max()))


def test_derivatives_at_no_turn_at_all(block):
    arrays, *_ = block
    solver = ScipyBlock(arrays)
    assert not arrays.start.node.any()
    x = solver.all_start[solver.free]
    step = 1e-6 * np.r_[np.ones(arrays.start.node.size), np.zeros(x.size - arrays.start.node.size)]
    moved = (solver.residual(x + step) - solver.residual(x - step)) / 2
    np.testing.assert_allclose(solver.jacobian(x) @ step, moved, rtol=0, atol=1e-6)


def test_scipy_finds_the_minimum_of_the_dense_solver(block, dense):
    answer = ScipyBlock(block[0]).solve(iterations=300)
    np.testing.assert_allclose(answer.final_cost, dense.cost, rtol=1e-9)
    assert answer.iterations > 1 and answer.cpu_per_iteration_s > 0


def test_the_adjustment_comes_back_to_the_truth(block, dense):
    """Each of about 900 residuals is worth half, less what was fitted."""
    arrays, *_, truth = block
    found = ScipyBlock(arrays).solution(dense.x)
    assert 0.7 < 2 * dense.cost / (dense.fun.size - dense.x.size) < 1.4
    assert np.abs(found.point_m - truth.point_m).max() < 0.5
    np.testing.assert_array_equal(found.shared[HELD], truth.shared[HELD])


def ceres_answer(arrays, **settings):
    try:
        return ceres_block.run(arrays, **settings)
    except build.NotInstalled as error:
        pytest.skip(str(error))


def test_ceres_finds_the_minimum_of_the_dense_solver(block, dense):
    arrays, *_ = block
    answer = ceres_answer(arrays)
    assert answer.converged
    np.testing.assert_allclose(answer.initial_cost, np.sum(ceres_block.residual(arrays, arrays.start) ** 2) / 2, rtol=1e-12)
    np.testing.assert_allclose(answer.final_cost, dense.cost, rtol=1e-9)
    # Pixels of 10^4 and places of some km round residuals by about 1e-11, and the cost, a sum of 900 squares, by 1e-11 of itself.
    np.testing.assert_allclose(np.sum(ceres_block.residual(arrays, answer.solution) ** 2) / 2, answer.final_cost, rtol=1e-10)
    found = ScipyBlock(arrays).solution(dense.x)
    np.testing.assert_array_equal(answer.solution.shared[HELD], arrays.start.shared[HELD])
    np.testing.assert_allclose(answer.solution.point_m, found.point_m, rtol=0, atol=1e-4)


def test_ceres_makes_as_many_iterations_as_it_is_told(block):
    answer = ceres_answer(block[0], iterations=2, tolerances=(0.0, 0.0, 0.0))
    assert answer.iterations == 2 and not answer.converged
    assert answer.final_cost < answer.initial_cost
    assert 0 < answer.peak_gb < 0.2
    assert "SPARSE_SCHUR" in answer.library and "SPARSE" in answer.library.split(",")[2]


def test_a_missing_ceres_is_named(monkeypatch):
    missing = subprocess.CompletedProcess([], 1, "", "fatal error: ceres/version.h: No such file or directory")
    monkeypatch.setattr(build.subprocess, "run", lambda *_, **__: missing)
    with pytest.raises(build.NotInstalled, match=r"^libceres-dev is not installed$"):
        build.ceres_program("ceres_block")


def test_arrays_that_ceres_would_misread_are_refused(block, tmp_path):
    arrays, *_ = block
    with pytest.raises(ValueError, match=r"weight has shape \(\d+, 3\), expected \(\d+, 4\)"):
        replace(arrays, weight=arrays.weight[:, :3]).write(tmp_path / "problem")
    with pytest.raises(ValueError, match="body_from_imu is no signed permutation"):
        replace(arrays, body_from_imu=np.full((3, 3), 0.5)).write(tmp_path / "problem")
