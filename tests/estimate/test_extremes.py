"""Numbers of a size that nothing can be reckoned with: the verbs refuse them by name, whether they may raise or not."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.block.frames import POS, frames

R = dataclasses.replace


def changed(array, index, value):
    out = np.array(array)
    out[index] = value
    return out


@pytest.mark.parametrize("value", [1e200, 1e-200, np.inf, 0.0])
def test_a_sigma_of_a_measurement(flight, value):
    seen, (sensor, block, *_) = flight.observations(), frames()
    with pytest.raises(wj.WhiskjaxError, match="observation 7, image L1, point L1-08: sigma_px"):
        R(seen, sigma_px=changed(seen.sigma_px, (7, 1), value))
    sigma = changed(block.sigma_px, (30, 0), value)
    with pytest.raises(wj.WhiskjaxError, match="ray 30, image im1, point P6: sigma_px"):
        R(block, sigma_px=sigma)
    with pytest.raises(wj.WhiskjaxError, match=r"intersect.*sigma_px"):
        wj.intersect(sensor, block.shot, block.pixel_px, block.point, sigma, throw=False)
    with pytest.raises(wj.WhiskjaxError, match="sigma_px"):
        wj.Looks(wj.Shot(time_s=np.arange(3.0)), np.zeros((3, 2)), changed(np.ones((3, 2)), (1, 0), value))


def test_a_covariance_of_points(flight):
    seen, block = flight.observations(), frames()[1]
    odd = np.diag([1.0, 1.0, -1.0])
    with pytest.raises(wj.WhiskjaxError, match="observation 3, image L1, point L1-04: point_covariance_m2 is no covariance"):
        R(seen, point_covariance_m2=changed(seen.point_covariance_m2, 3, odd))
    with pytest.raises(wj.WhiskjaxError, match="point P1: covariance_m2 is no covariance"):
        R(block, covariance_m2=changed(block.covariance_m2, 1, odd))
    R(block, covariance_m2=changed(block.covariance_m2, 7, odd))  # a tie point, whose covariance is not read
    with pytest.raises(wj.WhiskjaxError, match=r"guess: .*covariance"):
        wj.Guess(np.zeros(3), odd)


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"mean": 0.0, "sigma": 1e200}, "unknown x: its prior sigma is 1e.200"),
        ({"mean": 0.0, "sigma": 1e-200}, "unknown x: its prior sigma is 1e-200"),
        ({"scale": 1e200}, "unknown x: its scale is 1e.200"),
        ({"mean": 1e300, "sigma": 1.0}, "Unknown x: mean is 1e.300"),
    ],
)
def test_a_prior(given, match):
    with pytest.raises(wj.WhiskjaxError, match=match):
        wj.Unknown("x", "sensor.angles_rad[0]", **given)


def test_a_start_that_is_nowhere_near_its_prior(flight):
    """A metre from a mean that is known to 1e-20 m."""
    held = [R(flight.unknowns[0], mean=1.0, sigma=1e-20), *flight.unknowns[1:]]
    with pytest.raises(wj.WhiskjaxError, match=r"unknown u_gps: the sensor starts at 0, 1e\+20 prior sigmas"):
        wj.calibrate(flight.sensor, flight.observations(), held, throw=False)


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("turn_sigma_rad", (1e200, 0.0, 0.0), "turn_sigma_rad is 1e.200"),
        ("shift_sigma_m", (1.0, 1.0, 1e-200), "the sigma of shift z is 1e-200"),
        ("correlation_s", (0.0, 1e200, 0.0, 0.0, 0.0, 0.0), "correlation_s of turn y is 1e.200"),
    ],
)
def test_errors_of_a_frame(field, value, match):
    with pytest.raises(wj.WhiskjaxError, match=match):
        wj.FrameErrors("photo", **{field: value}).check(frames()[0])


@pytest.mark.parametrize("focal_px", [1e300, 1e160, 1e-300, np.inf])
@pytest.mark.parametrize("throw", [True, False])
def test_a_focal_length(flight, focal_px, throw):
    """Its place is named as files and unknowns name it."""
    options = lambda s: [camera.focal_px for camera in s.camera.options]
    broken = eqx.tree_at(options, flight.sensor, [np.asarray(10750.0), np.asarray(focal_px)])
    said = "camera.right.focal_px is "
    for how in ({}, {"blunders": wj.Blunders()}, {"reweigh": wj.Reweigh()}, {"loss": wj.Huber()}):
        with pytest.raises(wj.WhiskjaxError, match=f"calibrate: {said}"):
            wj.calibrate(broken, flight.observations(), flight.unknowns, throw=throw, **how)
    with pytest.raises(wj.WhiskjaxError, match=said):
        wj.calibrate_batch([(broken, flight.observations())], flight.unknowns)
    sensor, block, _, truth = frames()
    broken = eqx.tree_at(lambda s: s.camera.focal_px, sensor, np.asarray(focal_px))
    for start in (None, truth):
        with pytest.raises(wj.WhiskjaxError, match=r"adjust: camera.focal_px is "):
            wj.adjust(broken, block, errors=POS, start_m=start, throw=throw)
    with pytest.raises(wj.WhiskjaxError, match=r"intersect: camera.focal_px is "):
        wj.intersect(broken, block.shot, block.pixel_px, block.point, throw=throw)
    looks = wj.Looks(wj.Shot(image=block.key("image")), block.pixel_px, np.ones(2))
    with pytest.raises(wj.WhiskjaxError, match=r"locate: camera.focal_px is "):
        wj.locate(broken, looks, guess=wj.Guess.around(truth[0], np.ones(3)), throw=throw)


@pytest.mark.parametrize("focal_px", [1e9, 1e25, 1e-20])
def test_a_focal_length_that_is_only_wrong_ends_as_a_calibration_that_is_not_sound(flight, focal_px):
    """No foreign error, though residuals are 1e25 px: nothing converges, or the residuals say so."""
    options = lambda s: [camera.focal_px for camera in s.camera.options]
    odd = eqx.tree_at(options, flight.sensor, [np.asarray(focal_px)] * 2)
    for how in ({}, {"blunders": wj.Blunders()}, {"loss": wj.Huber()}):
        assert not wj.calibrate(odd, flight.observations(), flight.unknowns, throw=False, **how).is_sound


def test_pixels_and_places(flight):
    seen, block = flight.observations(), frames()[1]
    for name, given, label in (("pixel_px", seen, "observation 4, image L1"), ("point_m", seen, "observation 4, image L1")):
        with pytest.raises(wj.WhiskjaxError, match=rf"{label}, point L1-05: {name} holds 1e\+200"):
            R(given, **{name: changed(getattr(given, name), (4, 0), 1e200)})
    with pytest.raises(wj.WhiskjaxError, match=r"ray 4, image im0, point P4: pixel_px holds 1e\+200"):
        R(block, pixel_px=changed(block.pixel_px, (4, 0), 1e200))
    with pytest.raises(wj.WhiskjaxError, match=r"point P2: position_m holds 1e\+200"):
        R(block, position_m=changed(block.position_m, (2, 0), 1e200))
