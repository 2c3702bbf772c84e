"""Scan mirrors and gimbals."""

import equinox as eqx
import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.derivatives import assert_derivatives
from tests.oracles import about
from whiskjax.rules.results import codes_of

R = wj.RESULTS
TIME_S = np.linspace(0, 4, 41)
ANGLE = 0.3 * np.sin(TIME_S) + 0.1 * TIME_S
T = np.linspace(0.2, 3.8, 17)


def angle_of(link, t):
    """The angle by which a link about z turns."""
    rotation = jax.jit(lambda link, t: link.pose(wj.Shot(time_s=t)).matrix)(link, t)
    return np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_is_the_rotation_by_the_interpolated_angle(axis, sign):
    turn = wj.Turn(axis, wj.Encoder(TIME_S, ANGLE, 0.2), sign=sign, delay_s=0.05, zero_rad=0.7)
    pose = turn.pose(wj.Shot(time_s=T))
    expected = about(axis, sign * (np.interp(T + 0.05, TIME_S, ANGLE) + 0.7))
    np.testing.assert_allclose(pose.matrix, expected.as_matrix(), rtol=0, atol=1e-14)
    assert pose.translation == (0, 0, 0)


def test_an_encoder_that_wraps_around_at_a_whole_turn_is_unwrapped():
    smooth = 1.3 * TIME_S * np.pi
    for wrapped in (smooth % (2 * np.pi), (smooth + np.pi) % (2 * np.pi) - np.pi):
        turn = wj.Turn("z", wj.Encoder(TIME_S, wrapped, 0.2))
        error = angle_of(turn, T) - 1.3 * np.pi * T
        np.testing.assert_allclose(np.exp(1j * error), 1, rtol=0, atol=1e-13)


def test_an_encoder_that_was_read_late_is_found_by_a_positive_delay():
    late = wj.Encoder(TIME_S, 0.4 * (TIME_S - 0.06), 0.2)  # each stamp carries the angle of 0.06 s before
    np.testing.assert_allclose(angle_of(wj.Turn("z", late, delay_s=0.06), T), 0.4 * T, rtol=0, atol=1e-14)


def test_nothing_is_extrapolated_and_no_gap_is_bridged():
    encoder = wj.Encoder([0.0, 1.0, 5.0, 6.0], [0.0, 0.1, 0.2, 0.3], 1.5)
    outside, gap, fine = (codes_of(r) for r in (R.time_outside_trajectory, R.time_in_gap, R.successful))
    t = np.array([-0.1, 0.5, 1.0, 3.0, 5.0, 6.0, 6.1])
    check = wj.Turn("x", encoder).check(wj.Shot(time_s=t))
    np.testing.assert_array_equal(codes_of(check), [outside, fine, fine, gap, fine, fine, outside])
    late = wj.Turn("x", encoder, delay_s=0.5).check(wj.Shot(time_s=t - 0.5))
    np.testing.assert_array_equal(codes_of(late), codes_of(check))


def test_derivatives():
    encoder = wj.Encoder(TIME_S, ANGLE, 0.2)

    def f(x):
        return wj.Turn("y", encoder, -1, x[1], x[2]).pose(wj.Shot(time_s=x[0])).matrix

    assert_derivatives(f, [[1.05, 0.01, 0.2], [3.33, -0.02, 0.0]], step=[0.01, 0.01, 0.01], tolerance=1e-11)


def test_derivatives_with_respect_to_the_recorded_angles():
    turn = wj.Turn("y", wj.Encoder(TIME_S, ANGLE, 0.2))

    def f(angle):
        return eqx.tree_at(lambda k: k.encoder.angle_rad, turn, angle).pose(wj.Shot(time_s=T)).matrix

    assert_derivatives(f, ANGLE, step=0.01, tolerance=1e-11)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda e: wj.Turn("w", e), "axis x, y or z, not 'w'"),
        (lambda e: wj.Turn("x", e, sign=0), r"\+1 or -1, not 0"),
        (
            lambda e: wj.Encoder([0, 1], [0, 1, 2], 1.0, "scan"),
            r"scan: angle_rad has shape \(3,\), expected \(n,\) with n = 2 as time_s has",
        ),
        (lambda e: wj.Encoder([0, 1], [0, np.nan], 2.0, "scan"), r"scan: angle_rad holds no finite number at index \(1,\)"),
        (lambda e: wj.Encoder([0, 0], [0, 1], 2.0, "scan"), "scan: .*sample 1.* repeats"),
    ],
)
def test_a_wrong_turn_is_refused(make, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        make(wj.Encoder([0.0, 1.0], [0.0, 1.0], 2.0))


def test_a_shot_without_a_time_is_refused_with_the_remedy():
    with pytest.raises(wj.WhiskjaxError, match="time_s"):
        wj.Turn("x", wj.Encoder([0.0, 1.0], [0.0, 1.0], 2.0)).pose(wj.Shot(image=0))
