"""Thousands of calibrations of 15 unknowns from 130 points: time on one core, and how memory and cores are used.

Every lane has control points, times and noise of its own. C++ solves all lanes in one call, scipy one after the other. As neither
computes covariances, the races are for the solutions alone; what else a lane holds is timed in a line of its own.
"""

import dataclasses
from collections.abc import Callable
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.estimate.lanes import Lanes, solve_lanes
from whiskjax.estimate.problem import Problem, pose_problem, weigh
from whiskjax.flights import haian

from . import one_thread, peers
from .own_process import in_own_process
from .suite import benchmark
from .timing import Measured, compiled, race
from .whiskbroom import baked_for_peer, calibrated, recorded

LANES, STEPS, POINTS = 2000, 5, 65  # points of each swing
SIGMA_PX = 2.0
SAME_SIGMA = 1e-9  # of a prior sigma, after the same steps
SCIPY_LANES = 40
SAME_MINIMUM_SIGMA = 1e-5  # scipy stops where the cost falls by less than 1e-8 of itself
RUNS, FEW_RUNS = 10_000, 2_000


@cache
def _observed(lanes: int) -> wj.Observations:
    """Control points of all lanes, one lane after the other, first of the left and then of the right swing."""
    rng = np.random.default_rng(2024)
    n = lanes * 2 * POINTS
    swing = np.tile(np.repeat([0, 1], POINTS), lanes)
    start_s = np.array([haian.SCENES[name][0] for name in ("L1", "R1")])[swing]
    shot = wj.Shot(time_s=start_s + rng.uniform(0, haian.SWING_S, n), swing=swing)
    pixel_px = np.stack([rng.uniform(-0.95, 0.95, n) * haian.HALF_LINE_PX, np.zeros(n)], -1)
    height_m = haian.GROUND_M + rng.uniform(-haian.GROUND_SPREAD_M, haian.GROUND_SPREAD_M, n)
    point_m = wj.image_to_ground(calibrated(), shot, pixel_px, wj.HeightSurface(jnp.asarray(height_m))).point_m
    surveyed_m = np.asarray(point_m) + rng.normal(0, haian.POINT_SIGMA_M, (n, 3))
    measured_px = pixel_px + rng.normal(0, SIGMA_PX, (n, 2))
    return wj.Observations(shot, surveyed_m, measured_px, np.full((n, 2), SIGMA_PX), np.ones(n, dtype=bool))


def problem_of(lanes: int) -> tuple[Problem, Problem, jax.Array]:
    """What each lane has of its own, what all share, and the start."""
    sensor, unknowns, observed = recorded().sensor, recorded().unknowns, _observed(lanes)
    problem, start, indices = pose_problem(sensor, observed, unknowns)
    problem = weigh(problem.baked(), np.tile([1 / SIGMA_PX, 0, 1 / SIGMA_PX], (len(observed), 1)), indices)
    # Each lane is padded as if it had been posed alone, with points that weigh nothing.
    alone, *_ = pose_problem(sensor, observed.take(np.arange(2 * POINTS)), unknowns)
    padded = np.zeros(len(alone.groups[0].pixel[0]), dtype=int)
    padded[:POINTS] = np.arange(POINTS)
    index = POINTS * np.arange(lanes)[:, None] + padded
    groups = jax.tree.map(lambda a: a[index] if eqx.is_array(a) else a, problem.groups)
    groups = tuple(
        eqx.tree_at(lambda g: g.weight, g, tuple(jnp.asarray(w).at[:, POINTS:].set(0.0) for w in g.weight)) for g in groups
    )
    nothing = jax.tree.map(lambda _: None, problem)
    own = eqx.tree_at(lambda p: p.groups, nothing, groups)
    common = eqx.tree_at(lambda p: p.groups, problem, nothing.groups)
    return own, common, jnp.asarray(start)


@cache
def baked(lanes: int) -> peers.Baked:
    """The same lanes for the peers."""
    return baked_for_peer(_observed(lanes)).each(lambda a: a.reshape(lanes, 2 * POINTS, *a.shape[1:]))


def prior() -> tuple[np.ndarray, np.ndarray]:
    """Mean and sigma of the unknowns."""
    unknowns = recorded().unknowns
    return np.array([x.mean for x in unknowns]), np.array([x.sigma for x in unknowns])


def _solver(of: Callable[[Lanes], object]) -> tuple[Callable[[], object], float]:
    """A prepared call that solves all lanes and returns what is asked of them; the seconds that compiling took."""
    own, common, start = problem_of(LANES)
    arrays, static = eqx.partition((own, common), eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)

    def solve(leaves):
        own, common = eqx.combine(jax.tree.unflatten(tree, leaves), static)
        return of(solve_lanes(own, start, STEPS, common=common))

    executable, compile_s = compiled(solve, leaves)
    return lambda: executable(leaves), compile_s


def _against_cxx(of: Callable[[Lanes], object]) -> Measured:
    ours, compile_s = _solver(of)
    mean, sigma = prior()
    peer = peers.prepared_gauss_newton(baked(LANES), mean, sigma, STEPS)
    u = jax.tree.leaves(ours())[0]
    np.testing.assert_allclose(u, (peer() - mean) / sigma, rtol=0, atol=SAME_SIGMA)
    return race(ours, peer, items=LANES, compile_s=compile_s, note=f"{STEPS} steps each")


@benchmark("calibrations_2000", what="2000 calibrations of 15 unknowns from 130 points", peer="C++ -O3, Eigen", asked=1.2)
def calibrations() -> Measured:
    return _against_cxx(lambda lanes: lanes.u)


@benchmark(
    "calibrations_2000.with_covariance",
    what="the same with covariance, cost, residuals and result code",
    peer="C++ -O3, Eigen",
    asked=None,
)
def with_covariance() -> Measured:
    found = _against_cxx(lambda lanes: lanes)
    return dataclasses.replace(found, note=f"{found.note}; ours with covariance, cost, residuals, result")


@benchmark(
    "calibrations_2000.scipy", what="the same against a loop over scipy's least squares", peer="scipy, analytic", asked=0.02
)
def against_scipy() -> Measured:
    from .peers.scipy_calibration import ScipyCalibration

    ours, compile_s = _solver(lambda lanes: lanes.u)
    few = [baked(LANES).each(lambda a, i=i: a[i]) for i in range(SCIPY_LANES)]
    mean, sigma = prior()

    def peer() -> list[np.ndarray]:
        return [ScipyCalibration(lane, mean, sigma).solve() for lane in few]

    np.testing.assert_allclose(np.asarray(ours())[:SCIPY_LANES], peer(), rtol=0, atol=SAME_MINIMUM_SIGMA)
    found = race(ours, peer, items=LANES, compile_s=compile_s)
    share = SCIPY_LANES / LANES
    return dataclasses.replace(
        found,
        reached=found.reached * share,
        median=found.median * share,
        wall=found.wall * share,
        peer_s=found.peer_s / share,
        note=f"{1 / (found.reached * share):.0f} times as fast; scipy timed on {SCIPY_LANES} lanes",
    )


def _many(runs: int, repeats: int, cores: set[int]) -> dict[str, float]:
    """Wall clock (of the fastest repetition) and peak memory of as many runs in a new process."""
    return in_own_process("many_runs", str(runs), str(repeats), ",".join(map(str, cores)))


@benchmark("calibrations_10000.memory", what="10,000 calibrations: peak memory of the process", peer="-", asked=2.0, unit="GB")
def memory() -> Measured:
    many, few = (_many(runs, 2, one_thread.CORES)["peak_gb"] for runs in (RUNS, FEW_RUNS))
    note = f"peak of a process that makes {RUNS} runs twice, from import to end; with {FEW_RUNS} runs {few:.2f} GB"
    return Measured(reached=many, note=note)


@benchmark(
    "calibrations_2000.both_cores", what="2000 calibrations on two cores over one, wall clock", peer="one core", asked=0.65
)
def both_cores() -> Measured:
    cores = sorted(one_thread.CORES)
    if len(cores) < 2:
        return Measured(reached=0.0, note="there is one core only: not measured")
    one, two = (_many(FEW_RUNS, 20, set(some))["wall_s"] for some in (cores[-1:], cores[-2:]))
    return Measured(reached=two / one, ours_s=two, peer_s=one, items=FEW_RUNS, note="wall clock of calibrate_redrawn")
