"""Pixels to a line and metres to a pixel, against the closed forms of a textbook pushbroom: v T f / h, h / f and v T."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.flights import pushbroom

CRAB_RAD = np.radians(10.0)
LEVEL = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture(scope="module")
def scene():
    """(sensor, shots, points) of twelve points of each view, over relief, with a drift angle."""
    rng = np.random.default_rng(3)
    point = np.column_stack([rng.uniform(2000, 2900, 12), rng.uniform(-400, 400, 12), rng.uniform(0, 400, 12)])
    time = np.concatenate([pushbroom.seen(point, angle, CRAB_RAD)[0] for angle in pushbroom.VIEW_RAD.values()])
    shot = wj.Shot(time_s=time, view=np.repeat(np.arange(3), 12))
    return pushbroom.sensor(CRAB_RAD), shot, np.tile(point, (3, 1))


def test_lines_of_6_m_and_pixels_of_1_m():
    """The worked example of docs/conventions.md: a line is 6 px, a pixel 1 m, whatever the view."""
    sensor, point = pushbroom.sensor(), np.array([[2500.0, 100.0, 0.0]])
    for view, angle in enumerate(pushbroom.VIEW_RAD.values()):
        shot = wj.Shot(time_s=pushbroom.seen(point, angle, 0.0)[0], view=np.array([view]))
        line = wj.px_per_line(sensor, shot, point, pushbroom.LINE_S)
        np.testing.assert_allclose(line, [[0.0, 6.0]], rtol=0, atol=1e-9)
        np.testing.assert_allclose(wj.m_per_px(sensor, shot, point, LEVEL), [[1.0, 1.0]], rtol=0, atol=1e-9)


def test_pixels_to_a_line_over_relief_and_with_a_drift_angle(scene):
    line = wj.px_per_line(*scene, np.full(36, pushbroom.LINE_S))
    np.testing.assert_allclose(line, pushbroom.px_per_line(scene[2], CRAB_RAD), rtol=1e-9, atol=1e-9)


def test_metres_to_a_pixel_and_to_a_line(scene):
    """h / f along both axes; the platform's way in a line, less what of it goes along the detector."""
    metres = wj.m_per_px(*scene, LEVEL)
    expected = (pushbroom.HEIGHT_M - scene[2][:, 2]) / pushbroom.FOCAL_PX
    np.testing.assert_allclose(metres, np.stack([expected, expected], axis=-1), rtol=1e-9, atol=0)
    across = metres[:, 1] * wj.px_per_line(*scene, pushbroom.LINE_S)[:, 1]
    np.testing.assert_allclose(across, np.full(36, 6.0 * np.cos(CRAB_RAD)), rtol=1e-9, atol=0)


def test_a_line_measured_too_late_is_a_residual_of_that_many_pixels(scene):
    """Measured - projected, both coordinates; the image of this scene moves evenly, so that the step may be a whole line."""
    sensor, shot, point = scene
    late = dataclasses.replace(shot, time_s=shot.time_s + pushbroom.LINE_S)
    residual = wj.project(sensor, shot, point).pixel_px - wj.project(sensor, late, point).pixel_px
    np.testing.assert_allclose(wj.px_per_line(*scene, pushbroom.LINE_S), residual, rtol=0, atol=1e-8)


def test_an_image_that_stands_still_is_refused(scene):
    sensor, shot, point = scene
    with pytest.raises(wj.SensorError, match=r"px_per_line: 36 of 36 \(from line to line the image moves.*first at index \(0,\)"):
        wj.px_per_line(sensor, shot, point, 1e-5)  # 6e-4 px to a line
    assert np.isnan(wj.px_per_line(sensor, shot, point, 1e-5, throw=False)).all()


def test_what_has_no_lines_or_no_place_is_refused(scene):
    sensor, shot, point = scene
    frame = wj.Sensor(dict(zip(sensor.names, sensor.links, strict=True)), wj.FrameCamera(1000.0, (0.0, 0.0)))
    with pytest.raises(wj.WhiskjaxError, match="a frame camera has rows, not lines"):
        wj.px_per_line(frame, shot, point, 0.1)
    above = point + np.array([0.0, 0.0, 5000.0])
    for ask in (lambda p: wj.px_per_line(sensor, shot, p, 0.1), lambda p: wj.m_per_px(sensor, shot, p, LEVEL)):
        with pytest.raises(wj.SensorError, match="behind the camera"):
            ask(above)
        with pytest.raises(wj.WhiskjaxError, match="point_m has dtype float32"):
            ask(point.astype(np.float32))
        with pytest.raises(wj.WhiskjaxError, match=r"point_m has shape \(36, 2\)"):
            ask(point[:, :2])
