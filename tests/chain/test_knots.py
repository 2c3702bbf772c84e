"""Which samples surround a time: against numpy's searchsorted, at every rate, with gaps."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whiskjax as wj
from whiskjax.chain.knots import Knots
from whiskjax.rules.results import codes_of, is_successful

R = wj.RESULTS


def found_by_numpy(time, t):
    i = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    return i, (t - time[i]) / (time[i + 1] - time[i])


def queries(time):
    """Every sample, its neighbouring floats, the middles, and times outside."""
    middles = (time[1:] + time[:-1]) / 2
    inside = np.concatenate([time, np.nextafter(time, -np.inf)[1:], np.nextafter(time, np.inf)[:-1], middles])
    return inside, np.array([time[0] - 1.0, time[-1] + 1.0])


@jax.jit
def located(knots, t):
    return knots.locate(t), knots.check(t)


def assert_found(time):
    inside, outside = queries(time)
    knots = Knots(time, 1e9, "test")
    (i, w, length), fine = located(knots, inside)
    expected, fraction = found_by_numpy(time, inside)
    np.testing.assert_array_equal(i, expected)
    np.testing.assert_allclose(w, fraction, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(length, np.diff(time)[expected])
    assert is_successful(fine).all()
    assert (codes_of(knots.check(outside)) == codes_of(R.time_outside_trajectory)).all()


RECORDS = {
    "two samples": np.array([3.0, 5.0]),
    "200 Hz": 100.0 + np.arange(400) / 200,
    "200 Hz, seconds since 1970": 1.7e9 + np.arange(400) / 200,
    "jittered 200 Hz": 1e5 + np.arange(400) / 200 + np.random.default_rng(0).uniform(-2e-3, 2e-3, 400),
    "bursts": np.concatenate([k * 10.0 + np.arange(20) / 100 for k in range(5)]),
    "one close pair": np.array([0.0, 1.0, 1.0 + 1e-7, 2.0, 3.0]),
    "geometric": 1.5 ** np.arange(40),
}


@pytest.mark.parametrize("record", RECORDS)
def test_every_sample_is_found(record):
    assert_found(RECORDS[record])


@given(st.lists(st.floats(1e-5, 1e3), min_size=11, max_size=11), st.sampled_from([0.0, -1e4, 1.7e9]))
def test_uneven_samples_are_found(steps, start):
    time = start + np.concatenate([[0.0], np.cumsum(steps)])
    assert_found(time)


def test_a_gap_is_refused_but_its_two_ends_are_usable():
    knots = Knots([0.0, 1.0, 2.0, 5.0, 6.0], 1.5, "test")
    t = np.array([1.9, 2.0, 2.0001, 3.0, 4.9999, 5.0, 5.1])
    gap, fine = codes_of(R.time_in_gap), codes_of(R.successful)
    np.testing.assert_array_equal(codes_of(knots.check(t)), [fine, fine, gap, gap, gap, fine, fine])


def test_an_interval_of_exactly_the_longest_gap_is_bridged():
    knots = Knots([0.0, 1.5, 3.5], 1.5, "test")
    assert bool(is_successful(knots.check(np.array(0.7))))
    assert bool(knots.check(np.array(2.0)) == R.time_in_gap)


def test_no_number_is_no_time():
    knots = Knots([0.0, 1.0], 1.5, "test")
    assert bool(knots.check(np.array(np.nan)) == R.time_outside_trajectory)


@pytest.mark.parametrize(
    "time, gap, message",
    [
        ([0.0, 1.0, 1.0, 2.0], 1.0, r"POS: .*time of sample 2 .*1\.0.* repeats that of sample 1"),
        ([0.0, 2.0, 1.0, 3.0], 1.0, r"POS: .*time of sample 2 .* is earlier than that of sample 1.*sort"),
        ([0.0, 1.0, np.nan, 2.0], 1.0, r"POS: time_s holds no finite number at index \(2,\)"),
        ([0.0, np.inf], 1.0, r"POS: time_s holds no finite number at index \(1,\)"),
        ([0.0], 1.0, r"POS: time_s has shape \(1,\); at least two"),
        ([[0.0, 1.0]], 1.0, r"POS: time_s has shape \(1, 2\), expected \(n,\)"),
        ([0.0, 1.0], 0.0, r"POS: max_gap_s is 0; it must be above 0"),
        ([0.0, 1.0], np.nan, r"POS: max_gap_s is nan; it must be above 0"),
    ],
)
def test_what_is_wrong_with_the_times_is_named(time, gap, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        Knots(time, gap, "POS")
