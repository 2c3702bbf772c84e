"""One calibration of 15 unknowns from 130 points, against Gauss-Newton in C++ written for the whiskbroom scanner alone.

Both start from the priors and take the same number of steps on poses that were evaluated beforehand. What was asked of is the
same algorithm on both sides; Levenberg-Marquardt, with its QR factors and tests of every step, stands beside it for information.
"""

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
SAME_SIGMA = 1e-6  # of a prior sigma, after the same steps
SAME_MINIMUM_SIGMA = 1e-5


def _problem(split: bool) -> tuple[Problem, jax.Array]:
    flight, observed = recorded(), control_points()
    weight = np.stack([1 / observed.sigma_px[:, 0], np.zeros(len(observed)), 1 / observed.sigma_px[:, 1]], -1)
    problem, start, indices = pose_problem(flight.sensor, observed, flight.unknowns, split=split)
    return weigh(problem.baked(), weight, indices), jnp.asarray(start)


def _peer(problem: Problem, steps: int):
    observed = baked_for_peer(control_points())
    mean, sigma = np.array(problem.mean), np.array(problem.scale)
    return lambda: (peers.gauss_newton(observed, mean, sigma, steps) - mean) / sigma


@benchmark("calibration.gauss_newton", peer="C++ -O3", asked=3.0)
def by_gauss_newton() -> Measured:
    problem, start = _problem(split=True)
    arrays, static = eqx.partition(problem, eqx.is_array)

    def solve(arrays, start):
        return gauss_newton(eqx.combine(arrays, static), start, STEPS)

    executable, compile_s = compiled(solve, arrays, start)
    peer = _peer(problem, STEPS)
    np.testing.assert_allclose(executable(arrays, start), peer(), rtol=0, atol=SAME_SIGMA)
    return race(lambda: executable(arrays, start), peer, compile_s=compile_s, note=f"{STEPS} steps")


@benchmark("calibration.levenberg_marquardt", peer="C++ -O3", asked=None)
def by_levenberg_marquardt() -> Measured:
    problem, start = _problem(split=False)
    arrays, static = eqx.partition(problem, eqx.is_array)

    def solve(arrays, start):
        solved = levenberg_marquardt(eqx.combine(arrays, static), start)
        return solved.u, solved.steps

    executable, compile_s = compiled(solve, arrays, start)
    u, steps = executable(arrays, start)
    peer = _peer(problem, int(steps))
    np.testing.assert_allclose(u, peer(), rtol=0, atol=SAME_MINIMUM_SIGMA)
    return race(lambda: executable(arrays, start), peer, compile_s=compile_s, note=f"{int(steps)} steps each")
