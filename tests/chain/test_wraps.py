"""Recorded angles: cumulative ones stay, those modulo one turn are unwrapped, and what could be either is refused."""

import numpy as np
import pytest

import whiskjax as wj

TURN = 2 * np.pi
T = np.arange(200) / 15.0
BETWEEN = np.linspace(0.3, 12.7, 501)


def at(encoder, t):
    return np.asarray(encoder.at(np.asarray(t)))


@pytest.mark.parametrize("rate_hz", [19.0, 11.0, 10.0, 7.5, 7.4, 0.1, -10.0])
def test_a_cumulative_angle_is_what_it_is(rate_hz):
    """A mirror of 10 turns a second logged 15 times a second: two thirds of a turn a sample."""
    encoder = wj.Encoder(T, TURN * rate_hz * T, max_gap_s=1.0)
    np.testing.assert_allclose(at(encoder, BETWEEN), TURN * rate_hz * BETWEEN, rtol=0, atol=1e-10)


@pytest.mark.parametrize("wraps", [None, True])
@pytest.mark.parametrize("start", [0.0, -np.pi])
@pytest.mark.parametrize("rate_hz", [0.3, 2.0, 5.0, -4.0])
def test_an_angle_modulo_one_turn_is_unwrapped(rate_hz, start, wraps):
    recorded = (TURN * rate_hz * T - start) % TURN + start
    encoder = wj.Encoder(T, recorded, max_gap_s=1.0, wraps=wraps)
    off = (at(encoder, BETWEEN) - TURN * rate_hz * BETWEEN) / TURN
    np.testing.assert_allclose(off, round(off[0]), rtol=0, atol=1e-10)


@pytest.mark.parametrize("rate_hz", [7.5, 7.0, 8.0])
def test_a_step_that_has_two_readings_is_refused_with_its_samples(rate_hz):
    with pytest.raises(wj.WhiskjaxError, match=r"mirror: from sample 0 \(0.0\d* s\) to 1 \(0.06\d* s\).*recorded more often"):
        wj.Encoder(T, (TURN * rate_hz * T) % TURN, max_gap_s=1.0, name="mirror", wraps=True)


def test_a_record_that_does_not_tell_is_refused_with_the_remedy():
    gimbal = np.radians([250.0, 252.9, 66.1, 70.0])
    with pytest.raises(wj.WhiskjaxError, match=r"from sample 1 .* to 2 .*-186.8 deg, or by \+173.2 deg\?.*wraps: false"):
        wj.Encoder([0.0, 1.0, 2.0, 3.0], gimbal, max_gap_s=2.0)
    given = wj.Encoder([0.0, 1, 2, 3], gimbal, max_gap_s=2.0, wraps=False)
    np.testing.assert_allclose(at(given, 1.5), gimbal[1:3].mean())


@pytest.mark.parametrize("width_deg", [60.0, 100.0, 170.0])
@pytest.mark.parametrize("shape", ["flyback", "zig-zag"])
def test_scan_mirrors_are_left_alone(shape, width_deg):
    """A sawtooth that flies back within one sample is no wrap, whatever its height."""
    phase = (0.37 * T) % 1.0
    angle = np.radians(width_deg) * ((phase if shape == "flyback" else np.abs(2 * phase - 1)) - 0.5)
    encoder = wj.Encoder(T, angle, max_gap_s=1.0)
    np.testing.assert_allclose(at(encoder, BETWEEN), np.interp(BETWEEN, T, angle), rtol=0, atol=1e-14)


def test_a_gimbal_passes_north():
    azimuth = np.radians(np.array([350.0, 355.0, 0.0, 5.0, 10.0]))
    encoder = wj.Encoder(np.arange(5.0), azimuth, max_gap_s=2.0)
    np.testing.assert_allclose(np.degrees(at(encoder, [1.5, 3.5])) % 360, [357.5, 7.5], rtol=0, atol=1e-10)


def test_across_a_gap_nothing_is_asked():
    encoder = wj.Encoder([0.0, 0.1, 9.0, 9.1], np.radians([10.0, 12.0, 191.0, 193.0]), max_gap_s=1.0, wraps=True)
    np.testing.assert_allclose(np.degrees(at(encoder, [0.05, 9.05])) % 360, [11.0, 192.0], rtol=0, atol=1e-10)


def test_two_attitudes_half_a_turn_apart_are_refused():
    quaternion = [[0, 0, 0, 1], [0, 0, 1, 1e-4], [0, 0, 1, 0.2]]
    with pytest.raises(wj.WhiskjaxError, match=r"the attitude turns by 180\.0 deg, which cannot be told from"):
        wj.Trajectory([0.0, 1.0, 2.0], np.zeros((3, 3)), quaternion, max_gap_s=2.0)
