"""Sensors: named links from the Earth to the camera."""

import jax
import numpy as np
import pytest

import whiskjax as wj

CAMERA = wj.LineCamera(1000.0)
MOUNT = wj.Mount(lever_arm_m=[1.0, 2.0, 3.0], angles_rad=[0.1, 0.2, 0.3])
AXES = wj.Axes("x -y -z")
R = wj.RESULTS


def by(key, *names):
    return wj.By(key, {name: wj.Mount() for name in names})


def test_links_keep_their_order_and_names():
    sensor = wj.Sensor({"z": MOUNT, "a": AXES, "m": MOUNT}, CAMERA)
    assert sensor.names == ("z", "a", "m")
    assert sensor["a"] is AXES and sensor["camera"] is CAMERA
    # A pytree of dicts would come back sorted.
    assert jax.tree.map(lambda x: x, sensor).names == ("z", "a", "m")


def test_the_pose_is_the_product_down_to_a_frame():
    sensor = wj.Sensor({"z": MOUNT, "a": AXES, "m": MOUNT}, CAMERA)
    shot = wj.Shot()
    m, a = MOUNT.pose(shot), AXES.pose(shot)
    for upto, expected in (("z", m), ("a", m @ a), ("m", m @ a @ m), (None, m @ a @ m)):
        pose = sensor.pose(shot, upto)
        np.testing.assert_allclose(pose.matrix, expected.matrix, rtol=0, atol=1e-15)
        np.testing.assert_allclose(pose.origin_m, expected.origin_m, rtol=0, atol=1e-14)
    with pytest.raises(wj.WhiskjaxError, match="no frame named 'b'; there are z, a, m"):
        sensor.pose(shot, "b")


def test_a_name_that_is_not_there_lists_those_that_are():
    with pytest.raises(wj.WhiskjaxError, match="no link named 'platform'; there are z, a"):
        wj.Sensor({"z": MOUNT, "a": AXES}, CAMERA)["platform"]


@pytest.mark.parametrize(
    "links, message",
    [
        ({}, "at least one link"),
        ({"the body": MOUNT}, "'the body' cannot name a frame"),
        ({"camera": MOUNT}, "'camera' cannot name a frame"),
        ({"earth": MOUNT}, "'earth' cannot name a frame"),
        ({"body": CAMERA}, "body: a link is needed here, not LineCamera"),
        ({"a": by("swing", "left", "right"), "b": by("swing", "right", "left")}, "b: the swings are .*use one order"),
    ],
)
def test_a_wrong_sensor_is_refused(links, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Sensor(links, CAMERA)


def test_key_names_come_from_links_and_camera():
    cameras = wj.By("view", {"nadir": CAMERA, "back": CAMERA})
    sensor = wj.Sensor({"a": by("swing", "left", "right"), "b": by("swing", "left", "right")}, cameras)
    assert sensor.key_names() == {"swing": ("left", "right"), "view": ("nadir", "back")}


def test_key_names_look_inside_options():
    """A shot has to name every key that some link asks for, however deep it stands."""
    nested = wj.By("swing", {"left": by("view", "nadir", "back"), "right": wj.Mount()})
    assert wj.Sensor({"a": nested}, CAMERA).key_names() == {"swing": ("left", "right"), "view": ("nadir", "back")}


def test_the_first_failing_link_is_reported():
    turn = wj.Turn("x", wj.Encoder([0.0, 1.0, 5.0], [0.0, 0.0, 0.0], 2.0))
    sensor = wj.Sensor({"a": turn, "b": by("swing", "left", "right")}, CAMERA)
    swing = np.array([0, 0, 0, 5, 5])
    result = sensor.check(wj.Shot(time_s=np.array([0.5, 3.0, 9.0, 0.5, 3.0]), swing=swing))
    codes = np.asarray(jax.tree.leaves(result)[0])
    expected = [R.successful, R.time_in_gap, R.time_outside_trajectory, R.unknown_key, R.time_in_gap]
    np.testing.assert_array_equal(codes, [int(jax.tree.leaves(r)[0]) for r in expected])


def test_a_link_is_added_behind_a_frame():
    """Everything that stood further in stands behind it."""
    correction = wj.Correction(wj.Bias(), shift_m=[[10.0, 20.0, 30.0]])
    sensor = wj.Sensor({"z": MOUNT, "a": AXES, "m": MOUNT}, CAMERA)
    shot = wj.Shot(time_s=0.0)
    for frame, names in (("z", ("z", "new", "a", "m")), ("a", ("z", "a", "new", "m")), ("m", ("z", "a", "m", "new"))):
        longer = sensor.after(frame, "new", correction)
        assert longer.names == names
        assert longer["new"] is correction and longer["camera"] is CAMERA and longer["a"] is AXES
        expected = sensor.pose(shot, frame) @ correction.pose(shot)
        np.testing.assert_allclose(longer.pose(shot, "new").matrix, expected.matrix, rtol=0, atol=1e-15)
        np.testing.assert_allclose(longer.pose(shot, "new").origin_m, expected.origin_m, rtol=0, atol=1e-13)
    assert sensor.names == ("z", "a", "m")


def test_a_correction_of_zero_behind_a_frame_changes_no_image():
    camera = wj.FrameCamera(1000.0, (0.0, 0.0))
    sensor = wj.Sensor({"station": wj.Mount(lever_arm_m=[0.0, 0.0, 100.0]), "camera_mount": wj.Mount()}, camera)
    point = np.array([3.0, -4.0, 5.0])
    shot = wj.Shot(time_s=0.0)
    plain = wj.project(sensor, shot, point).pixel_px
    none = sensor.after("station", "bias", wj.Correction(wj.Bias(), np.zeros((1, 3)), np.zeros((1, 3))))
    np.testing.assert_allclose(wj.project(none, shot, point).pixel_px, plain, rtol=0, atol=1e-12)
    moved = sensor.after("station", "bias", wj.Correction(wj.Bias(), shift_m=[[3.0, -4.0, 0.0]]))
    np.testing.assert_allclose(wj.project(moved, shot, point).pixel_px, [0.0, 0.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "frame, name, link, message",
    [
        ("b", "new", MOUNT, "no frame named 'b'; there are z, a"),
        ("camera", "new", MOUNT, "no frame named 'camera'; there are z, a"),
        ("z", "a", MOUNT, "already a link named 'a'"),
        ("z", "earth", MOUNT, "'earth' cannot name a frame"),
        ("z", "new", CAMERA, "new: a link is needed here, not LineCamera"),
    ],
)
def test_a_link_that_cannot_be_added_is_refused(frame, name, link, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.Sensor({"z": MOUNT, "a": AXES}, CAMERA).after(frame, name, link)
