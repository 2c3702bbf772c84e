"""The block that Ceres is raced with is the one that whiskjax adjusts: both end at the same minimum, one knowing nothing of the
other."""

import numpy as np
import pytest

from benchmarks import three_line
from benchmarks.measure import measure_all
from benchmarks.peers import MissingPeer, build, ceres_block
from benchmarks.suite import Benchmark
from benchmarks.timing import Measured
from whiskjax.flights import songshan


@pytest.fixture(scope="module")
def at():
    """All of songshan A but most of its tie points."""
    return three_line.pose(songshan.Scene("A", ties=300, pos_hz=20.0))


@pytest.fixture(scope="module")
def adjusted(at):
    return at.adjusted(retime=False)


@pytest.fixture(scope="module")
def answer(at):
    try:
        return ceres_block.run(three_line.for_peer(at))
    except build.NotInstalled as error:
        pytest.skip(str(error))


def test_the_residuals_of_the_peers_are_ours(at, adjusted):
    """At our solution, with the peers' image equation in numpy and priors as the scene prints them."""
    arrays = three_line.for_peer(at)
    link = adjusted.sensor["pos_error"]
    shared = arrays.start.shared.copy()
    for unknown, value in zip(adjusted.unknowns, adjusted.value, strict=True):
        shared[three_line._seat(unknown.name)] = -value if unknown.name in "uvw" else value
    point_m = np.where(np.isfinite(adjusted.point_m), adjusted.point_m, arrays.start.point_m)
    node = np.concatenate([np.asarray(link.turn_rad), np.asarray(link.shift_m)], axis=1)
    residual = ceres_block.residual(arrays, ceres_block.Solution(node, shared, point_m))
    of_rays = residual[: 2 * len(at.block)].reshape(-1, 2) * at.block.sigma_px
    np.testing.assert_allclose(of_rays, adjusted.residual_px, rtol=0, atol=1e-8)
    np.testing.assert_allclose(np.sum(residual**2), adjusted.cost, rtol=1e-11)


def test_ceres_ends_at_our_cost(adjusted, answer):
    assert answer.converged
    np.testing.assert_allclose(adjusted.cost, 2 * answer.final_cost, rtol=three_line.SAME_COST)


def test_ceres_ends_at_our_solution(adjusted, answer):
    """Within a thousandth of the smallest sigmas: 2 mm of control points, 0.3 px, 0.005 deg and 5 cm of POS."""
    node, shared, point_m = answer.solution
    np.testing.assert_allclose(point_m, adjusted.point_m, rtol=0, atol=1e-6)
    link = adjusted.sensor["pos_error"]
    np.testing.assert_allclose(node[:, :3], link.turn_rad, rtol=0, atol=1e-8)
    np.testing.assert_allclose(node[:, 3:], link.shift_m, rtol=0, atol=1e-6)
    found = dict(zip((x.name for x in adjusted.unknowns), adjusted.value, strict=True))
    np.testing.assert_allclose(shared[3:6], [-found[name] for name in "uvw"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(shared[:3], [found[f"e{x}"] for x in "xyz"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(shared[6:10], [found[f"b{k}_forward"] for k in range(4)], rtol=0, atol=1e-5)
    np.testing.assert_allclose(shared[26:], [found[f"a{k}_backward"] for k in range(4)], rtol=0, atol=1e-5)


def test_both_derivatives_of_ceres_are_the_same(at, answer):
    by_nodes = ceres_block.run(three_line.for_peer(at), derivatives="nodes")
    np.testing.assert_allclose(by_nodes.final_cost, answer.final_cost, rtol=1e-12)


def test_weights_of_a_cubic_reproduce_it():
    x = np.linspace(0, 9, 37)
    first, weight = three_line.lagrange(x, 10)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    np.testing.assert_allclose(np.sum(weight * cubic(first[:, None] + np.arange(4)), axis=1), cubic(x), rtol=1e-12, atol=1e-10)
    assert first.min() == 0 and first.max() == 6


def test_what_only_some_machines_have_is_left_out_and_fails_nothing():
    def missing(error):
        def measure() -> Measured:
            raise error

        return Benchmark("name", "what is measured", "peer", 1.0, "x", measure)

    rows, left_out = measure_all([missing(build.NotInstalled("libceres-dev is not installed"))], {})
    assert rows == [] and left_out == ["name is left out: libceres-dev is not installed"]
    rows, left_out = measure_all([missing(MissingPeer("there is no compiler"))], {})
    assert rows[0][1] == "no peer: there is no compiler" and left_out == []
