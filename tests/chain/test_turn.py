"""Scan mirrors and gimbals."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.derivatives import assert_derivatives, assert_second_derivatives
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


@pytest.mark.parametrize("polynomial", [None, [0.03], [0.03, -0.02, 0.7]])
@pytest.mark.parametrize("gain", [1, 1.02])
def test_gain_and_polynomial_act_on_the_reading(gain, polynomial):
    """Angle by angle: gain times the reading, the index error, and powers from the square on."""
    turn = wj.Turn("z", wj.Encoder(TIME_S, ANGLE, 0.2), -1, 0.05, 0.1, gain, polynomial)
    expected = []
    for reading in np.interp(T + 0.05, TIME_S, ANGLE):
        angle = gain * reading + 0.1
        for k, coefficient in enumerate(polynomial or []):
            angle += coefficient * reading ** (k + 2)
        expected.append(-angle)
    np.testing.assert_allclose(angle_of(turn, T), expected, rtol=0, atol=1e-14)
    # It turns no faster than a search is told, and the search is told no more than twice of it.
    time = np.linspace(TIME_S[0], TIME_S[-1] - 0.05, 4001)
    fastest, told = np.abs(np.diff(angle_of(turn, time)) / np.diff(time)).max(), float(turn.moves(wj.Shot(time_s=T)).turn_radps)
    assert fastest < told * (1 + 1e-9) and told < 3 * fastest


def test_an_encoder_without_them_costs_nothing():
    """One, zero and none fold while tracing: nothing is left but to read the encoder."""
    turn = wj.Turn("z", wj.Encoder(TIME_S, ANGLE, 0.2))
    assert type(turn.gain) is int and turn.gain == 1 and turn.polynomial_rad is None
    asked = (lambda t: turn._angle(wj.Shot(time_s=t))), turn.encoder.at
    angle, reading = (len(jax.make_jaxpr(of)(T).eqns) for of in asked)
    assert angle == reading


def test_a_gain_and_a_polynomial_are_estimated():
    """From angles that they made, beside numpy's polynomial fit."""
    sensor = wj.Sensor({"scan": wj.Turn("y", wj.Encoder(TIME_S, ANGLE, 0.2))}, wj.FrameCamera(1000.0, (0.0, 0.0)))
    true = dataclasses.replace(sensor["scan"], gain=1.002, zero_rad=1e-3, polynomial_rad=[4e-3, -2e-3])
    shot, point = wj.Shot(time_s=T), np.tile([[5.0, 0.0, -100.0]], (len(T), 1))
    pixel = np.asarray(wj.project(wj.Sensor({"scan": true}, sensor.camera), shot, point).pixel_px)
    places = ("scan.gain", "scan.zero_rad", "scan.polynomial_rad[0]", "scan.polynomial_rad[1]")
    unknowns = [wj.Unknown(place.split(".")[1], place, scale=1e-3) for place in places]
    seen = wj.Observations(shot, point, pixel, np.full((len(T), 2), 0.1), np.ones(len(T), dtype=bool))
    found = wj.calibrate(sensor, seen, unknowns)
    reading = np.interp(T, TIME_S, ANGLE)
    p0, p1, p2, p3 = np.polynomial.polynomial.polyfit(reading, angle_of(dataclasses.replace(true, axis="z"), T), 3)
    np.testing.assert_allclose(found.value, [p1, p0, p2, p3], rtol=0, atol=1e-9)
    assert found.estimate.units[0].name == "1" and found.estimate.units[2].name == "deg"


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


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_of_gain_and_polynomial(order):
    encoder = wj.Encoder(TIME_S, ANGLE, 0.2, interpolation="cubic")

    def f(x):
        return wj.Turn("y", encoder, -1, x[1], x[2], x[3], x[4:]).pose(wj.Shot(time_s=x[0])).matrix

    x, step = [[1.02, 0.01, 0.2, 1.01, 0.05, -0.03], [3.33, -0.02, 0.0, 0.99, 0.0, 0.0]], [0.01, 0.01, 0.01, 0.01, 0.1, 0.1]
    if order == 1:
        assert_derivatives(f, x, step, tolerance=1e-9)
    else:
        assert_second_derivatives(lambda x: f(x)[jnp.array([0, 0]), jnp.array([0, 2])], x, step, reverse=True)


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
        (lambda e: wj.Turn("x", e, gain=0.0), "Turn: gain"),
        (lambda e: wj.Turn("x", e, polynomial_rad=[10.0]), "Turn: polynomial_rad"),
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
