"""One calibration of 15 unknowns from 130 points, against Gauss-Newton in C++ written for the whiskbroom scanner alone.

Both start from the priors and take the same number of steps on poses that were evaluated beforehand; on both sides the arguments
are prepared, so that neither is charged for the way they are passed. What was asked of is the same algorithm on both sides;
Levenberg-Marquardt, with its QR factors and tests of every step, stands beside it for information.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from whiskjax.estimate.least_squares import gauss_newton, levenberg_marquardt
from whiskjax.estimate.problem import Problem, pose_problem, weigh

from . import peers
from .suite import benchmark
from .timing import Measured, compiled, race
from .whiskbroom import baked_for_peer, control_points, recorded

STEPS = 5
SAME_SIGMA = 1e-9  # of a prior sigma, after the same steps
SAME_MINIMUM_SIGMA = 1e-5


def _problem(split: bool) -> tuple[Problem, jax.Array]:
    flight, observed = recorded(), control_points()
    weight = np.stack([1 / observed.sigma_px[:, 0], np.zeros(len(observed)), 1 / observed.sigma_px[:, 1]], -1)
    problem, start, indices = pose_problem(flight.sensor, observed, flight.unknowns, split=split)
    return weigh(problem.baked(), weight, indices), jnp.asarray(start)


def _race(solve: Callable[[Problem], Any], problem: Problem, steps: int, same: float) -> Measured:
    arrays, static = eqx.partition(problem, eqx.is_array)
    leaves, tree = jax.tree.flatten(arrays)
    ours, compile_s = compiled(lambda leaves: solve(eqx.combine(jax.tree.unflatten(tree, leaves), static)), leaves)
    mean, sigma = np.array(problem.unknowns.mean), np.array(problem.unknowns.scale)
    peer = peers.prepared_gauss_newton(baked_for_peer(control_points()), mean, sigma, steps)
    np.testing.assert_allclose(ours(leaves), (peer() - mean) / sigma, rtol=0, atol=same)
    return race(lambda: ours(leaves), peer, compile_s=compile_s, note=f"{steps} steps each")


@benchmark(
    "calibration.gauss_newton",
    what="one calibration of 15 unknowns from 130 points, 5 Gauss-Newton steps",
    peer="C++ -O3, Eigen",
    asked=2.5,
)
def by_gauss_newton() -> Measured:
    problem, start = _problem(split=True)
    return _race(lambda problem: gauss_newton(problem, start, STEPS), problem, STEPS, SAME_SIGMA)


@benchmark(
    "calibration.levenberg_marquardt",
    what="the same by optimistix's Levenberg-Marquardt, as `calibrate` does it",
    peer="C++ -O3, Eigen",
    asked=None,
)
def by_levenberg_marquardt() -> Measured:
    problem, start = _problem(split=False)
    steps = int(levenberg_marquardt(problem, start).steps)
    return _race(lambda problem: levenberg_marquardt(problem, start).u, problem, steps, SAME_MINIMUM_SIGMA)
