"""Navigation aligned with the shots, against what is interpolated at its samples and against scipy."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from whiskjax.algebra.angles import Angle
from whiskjax.rules.results import codes_of

N = 7
RNG = np.random.default_rng(12)
TIME_S = np.arange(N) * 1.0
LAT, LON = RNG.uniform(-1.4, 1.4, N), RNG.uniform(-3, 3, N)
NEAR_LAT, NEAR_LON = 0.7 + 1e-4 * TIME_S, 1.2 - 1e-4 * TIME_S
HEIGHT = RNG.uniform(0, 9000, N)
ANGLES = RNG.uniform(-1, 1, (3, N))
SHOT = wj.Shot(time_s=TIME_S)


def test_the_pose_of_each_record_is_that_of_proj_and_scipy():
    pose = wj.Records(LAT, LON, HEIGHT, *ANGLES).pose(wj.Shot())
    expected = oracles.ecef_from_ned(LAT, LON) * oracles.body_in_ned(*ANGLES)
    np.testing.assert_allclose(pose.matrix, expected.as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_allclose(pose.origin_m, oracles.ecef(LAT, LON, HEIGHT), rtol=0, atol=4e-9)


def test_records_are_a_trajectory_at_its_samples():
    records = wj.Records(NEAR_LAT, NEAR_LON, HEIGHT, *ANGLES).pose(SHOT)
    sampled = wj.Trajectory.from_geodetic(TIME_S, NEAR_LAT, NEAR_LON, HEIGHT, *ANGLES, max_gap_s=1.5).pose(SHOT)
    np.testing.assert_allclose(records.matrix, sampled.matrix, rtol=0, atol=1e-14)
    np.testing.assert_allclose(records.origin_m, sampled.origin_m, rtol=0, atol=4e-9)


@pytest.mark.parametrize("axis", "xyz")
def test_readings_are_an_encoder_at_its_samples(axis):
    angle = ANGLES[0]
    for sign, zero in ((1, 0), (-1, 0.3)):
        read = wj.Turn(axis, wj.Readings(angle), sign, zero_rad=zero)
        recorded = wj.Turn(axis, wj.Encoder(TIME_S, angle, 1.5), sign, zero_rad=zero)
        np.testing.assert_allclose(read.pose(wj.Shot()).matrix, recorded.pose(SHOT).matrix, rtol=0, atol=1e-15)
        np.testing.assert_allclose(
            read.pose(SHOT).matrix, oracles.about(axis, sign * (angle + zero)).as_matrix(), rtol=0, atol=1e-15
        )


def test_records_made_ready_have_the_same_pose():
    records = wj.Records(LAT, LON, HEIGHT, *ANGLES)
    ready = records.ready(SHOT)
    assert isinstance(ready.lat_rad, Angle) and isinstance(ready.heading_rad, Angle)
    np.testing.assert_array_equal(ready.pose(SHOT).matrix, records.pose(SHOT).matrix)
    np.testing.assert_array_equal(ready.pose(SHOT).origin_m, records.pose(SHOT).origin_m)


def test_a_turn_made_ready_includes_sign_delay_and_index_error():
    turn = wj.Turn("y", wj.Encoder(TIME_S, ANGLES[1], 1.5), -1, delay_s=0.25, zero_rad=0.4)
    shot = wj.Shot(time_s=TIME_S[:-1] + 0.1)
    ready = turn.ready(shot)
    expected = oracles.about("y", -(np.interp(TIME_S[:-1] + 0.35, TIME_S, ANGLES[1]) + 0.4))
    np.testing.assert_allclose(ready.pose(shot).matrix, expected.as_matrix(), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(codes_of(ready.check(shot)), 0)


def test_structural_zeros_stay_and_a_level_platform_costs_less():
    level = wj.Records(LAT, LON, HEIGHT, heading_rad=ANGLES[2])
    assert level.roll_rad == 0 and isinstance(level.roll_rad, int)
    ready = level.ready(SHOT)
    assert isinstance(ready.roll_rad, int) and isinstance(ready.pitch_rad, int)
    expected = oracles.ecef_from_ned(LAT, LON) * oracles.body_in_ned(0.0, 0.0, ANGLES[2])
    np.testing.assert_allclose(ready.pose(SHOT).matrix, expected.as_matrix(), rtol=0, atol=1e-14)

    def products(*angles):
        return sum(
            e.primitive.name == "mul"
            for e in jax.make_jaxpr(lambda *a: wj.Records(LAT, LON, HEIGHT, *a).pose(SHOT))(*angles).eqns
        )

    full = products(*ANGLES)
    zero = sum(
        e.primitive.name == "mul"
        for e in jax.make_jaxpr(lambda h: wj.Records(LAT, LON, HEIGHT, heading_rad=h).pose(SHOT))(ANGLES[2]).eqns
    )
    assert zero <= full - 20


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_any_batch_shape(shape):
    rng = np.random.default_rng(3)
    parts = [rng.uniform(-1, 1, shape) for _ in range(6)]
    pose = wj.Records(parts[0], parts[1], 100 * parts[2], *parts[3:]).pose(wj.Shot())
    expected = oracles.ecef_from_ned(parts[0], parts[1]).as_matrix() @ oracles.body_in_ned(*parts[3:]).as_matrix()
    np.testing.assert_allclose(pose.matrix, expected.reshape(*shape, 3, 3), rtol=0, atol=1e-14)


def test_records_are_always_known_and_need_no_time():
    assert codes_of(wj.Records(LAT, LON, HEIGHT).check(wj.Shot())) == 0
    assert codes_of(wj.Turn("x", wj.Readings(ANGLES[0])).check(wj.Shot())) == 0


def test_derivatives_by_the_recorded_angles():
    from tests.derivatives import assert_derivatives

    def f(x):
        pose = wj.Records(x[0], x[1], x[2], x[3], x[4], x[5]).ready(wj.Shot()).pose(wj.Shot())
        return pose.matrix, pose.origin_m / 1e6

    assert_derivatives(f, [0.7, 1.2, 3000.0, 0.1, -0.2, 2.0], step=[0.01, 0.01, 100.0, 0.01, 0.01, 0.01], tolerance=1e-9)
