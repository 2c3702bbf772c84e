"""Line numbers and times."""

import numpy as np
import pytest

import whiskjax as wj
from tests.derivatives import assert_derivatives

LINE, TIME_S = np.array([0.0, 100.0, 300.0, 310.0]), np.array([1.7e9, 1.7e9 + 1, 1.7e9 + 4, 1.7e9 + 4.1])


@pytest.fixture(scope="module")
def lines():
    return wj.LineTimes(LINE, TIME_S, "L1")


def test_lines_and_times_are_linear_between_knots_and_inverse(lines):
    line = np.linspace(0, 310, 50)
    time = lines.time_at(line)
    np.testing.assert_allclose(time, np.interp(line, LINE, TIME_S), rtol=0, atol=1e-6)
    # An epoch of 1.7e9 s is stored to 2.4e-7 s; 100 lines a second.
    np.testing.assert_allclose(lines.line_at(time), line, rtol=0, atol=1e-4)


def test_how_long_a_line_takes(lines):
    """The slope of the table around a line; at a knot that of what follows, at the last one of what came before."""
    line = np.array([0.0, 50.0, 99.9, 100.0, 250.0, 305.0, 310.0])
    expected = [0.01, 0.01, 0.01, 0.015, 0.015, 0.01, 0.01]
    # An epoch of 1.7e9 s is stored to 2.4e-7 s.
    np.testing.assert_allclose(lines.s_per_line(line), expected, rtol=0, atol=1e-7)
    assert float(lines.s_per_line(120.0)) == lines.s_per_line(np.array(120.0))
    assert np.isnan(lines.s_per_line(np.array([-0.1, 310.1]))).all()


def test_nothing_is_extrapolated(lines):
    assert np.isnan(lines.time_at(np.array([-0.01, 310.01]))).all()
    assert np.isnan(lines.line_at(TIME_S[[0, -1]] + [-1e-3, 1e-3])).all()
    np.testing.assert_array_equal(lines.time_at(LINE), TIME_S)


def test_the_window_is_the_first_and_last_time(lines):
    assert [float(t) for t in lines.window_s] == [TIME_S[0], TIME_S[-1]]


def test_derivatives():
    lines = wj.LineTimes(LINE, TIME_S - 1.7e9)
    assert_derivatives(lambda v: lines.time_at(v[0]), [[50.0], [200.0], [305.0]], step=1.0, tolerance=1e-12)
    assert_derivatives(lambda v: lines.line_at(v[0]), [[0.5], [2.5], [4.05]], step=0.01, tolerance=1e-10)


@pytest.mark.parametrize(
    "line, time, message",
    [
        ([0, 1, 1], [0, 1, 2], "L1: the lines of its line table must increase"),
        ([0, 1, 2], [0, 2, 1], "L1: the times of its line table must increase"),
        ([0, 1, 2], [0, np.nan, 1], r"L1: time_s holds no finite number at index \(1,\)"),
        ([0], [0], r"L1: line has shape \(1,\); at least two"),
        ([0, 1], [0, 1, 2], r"L1: time_s has shape \(3,\), expected \(lines,\) with lines = 2 as line has"),
    ],
)
def test_what_is_wrong_is_named(line, time, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.LineTimes(line, time, "L1")
