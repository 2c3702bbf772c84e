"""The lanes that are raced: each is another calibration, and ours, C++ and scipy are given the same ones."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import batch, peers
from benchmarks.peers.scipy_calibration import ScipyCalibration
from whiskjax.estimate.columns import columns
from whiskjax.estimate.lanes import solve_lanes

LANES = 3


@pytest.fixture(scope="module")
def lanes():
    return batch.problem_of(LANES)


def test_lanes_are_other_calibrations_and_the_same_for_all(lanes):
    own, common, start = lanes
    u = solve_lanes(own, start, batch.STEPS, common=common).u
    assert np.abs(np.diff(u, axis=0)).max(axis=1).min() > 0.1  # other points and other noise
    mean, sigma = batch.prior()
    cxx = (peers.gauss_newton(batch.baked(LANES), mean, sigma, batch.STEPS) - mean) / sigma
    np.testing.assert_allclose(u, cxx, rtol=0, atol=batch.SAME_SIGMA)
    scipy = [ScipyCalibration(batch.baked(LANES).each(lambda a, i=i: a[i]), mean, sigma).solve() for i in range(LANES)]
    np.testing.assert_allclose(u, scipy, rtol=0, atol=batch.SAME_MINIMUM_SIGMA)


def test_the_analytic_jacobian_of_the_scipy_peer_is_ours(lanes):
    own, common, _ = lanes
    i, u = 1, np.random.default_rng(5).normal(size=15)
    problem = eqx.combine(jax.tree.map(lambda a: a[i] if eqx.is_array(a) else a, own), common)
    n, rows, residual = batch.POINTS, [], []
    for group in problem.groups:
        value, by, order, _ = eqx.filter_jit(columns)(problem, group, jnp.asarray(u))
        full = np.zeros((n, 2, 15))
        full[:, :, list(order)] = np.stack(by, 0)[..., :n].transpose(2, 0, 1)
        rows.append(full.reshape(2 * n, 15))
        residual.append(np.stack(value, -1)[:n].ravel())
    rows, residual = np.concatenate(rows), np.concatenate(residual)
    peer = ScipyCalibration(batch.baked(LANES).each(lambda a: a[i]), *batch.prior())
    np.testing.assert_allclose(residual, peer.residual(u)[: 4 * n], rtol=0, atol=1e-8)
    np.testing.assert_allclose(rows, peer.jacobian(u)[: 4 * n], rtol=0, atol=1e-12 * np.abs(rows).max())
