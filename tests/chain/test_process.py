"""Processes in time: covariances of the textbook, interpolation by numpy, and their place in a chain."""

import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whiskjax as wj
from tests.derivatives import assert_derivatives
from whiskjax.rules.results import is_successful

NODE_S = np.array([100.0, 100.5, 103.0, 104.5, 110.0])
TURN_RAD = np.random.default_rng(3).normal(0, 0.02, (5, 3))
SHIFT_M = np.random.default_rng(4).normal(0, 0.5, (5, 3))
PROCESSES = {
    "random walk": wj.Process.random_walk(NODE_S),
    "random walk with a start": wj.Process.random_walk(NODE_S, start_sigma=3.0),
    "ornstein uhlenbeck": wj.Process.ornstein_uhlenbeck(NODE_S, 4.0),
    "smooth": wj.Process.smooth(NODE_S, 4.0),
}
APART_S = np.abs(NODE_S[:, None] - NODE_S)
BOTH_S = np.minimum(*np.meshgrid(NODE_S - 100, NODE_S - 100))  # how long both have walked
COVARIANCES = {
    "random walk": BOTH_S,
    "random walk with a start": 9.0 + BOTH_S,
    "ornstein uhlenbeck": np.exp(-APART_S / 4.0),
    "smooth": (1 + np.sqrt(3) * APART_S / 4.0) * np.exp(-np.sqrt(3) * APART_S / 4.0),
}


def weights(process, t):
    """All weights as one array (times, coefficients)."""
    return np.stack([np.broadcast_to(w, np.shape(t)) for _, w in process.weights(t)], -1)


@pytest.mark.parametrize("name", PROCESSES)
def test_coefficients_of_sigma_one_make_the_process(name):
    """root root^T is the covariance of the values at the nodes; stationary ones carry a jitter of 1e-12."""
    root = np.asarray(PROCESSES[name].root)
    np.testing.assert_allclose(root @ root.T, COVARIANCES[name], rtol=0, atol=2e-12)
    np.testing.assert_array_equal(root, np.tril(root))
    assert PROCESSES[name].size == 5


def test_a_random_walk_starts_at_zero_unless_told():
    np.testing.assert_array_equal(PROCESSES["random walk"].root[0], np.zeros(5))
    assert PROCESSES["random walk with a start"].root[0, 0] == 3.0


@given(st.floats(0, 1e7))
def test_the_start_of_a_random_walk_takes_nothing_from_its_changes(start_sigma):
    """What is left when the first value is subtracted is the walk without a start, however uncertain the start."""
    root = np.asarray(wj.Process.random_walk(NODE_S, start_sigma).root)
    change = root - root[0]
    np.testing.assert_allclose(change @ change.T, BOTH_S, rtol=0, atol=1e-13)


@given(st.lists(st.floats(0.01, 30.0), min_size=1, max_size=12), st.floats(0.05, 300.0))
def test_any_nodes_and_any_correlation_time(gaps, correlation_s):
    t = np.cumsum([5.0, *gaps])
    apart = np.abs(t[:, None] - t)
    found = np.asarray(wj.Process.ornstein_uhlenbeck(t, correlation_s).root)
    np.testing.assert_allclose(found @ found.T, np.exp(-apart / correlation_s), rtol=0, atol=1e-11)
    x = np.sqrt(3) * apart / correlation_s
    found = np.asarray(wj.Process.smooth(t, correlation_s).root)
    np.testing.assert_allclose(found @ found.T, (1 + x) * np.exp(-x), rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", PROCESSES)
def test_between_nodes_it_is_interpolated_linearly(name):
    process = PROCESSES[name]
    t = np.sort(np.concatenate([np.random.default_rng(1).uniform(100, 110, 60), NODE_S]))
    values = np.asarray(process.root) @ SHIFT_M
    expected = np.stack([np.interp(t, NODE_S, column) for column in values.T], -1)
    np.testing.assert_allclose(weights(process, t) @ SHIFT_M, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_any_batch_shape(shape):
    t = np.random.default_rng(2).uniform(100, 110, shape)
    correction = wj.Correction(PROCESSES["smooth"], shift_m=SHIFT_M)
    pose = correction.pose(wj.Shot(time_s=t))
    values = np.asarray(PROCESSES["smooth"].root) @ SHIFT_M
    for found, column in zip(pose.translation, values.T, strict=True):
        assert np.shape(found) == shape
        np.testing.assert_allclose(found, np.interp(t, NODE_S, column), rtol=0, atol=1e-13)
    assert np.shape(is_successful(correction.check(wj.Shot(time_s=t)))) == shape


def sensor(process):
    """A camera 300 m above the points, whose station wanders."""
    return wj.Sensor(
        {
            "station": wj.Mount(lever_arm_m=[10.0, -20.0, 300.0], angles_rad=[0.02, -0.01, 0.3]),
            "wander": wj.Correction(process, TURN_RAD, SHIFT_M),
        },
        wj.FrameCamera(2000.0, (0.0, 0.0)),
    )


def test_nothing_is_said_outside_the_nodes():
    t = np.array([99.999, 100.0, 105.0, 110.0, 110.001, np.nan])
    point = np.zeros((6, 3))
    result = wj.project(sensor(PROCESSES["random walk"]), wj.Shot(time_s=t), point, throw=False).result
    np.testing.assert_array_equal(is_successful(result), [False, True, True, True, False, False])
    outside = np.asarray(result == wj.RESULTS.time_outside_trajectory)
    np.testing.assert_array_equal(outside, [True, False, False, False, True, True])
    with pytest.raises(wj.SensorError, match="outside the recorded samples"):
        wj.project(sensor(PROCESSES["random walk"]), wj.Shot(time_s=t), point)


@pytest.mark.parametrize("name", ["random walk with a start", "smooth"])
def test_derivatives_of_an_image_through_a_process(name):
    """By the time, the coefficients and the point."""
    start = sensor(PROCESSES[name])

    def f(x):
        link = eqx.tree_at(lambda c: (c.turn_rad, c.shift_m), start["wander"], (x[1:16].reshape(5, 3), x[16:31].reshape(5, 3)))
        links = dict(zip(start.names, start.links, strict=True)) | {"wander": link}
        return wj.project(wj.Sensor(links, start.camera), wj.Shot(time_s=x[0]), x[31:], throw=False).pixel_px

    x = np.r_[103.7, TURN_RAD.ravel(), SHIFT_M.ravel(), 5.0, -8.0, 1.0]
    step = np.r_[0.1, np.full(15, 1e-3), np.full(15, 0.1), 0.1, 0.1, 0.1]
    assert_derivatives(f, x, step=step, tolerance=1e-6)


@pytest.mark.parametrize("name", PROCESSES)
def test_a_process_is_a_pytree_that_goes_through_jit(name):
    def shift(process, t):
        return wj.Correction(process, shift_m=SHIFT_M).pose(wj.Shot(time_s=t)).translation

    t = np.linspace(100, 110, 7)
    np.testing.assert_allclose(jax.jit(shift)(PROCESSES[name], t), shift(PROCESSES[name], t), rtol=0, atol=1e-14)


NODES = "at least two node times that increase"


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: wj.Process.random_walk([1.0]), NODES),
        (lambda: wj.Process.random_walk([1.0, 1.0]), NODES),
        (lambda: wj.Process.smooth([2.0, 1.0], 1.0), NODES),
        (lambda: wj.Process.smooth([1.0, np.nan], 1.0), "Process: time_s holds no finite number"),
        (lambda: wj.Process.ornstein_uhlenbeck([[1.0, 2.0]], 1.0), r"Process: time_s has shape \(1, 2\)"),
        (lambda: wj.Process.ornstein_uhlenbeck([1.0, 2.0], 0.0), "Process: correlation_s is 0; it must be above 0"),
        (lambda: wj.Process.smooth([1.0, 2.0], -3.0), "correlation_s is -3; it must be above 0"),
        (lambda: wj.Process.smooth([1.0, 2.0], np.inf), "correlation_s is not a finite number"),
        (lambda: wj.Process.random_walk([1.0, 2.0], np.nan), "start_sigma is not a finite number"),
        (lambda: wj.Process.random_walk([1.0, 2.0], -1.0), "Process: start_sigma is -1; it must be 0 or more"),
        (
            lambda: wj.Correction(PROCESSES["smooth"], turn_rad=np.zeros((4, 3))),
            r"turn_rad has shape \(4, 3\), expected \(5, 3\)",
        ),
    ],
)
def test_a_wrong_process_is_refused(make, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        make()
