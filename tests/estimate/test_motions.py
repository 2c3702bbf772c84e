"""Unknowns of corrections: their names, places and priors."""

import math

import numpy as np
import pytest

import whiskjax as wj

MOUNT = wj.Mount(lever_arm_m=[0.0, 0.0, 100.0])
CAMERA = wj.FrameCamera(1000.0, (0.0, 0.0))


def sensor(link):
    return wj.Sensor({"station": MOUNT, "pos": link}, CAMERA)


def told(unknowns):
    return [(x.name, x.where, x.mean, x.sigma) for x in unknowns]


def test_a_bias_has_an_unknown_for_every_axis():
    found = wj.motion_unknowns(
        sensor(wj.Correction(wj.Bias())), "pos", turn_sigma_rad=(0.1, 0.2, 0.3), shift_sigma_m=(1.0, 2.0, 3.0)
    )
    assert told(found) == [
        ("pos_turn_x", "pos.turn_rad[0,0]", 0.0, 0.1),
        ("pos_turn_y", "pos.turn_rad[0,1]", 0.0, 0.2),
        ("pos_turn_z", "pos.turn_rad[0,2]", 0.0, 0.3),
        ("pos_shift_x", "pos.shift_m[0,0]", 0.0, 1.0),
        ("pos_shift_y", "pos.shift_m[0,1]", 0.0, 2.0),
        ("pos_shift_z", "pos.shift_m[0,2]", 0.0, 3.0),
    ]


def test_a_sigma_of_zero_leaves_the_axis_out():
    found = wj.motion_unknowns(sensor(wj.Correction(wj.Bias())), "pos", turn_sigma_rad=(0.0, 0.2, 0.0))
    assert told(found) == [("pos_turn_y", "pos.turn_rad[0,1]", 0.0, 0.2)]


def test_every_coefficient_of_a_basis_or_the_chosen_ones():
    drift = sensor(wj.Correction(wj.Drift(0.0, 10.0)))
    both = wj.motion_unknowns(drift, "pos", turn_sigma_rad=(0.0, 0.0, 0.3))
    assert told(both) == [("pos_turn_z0", "pos.turn_rad[0,2]", 0.0, 0.3), ("pos_turn_z1", "pos.turn_rad[1,2]", 0.0, 0.3)]
    change = wj.motion_unknowns(drift, "pos", turn_sigma_rad=(0.0, 0.0, 0.3), coefficients=(1,))
    assert told(change) == [("pos_turn_z1", "pos.turn_rad[1,2]", 0.0, 0.3)]
    process = wj.Process.random_walk(np.arange(7.0))
    walk = wj.motion_unknowns(sensor(wj.Correction(process)), "pos", shift_sigma_m=(1.0, 0.0, 1.0))
    assert [x.where for x in walk] == [f"pos.shift_m[{k},{axis}]" for k in range(7) for axis in (0, 2)]


def test_each_option_of_a_by_has_its_own():
    by = wj.By("image", {"L1": wj.Correction(wj.Bias()), "R1": wj.Correction(wj.Drift(0.0, 1.0))})
    found = wj.motion_unknowns(sensor(by), "pos", shift_sigma_m=(0.5, 0.0, 0.0))
    assert told(found) == [
        ("pos_L1_shift_x", "pos.L1.shift_m[0,0]", 0.0, 0.5),
        ("pos_R1_shift_x0", "pos.R1.shift_m[0,0]", 0.0, 0.5),
        ("pos_R1_shift_x1", "pos.R1.shift_m[1,0]", 0.0, 0.5),
    ]


def test_they_are_places_in_the_sensor():
    """Each moves the image as its name says: the station 1 m along an axis, or 1 mrad about it."""
    it = sensor(wj.Correction(wj.Bias()))
    unknowns = wj.motion_unknowns(it, "pos", turn_sigma_rad=(1.0, 1.0, 1.0), shift_sigma_m=(1.0, 1.0, 1.0))
    shot, point = wj.Shot(time_s=0.0), np.array([0.0, 0.0, 0.0])
    # 100 m away at 1000 px: 10 px a metre, 1 px a mrad; the camera looks along -z.
    expected = {
        "pos_turn_x": (0.0, -1.0),
        "pos_turn_y": (1.0, 0.0),
        "pos_turn_z": (0.0, 0.0),
        "pos_shift_x": (-10.0, 0.0),
        "pos_shift_y": (0.0, -10.0),
        "pos_shift_z": (0.0, 0.0),
    }
    zero = np.asarray(wj.project(wj.assign(it, unknowns, np.zeros(6)), shot, point).pixel_px)
    for i, x in enumerate(unknowns):
        size = 1e-3 if "turn" in x.name else 1.0
        moved = wj.project(wj.assign(it, unknowns, size * np.eye(6)[i]), shot, point).pixel_px - zero
        # The camera's rows may run down: only the size of y is asked here.
        np.testing.assert_allclose(np.abs(moved), np.abs(expected[x.name]), rtol=0, atol=1e-5)


BIAS = wj.Correction(wj.Bias())


@pytest.mark.parametrize(
    "link, sigmas, message",
    [
        (BIAS, {}, "pos: all sigmas are zero, so there is nothing to estimate"),
        (wj.Mount(), {"shift_sigma_m": (1.0, 1.0, 1.0)}, "pos is a Mount, and only a Correction makes motions"),
        (wj.By("image", {"a": BIAS, "b": wj.Mount()}), {"shift_sigma_m": (1.0, 1.0, 1.0)}, "Mount, and only a Correction"),
        (
            BIAS,
            {"shift_sigma_m": (1.0, -1.0, 0.0)},
            r"motion_unknowns: shift_sigma_m is -1 at index \(1,\); it must be 0 or more",
        ),
        (BIAS, {"turn_sigma_rad": (math.nan, 1.0, 0.0)}, "turn_sigma_rad holds no finite number"),
        (BIAS, {"turn_sigma_rad": (1.0, 2.0)}, r"turn_sigma_rad has shape \(2,\), expected \(3,\)"),
    ],
)
def test_motions_that_make_no_sense(link, sigmas, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.motion_unknowns(sensor(link), "pos", **sigmas)


def test_a_coefficient_that_is_not_there_has_no_place():
    beyond = wj.motion_unknowns(sensor(BIAS), "pos", turn_sigma_rad=(1.0, 0.0, 0.0), coefficients=(1,))
    with pytest.raises(wj.WhiskjaxError, match=r"pos.turn_deg\[1,0\]: the array there has shape \(1, 3\)"):
        wj.assign(sensor(BIAS), beyond, [0.0])


def test_a_link_that_is_not_there():
    with pytest.raises(wj.WhiskjaxError, match="no link named 'drift'; there are station, pos"):
        wj.motion_unknowns(sensor(BIAS), "drift", shift_sigma_m=(1.0, 1.0, 1.0))
