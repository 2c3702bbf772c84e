"""A solution whose sensor cannot have made its own observations is none, and says which of them."""

import numpy as np
import pytest

import whiskjax as wj

TIME_S = np.arange(0.0, 4.0, 0.1)
DELAY_S = 0.5


def sensor(record, delay_s=0.0):
    """A frame camera that looks down from 1000 m, along a straight line: the pose is known where there is a record."""
    time = TIME_S[record]
    place = np.stack([60.0 * time, 5.0 * time, 1000.0 + 0 * time], -1)
    body = wj.Trajectory(time, place, np.tile([0.0, 0, 0, 1], (len(time), 1)), max_gap_s=0.2, delay_s=delay_s)
    return wj.Sensor({"body": body}, wj.FrameCamera(2000.0, (0.0, 0.0)))


@pytest.fixture(scope="module")
def late():
    """What a sensor half a second late has seen, and a record that ends with the last image: at the delay that the images ask
    for, the last three were taken after it."""
    shot = wj.Shot(time_s=np.linspace(1.05, 3.0, 16))
    pixel = np.random.default_rng(1).uniform(-400, 400, (16, 2))
    true = sensor(slice(None), DELAY_S)
    point = np.asarray(wj.image_to_ground(true, shot, pixel, wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))).point_m)
    seen = wj.Observations(shot, point, pixel, np.ones((16, 2)), np.ones(16, bool))
    after = np.asarray(shot.time_s) + DELAY_S > TIME_S[32]
    assert after.sum() == 3 and after[-3:].all()
    return sensor(slice(33)), seen


UNKNOWN = [wj.Unknown("delay", "body.delay_s", 0.0, 1.0)]


def test_a_calibration_that_leaves_the_record_is_refused_by_name(late):
    start, seen = late
    with pytest.raises(wj.SensorError, match=r"where the iteration ended, observation 13: .*outside .* \(3 of 16 obs"):
        wj.calibrate(start, seen, UNKNOWN)
    found = wj.calibrate(start, seen, UNKNOWN, throw=False)
    assert found.value[0] == pytest.approx(DELAY_S, abs=1e-3)  # it is where the images lead
    assert found.result == wj.RESULTS.time_outside_trajectory and not found.is_sound
    assert found.warnings[0].startswith("where the iteration ended, observation 13: ")


def test_a_lane_that_leaves_the_record_fails(late):
    start, seen = late
    found = wj.calibrate_batch([(start, seen)], UNKNOWN)
    assert not found.is_successful.any() and (found.result == wj.RESULTS.time_outside_trajectory).all()


def test_images_of_a_sensor_that_cannot_make_them_are_refused(late):
    start, seen = late
    assert np.isfinite(wj.images_of(start, seen, UNKNOWN, np.array([[0.0], [0.1]]))).all()
    with pytest.raises(wj.SensorError, match=r"images_of: values 1: observation 13: .* \(3 of 16 obs"):
        wj.images_of(start, seen, UNKNOWN, np.array([[0.0], [DELAY_S]]))
