"""Measurements that the camera cannot have made, and numbers of a camera that are none: refused, or not called sound."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.detector import lies_beside

# Six points below a camera that looks down from 1000 m; the last is a check point.
POINT_M = np.array([[10.0, 0, 0], [0, 10, 0], [-10, -5, 0], [5, 5, 1], [300, 200, 0], [-250, 100, 3]])
FRAME = wj.FrameCamera(3000.0, (0.0, 0.0))
LINE = wj.LineCamera(3000.0)
SHOT = wj.Shot(time_s=np.zeros(6))


def above(camera):
    return wj.Sensor({"mount": wj.Mount([0, 0, 1000.0], [0.0, 0, 0])}, camera)


def seen(camera, pixel_px=None, factor=1.0):
    """What the camera measures with a noise of 1 px, times a factor, or other pixels."""
    if pixel_px is None:
        noise = np.random.default_rng(0).normal(size=(6, 2))
        pixel_px = factor * np.asarray(wj.project(above(camera), SHOT, POINT_M).pixel_px) + noise
    return wj.Observations(SHOT, POINT_M, pixel_px, np.ones((6, 2)), np.array([True] * 5 + [False]))


@pytest.mark.parametrize("unknown", [{"mean": 3000.0, "sigma": 3000.0}, {"scale": 1000.0}], ids=["prior", "free"])
def test_a_mirrored_image_is_no_negative_focal_length(unknown):
    """The check point agrees, and every point lies in front: only the sign of the focal length tells."""
    unknowns = [wj.Unknown("f", "camera.focal_px", **unknown)]
    found = wj.calibrate(above(FRAME), seen(FRAME, factor=-1.0), unknowns, throw=False)
    assert found.value[0] == pytest.approx(-3000.0, abs=10.0) and not found.is_sound
    assert found.result == wj.RESULTS.no_focal_length and "the focal length is not positive" in found.warnings[0]
    with pytest.raises(wj.SensorError, match="the focal length is not positive: the image is turned by 180"):
        wj.calibrate(above(FRAME), seen(FRAME, factor=-1.0), unknowns)
    assert not wj.calibrate_batch([(above(FRAME), seen(FRAME, factor=-1.0))], unknowns).is_successful.any()
    assert wj.calibrate(above(FRAME), seen(FRAME), unknowns).is_sound


def test_mirrored_samples_of_a_line_camera_are_none_either():
    pixel = np.array([-1.0, 1.0]) * np.asarray(wj.project(above(LINE), SHOT, POINT_M).pixel_px)
    found = wj.calibrate(
        above(LINE),
        dataclasses.replace(seen(LINE, pixel), sigma_px=np.tile([1.0, 1e6], (6, 1))),
        [wj.Unknown("f", "camera.focal_px", scale=1000.0)],
        throw=False,
    )
    assert not found.is_sound and found.result == wj.RESULTS.no_focal_length


@pytest.mark.parametrize("focal_px", [-3000.0, 0.0])
def test_no_image_at_a_focal_length_that_is_none(focal_px):
    wrong = wj.assign(above(FRAME), [wj.Unknown("f", "camera.focal_px", scale=1.0)], [focal_px])
    with pytest.raises(wj.SensorError, match="the focal length is not positive"):
        wj.project(wrong, SHOT, POINT_M)


def test_a_prior_mean_that_is_no_focal_length_is_refused():
    with pytest.raises(wj.WhiskjaxError, match=r"Unknown f: mean is -3000; it must be above 0"):
        wj.Unknown("f", "camera.focal_px", mean=-3000.0, sigma=1.0)


@pytest.mark.parametrize("where", ["along_sign", "across_sign", "half_width_px", "samples_px[0]"])
def test_what_a_camera_is_given_cannot_be_estimated(where):
    camera = wj.LineCamera(3000.0, half_width_px=1000.0, samples_px=(-1000.0, 1000.0))
    with pytest.raises(wj.WhiskjaxError, match=f"camera.{where.split('[')[0]}.* is not a number that can be estimated"):
        wj.calibrate(above(camera), seen(LINE), [wj.Unknown("q", f"camera.{where}", scale=1.0)])


# A frame whose middle is its pixel (0, 0) does not exist: of these, the principal point lies in the middle.
SIZED = wj.FrameCamera(3000.0, (1000.0, 750.0), size_px=(2000, 1500))
SWATH = wj.LineCamera(3000.0, samples_px=(-1000.0, 1000.0))
LEVER = [wj.Unknown("x", "mount.lever_arm_m[0]", 0.0, 1.0)]


def blocks(pixel_px):
    return wj.Block(
        SHOT, pixel_px, np.ones((6, 2)), np.arange(6), POINT_M, np.tile(np.eye(3), (6, 1, 1)), np.array(["control"] * 6)
    )


VERBS = {
    "calibrate": lambda sensor, pixel: wj.calibrate(sensor, seen(SIZED, pixel), LEVER, throw=False),
    "adjust": lambda sensor, pixel: wj.adjust(sensor, blocks(pixel), LEVER, throw=False),
    "locate": lambda sensor, pixel: wj.locate(
        sensor,
        wj.Looks(wj.Shot(time_s=np.arange(6.0)), pixel, (1.0, 1.0)),
        surface=wj.Plane([0.0, 0, 0], [0.0, 0, 1]),
        sigma_enu_m=(9.0, 9, 9),
        throw=False,
    ),
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("wrong_px", [(-9999.0, 700.0), (700.0, 1900.0)], ids=["missing data", "column and row exchanged"])
def test_pixels_far_beside_the_detector_are_named_by_every_verb(verb, wrong_px):
    pixel = np.array(wj.project(above(SIZED), SHOT, POINT_M).pixel_px)
    pixel[2] = wrong_px
    label = {"adjust": "ray 2, point 2", "locate": "look 2"}.get(verb, "observation 2")
    said = [text for text in VERBS[verb](above(SIZED), pixel).warnings if "beside the detector" in text]
    assert said == [f"{label} lies far beside the detector: are line and sample exchanged, does a number stand for missing data, "
                    "or has the detector another size?"]  # fmt: skip


def test_a_detector_of_another_size_is_named():
    camera = wj.FrameCamera(3000.0, (0.0, 0.0), size_px=(20, 20))
    (said,) = [text for text in wj.calibrate(above(camera), seen(FRAME), LEVER).warnings if "beside" in text]
    assert said.startswith("observation 0 lies far beside the detector (5 of 6 do): ")


def test_samples_are_asked_of_a_line_camera_and_lines_are_not():
    pixel = np.array(wj.project(above(SWATH), SHOT, POINT_M).pixel_px)
    assert np.abs(pixel[:, 1]).max() > 500  # across the line anything is a time
    assert "beside" not in str(wj.calibrate(above(SWATH), seen(SWATH, pixel), LEVER).warnings)
    pixel[3, 0] = 1500.0
    assert "observation 3 lies far beside" in str(wj.calibrate(above(SWATH), seen(SWATH, pixel), LEVER).warnings)


def test_marks_at_the_rim_are_measurements():
    rim = np.array([[0.0, 0, 0], [340, 0, 0], [-340, 0, 0], [0, 255, 0], [0, -255, 0]])  # the frame ends at 333 m and 250 m
    pixel = np.array(wj.project(above(SIZED), wj.Shot(), rim).pixel_px)
    assert (pixel > [2000, 1500]).any() and (pixel < 0).any()
    assert not lies_beside(above(SIZED), wj.Shot(), pixel).any()
    pixel[1] = -9999.0
    assert lies_beside(above(SIZED), wj.Shot(), pixel).tolist() == [False, True, False, False, False]


def test_pixels_that_the_lens_does_not_make_are_refused_before_they_spoil_an_adjustment():
    camera = wj.FrameCamera(3000.0, (0.0, 0.0), distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    pixel = np.array(wj.project(above(camera), SHOT, POINT_M).pixel_px)
    pixel[1] = (-9999.0, -9999.0)
    with pytest.raises(wj.SensorError, match=r"ray 1, point 1, measured at \(-9999, -9999\) px: .*distortion can be undone"):
        wj.adjust(above(camera), blocks(pixel), LEVER)
