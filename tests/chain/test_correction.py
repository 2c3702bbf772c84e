"""Corrections in time, each basis against its textbook formula or scipy."""

import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BarycentricInterpolator, BSpline
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.derivatives import assert_derivatives
from whiskjax.chain.stations import motion
from whiskjax.rules.results import is_successful

START_S, SPACING_S, NODES = 100.0, 4.0, 7
NODE_S = START_S + SPACING_S * np.arange(NODES)
RNG = np.random.default_rng(13)
TURN_RAD, SHIFT_M = RNG.normal(0, 0.2, (NODES, 3)), RNG.normal(0, 3, (NODES, 3))
BASES = {
    "bias": wj.Bias(),
    "drift": wj.Drift(START_S, 50.0),
    "orientation images": wj.OrientationImages(START_S, SPACING_S, NODES),
    "spline": wj.Spline(START_S, SPACING_S, NODES),
}
INSIDE = np.linspace(NODE_S[1], NODE_S[-2], 41)  # where every basis reaches


def weights(basis, t):
    """All weights as one array (times, coefficients)."""
    dense = np.zeros((len(t), basis.size))
    for i, w in basis.weights(t):
        dense[np.arange(len(t)), np.asarray(i)] += np.asarray(w)
    return dense


def node_by_node(t, values):
    """The cubic through the four nodes nearest to each time, by scipy's barycentric formula."""
    out = []
    for time in t:
        first = int(np.clip(np.floor((time - START_S) / SPACING_S) - 1, 0, NODES - 4))
        near = slice(first, first + 4)
        out.append(BarycentricInterpolator(NODE_S[near], values[near])(time))
    return np.array(out)


def test_orientation_images_are_the_cubic_through_the_four_nearest():
    t = np.linspace(NODE_S[0], NODE_S[-1], 57)
    w = weights(BASES["orientation images"], t)
    np.testing.assert_allclose(w.sum(axis=1), 1, rtol=0, atol=1e-14)
    np.testing.assert_allclose(w @ SHIFT_M, node_by_node(t, SHIFT_M), rtol=0, atol=1e-12)
    np.testing.assert_allclose(weights(BASES["orientation images"], NODE_S), np.eye(NODES), rtol=0, atol=1e-14)


@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_orientation_images_reproduce_cubics(coefficients):
    t = np.linspace(NODE_S[0], NODE_S[-1], 23)
    u, nodes = (t - START_S) / 10, (NODE_S - START_S) / 10
    found = weights(BASES["orientation images"], t) @ np.polyval(coefficients, nodes)
    np.testing.assert_allclose(found, np.polyval(coefficients, u), rtol=0, atol=1e-12)


def test_the_spline_is_scipys():
    knots = START_S + SPACING_S * (np.arange(NODES + 4) - 2)
    spline = BSpline(knots, SHIFT_M, 3)
    w = weights(BASES["spline"], INSIDE)
    np.testing.assert_allclose(w.sum(axis=1), 1, rtol=0, atol=1e-14)
    np.testing.assert_allclose(w @ SHIFT_M, spline(INSIDE), rtol=0, atol=1e-12)


def test_a_drift_is_a_line_and_a_bias_is_constant():
    np.testing.assert_allclose(
        weights(BASES["drift"], INSIDE), np.stack([0 * INSIDE + 1, (INSIDE - START_S) / 50], -1), rtol=1e-15
    )
    np.testing.assert_array_equal(weights(BASES["bias"], INSIDE), np.ones((len(INSIDE), 1)))


@pytest.mark.parametrize("name", BASES)
def test_a_correction_turns_and_shifts_by_the_weighted_sum(name):
    """p_outer = exp([turn]x) p_inner + shift."""
    basis = BASES[name]
    turn, shift = TURN_RAD[: basis.size], SHIFT_M[: basis.size]
    pose = jax.jit(lambda c, t: c.pose(wj.Shot(time_s=t)))(wj.Correction(basis, turn, shift), INSIDE)
    w = weights(basis, INSIDE)
    point = np.array([1.0, -2.0, 3.0])
    expected = Rotation.from_rotvec(w @ turn).apply(point) + w @ shift
    # A bias is one pose for all times.
    got = np.broadcast_to(np.stack(pose.point(tuple(point)), -1), expected.shape)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13)


def test_what_is_absent_is_structurally_zero():
    pose = wj.Correction(BASES["bias"]).pose(wj.Shot(time_s=1.0))
    assert pose.translation == (0, 0, 0) and pose.rotation[0] == (1, 0, 0)


@pytest.mark.parametrize("name, reach", [("orientation images", NODE_S[[0, -1]]), ("spline", NODE_S[[1, -2]])])
def test_a_basis_does_not_extrapolate(name, reach):
    t = np.concatenate([reach + [-1e-6, 1e-6], reach, [reach.mean(), np.nan]])
    result = wj.Correction(BASES[name], shift_m=SHIFT_M).check(wj.Shot(time_s=t))
    np.testing.assert_array_equal(is_successful(result), [False, False, True, True, True, False])
    outside = np.asarray(result == wj.RESULTS.time_outside_trajectory)
    np.testing.assert_array_equal(outside, ~np.asarray(is_successful(result)))


@pytest.mark.parametrize("name", BASES)
def test_derivatives(name):
    basis = BASES[name]
    k = basis.size
    start = wj.Correction(basis, TURN_RAD[:k], SHIFT_M[:k])

    def f(x):
        turn, shift = x[1 : 1 + 3 * k].reshape(k, 3), x[1 + 3 * k :].reshape(k, 3)
        link = eqx.tree_at(lambda c: (c.turn_rad, c.shift_m), start, (turn, shift))
        return link.pose(wj.Shot(time_s=x[0])).point((1.0, -2.0, 3.0))

    x = np.r_[105.5, TURN_RAD[:k].ravel(), SHIFT_M[:k].ravel()]
    assert_derivatives(f, x, step=0.03, tolerance=1e-9)
    # Continuous across a node, to the second derivative for the spline, in value for the cubics through nodes.
    if name == "spline":
        assert_derivatives(f, np.r_[NODE_S[3], x[1:]], step=np.r_[1e-3, np.full(len(x) - 1, 0.03)], tolerance=1e-9)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: wj.Correction(BASES["bias"], turn_rad=np.zeros((2, 3))), r"turn_rad has shape \(2, 3\), expected \(1, 3\)"),
        (lambda: wj.Correction(BASES["spline"], shift_m=np.zeros((4, 3))), r"shift_m has shape \(4, 3\), expected \(7, 3\)"),
        (lambda: wj.Spline(0.0, 1.0, 3), "at least 4 are needed, not 3"),
        (lambda: wj.OrientationImages(0.0, 1.0, 1), "at least 4 are needed, not 1"),
    ],
)
def test_a_wrong_correction_is_refused(make, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        make()


def test_coefficients_may_be_lists():
    pose = wj.Correction(wj.Bias(), shift_m=[[1.0, 2.0, 3.0]]).pose(wj.Shot(time_s=0.0))
    np.testing.assert_array_equal(np.array(pose.translation), [1, 2, 3])


# Several segments, as the strips of a block are.

STARTS_S, LENGTHS = np.array([100.0, 300.0, 390.0]), (6, 4, 9)
SEGMENTED = {"orientation images": wj.OrientationImages, "spline": wj.Spline}


def at_nodes(kind, rng, size):
    """Times in each segment where the basis reaches, ends included."""
    reach = 0 if kind == "orientation images" else 1
    first, last = STARTS_S + SPACING_S * reach, STARTS_S + SPACING_S * (np.array(LENGTHS) - 1 - reach)
    return [np.concatenate([[a, b], rng.uniform(a, b, size)]) for a, b in zip(first, last, strict=True)]


@pytest.mark.parametrize("kind", SEGMENTED)
def test_a_segment_is_a_basis_of_its_own(kind):
    """At a time in a segment, the weights are those of a basis with that segment alone; all other coefficients are silent."""
    whole = SEGMENTED[kind](STARTS_S, SPACING_S, LENGTHS)
    assert whole.size == sum(LENGTHS)
    last = 0
    for start, n, t in zip(STARTS_S, LENGTHS, at_nodes(kind, np.random.default_rng(0), 20), strict=True):
        expected = np.zeros((len(t), whole.size))
        expected[:, last : last + n] = weights(SEGMENTED[kind](start, SPACING_S, n), t)
        np.testing.assert_allclose(weights(whole, t), expected, rtol=0, atol=1e-13)
        assert is_successful(whole.check(t)).all()
        last += n
    between = np.array([99.9, 120.1, 250.0, 299.9, 312.1, 389.9, 422.1])
    assert not is_successful(whole.check(between)).any()


@pytest.mark.parametrize("kind", SEGMENTED)
def test_epochs_determine_the_coefficients(kind):
    """As many times as coefficients, in order, where the basis reaches; weights there are an invertible matrix."""
    basis = SEGMENTED[kind](STARTS_S, SPACING_S, LENGTHS)
    t = basis.epoch_s
    assert t.shape == (basis.size,) and (np.diff(t) > 0).all() and is_successful(basis.check(t)).all()
    assert np.linalg.cond(weights(basis, t)) < 100
    nodes = np.concatenate([start + SPACING_S * np.arange(n) for start, n in zip(STARTS_S, LENGTHS, strict=True)])
    np.testing.assert_array_equal(basis.node_s, nodes)
    if kind == "orientation images":
        np.testing.assert_array_equal(t, nodes)
    # The link answers for its basis: motions of the stations follow from those at the epochs, segment by segment.
    link = wj.Correction(basis, turn_rad=RNG.normal(0, 0.1, (basis.size, 3)))
    assert link.segments == LENGTHS
    np.testing.assert_array_equal(link.node_s, nodes)
    dense = np.zeros((basis.size, basis.size))
    for i, w in link.acting(wj.Shot(time_s=link.epoch_s)):
        dense[np.arange(basis.size), np.asarray(i)] += np.asarray(w)
    turn, _ = motion(link, wj.Shot(time_s=link.epoch_s))
    np.testing.assert_allclose(np.linalg.solve(dense, np.stack(turn, axis=-1)), link.turn_rad, rtol=0, atol=1e-12)


POSES = wj.PosePerImage(np.zeros((3, 3)), [[0, 0, 0, 1.0]] * 3)
PROCESS = wj.Process.random_walk([0.0, 1.0])


@pytest.mark.parametrize("link, stations", [(wj.Correction(wj.Bias()), 1), (wj.Correction(PROCESS), 2), (POSES, 3)])
def test_stations_that_are_no_nodes_lie_in_no_time(link, stations):
    assert link.segments == (link.stations,) == (stations,)
    assert link.node_s is None and link.epoch_s is None


@pytest.mark.parametrize("kind", SEGMENTED)
@pytest.mark.parametrize(
    "starts, nodes, message",
    [
        ((100.0, 300.0), (6,), r"nodes has shape \(1,\), expected \(segments,\) with segments = 2 as start_s has"),
        ((100.0, 300.0), (6, 3), "at least 4 are needed, not 3"),
        ((300.0, 100.0), (6, 6), r"segment 1 starts at 100 s, before segment 0 ends at 320 s: .*order in which they were flown"),
        ((100.0, 119.0), (6, 6), "segment 1 starts at 119 s, before segment 0 ends at 120 s"),
    ],
)
def test_segments_that_make_no_sense_are_refused(kind, starts, nodes, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        SEGMENTED[kind](starts, SPACING_S, nodes)
