"""The enumeration of failures: it survives jit and vmap, and its messages count and place what failed."""

import importlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.rules import first_failure, import_extra, is_traced, raise_failures
from whiskjax.rules.results import choose, codes_of, failure_if, is_successful, message_of

R = wj.RESULTS


def batch(*members):
    """A batch of results, built element by element."""
    result = R.successful
    for i, member in enumerate(members):
        result = choose(np.arange(len(members)) == i, member, result)
    return result


def members_of(result):
    return [message_of(int(code)) for code in codes_of(result)]


def test_every_failure_has_its_own_message():
    codes = range(len(R))
    messages = [message_of(code) for code in codes]
    assert messages[0] == ""
    assert len(set(messages)) == len(messages)
    assert all(len(m) > 20 for m in messages[1:])


def test_the_first_failure_wins_element_by_element():
    gap, miss, fine = R.time_in_gap, R.ray_misses_ground, R.successful
    first = batch(fine, gap, fine, gap)
    second = batch(fine, miss, miss, fine)
    found = first_failure(first, second)
    assert members_of(found) == [R[fine], R[gap], R[miss], R[gap]]
    np.testing.assert_array_equal(is_successful(found), [True, False, False, False])


def test_a_scalar_result_broadcasts_against_a_batch():
    found = first_failure(R.successful, batch(R.successful, R.nonfinite), R.time_in_gap)
    assert members_of(found) == [R[R.time_in_gap], R[R.nonfinite]]


def test_results_survive_jit_and_vmap():
    def check(t):
        return first_failure(failure_if(t < 0, R.time_outside_trajectory), failure_if(t > 1, R.time_in_gap))

    times = jnp.array([-1.0, 0.5, 2.0])
    expected = [R[R.time_outside_trajectory], "", R[R.time_in_gap]]
    assert members_of(jax.jit(check)(times)) == expected
    assert members_of(jax.jit(jax.vmap(check))(times)) == expected


def test_a_success_raises_nothing_and_a_trace_is_silent():
    raise_failures(R.successful, "look")
    raise_failures(batch(R.successful, R.successful), "look")

    @jax.jit
    def inside(t):
        result = failure_if(t > 0, R.nonfinite)
        raise_failures(result, "look")
        return result

    assert message_of(int(codes_of(inside(1.0)))) == R[R.nonfinite]


def test_one_failure_is_raised_with_its_message():
    with pytest.raises(wj.SensorError, match=r"look: .*not bridged"):
        raise_failures(R.time_in_gap, "look")


def test_failures_of_a_batch_are_counted_by_kind_and_placed():
    result = batch(R.successful, R.time_in_gap, R.outside_swath, R.time_in_gap)
    with pytest.raises(wj.SensorError) as caught:
        raise_failures(result, "look")
    message = str(caught.value)
    assert f"2 of 4 ({R[R.time_in_gap]}; first at index (1,))" in message
    assert f"1 of 4 ({R[R.outside_swath]}; first at index (2,))" in message
    assert "throw=False" in message


def test_errors_are_one_family():
    assert issubclass(wj.SensorError, wj.WhiskjaxError)
    assert issubclass(wj.FlightError, wj.WhiskjaxError)
    assert issubclass(wj.FlightError, ValueError)


def test_tracers_are_told_from_numbers():
    seen = []
    jax.jit(lambda x: seen.append(is_traced(x)))(1.0)
    assert seen == [True]
    assert not is_traced(jnp.ones(2))
    assert not is_traced(3.0)


def test_a_missing_extra_names_how_to_install_it(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(ImportError, match=r'h5py is needed here.*pip install "whiskjax\[files\]"'):
        import_extra("h5py", "files")


def test_an_extra_that_is_there_is_imported():
    assert import_extra("json", "files").loads("[1]") == [1]
