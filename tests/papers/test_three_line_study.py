"""The study of Wang et al. (2018): the matching truth, wrong ties, control points, attitude, against loops and scipy."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from whiskjax.chain.correction import Correction
from whiskjax.flights import songshan, songshan_draw
from whiskjax.papers.three_line.printed import PRINTED, TABLE_3, Row, contradictions
from whiskjax.papers.three_line.runs import limited
from whiskjax.papers.three_line.study import WRONG_PX, attitude_rms_rad, spoil, spread_control

SCENE = songshan.Scene("B", ties=100, pos_hz=20.0)


@pytest.fixture(scope="module")
def drawn():
    return songshan.simulate_block(SCENE, 2)


@pytest.fixture(scope="module")
def matching():
    return songshan.simulate_block(dataclasses.replace(SCENE, truth="matching"), 2)


def test_a_truth_is_rough_or_matching():
    with pytest.raises(wj.WhiskjaxError, match="truth is one of rough, matching, not 'smooth'"):
        songshan.Scene(truth="smooth")


@pytest.mark.parametrize("view", songshan.VIEWS)
def test_the_matching_detector_is_a_cubic(view):
    """A cubic fits it to rounding, and the rough one to no better than its wave."""
    sample = np.linspace(0, songshan_draw.LINE_PX - 1, 4001)
    s = sample / songshan_draw.CENTRE_PX - 1
    for cubic, low, high in ((True, 0.0, 1e-9), (False, 0.1, 0.3)):
        for d in songshan_draw.deformation_px(view, sample, cubic):
            left = d - np.polynomial.Polynomial.fit(s, d, 3)(s)
            assert low <= np.sqrt((left**2).mean()) <= high


def test_rays_of_a_matching_truth_are_those_of_its_corrections(matching):
    """What was measured projects back to noise through the truth, and no pose of it is off by more than the sigmas allow."""
    block, noise = matching.block, songshan_draw.NOISE["nominal"]
    projected = wj.project(matching.truth, block.shot, matching.point_m[block.point])
    error = (block.pixel_px - np.asarray(projected.pixel_px)) / block.sigma_px
    assert noise.tie_px == 0.5
    np.testing.assert_allclose((error**2).mean(axis=0), 1.0, rtol=0, atol=5 * np.sqrt(2 / len(block)))
    link = matching.truth["pos_error"]
    assert isinstance(link, Correction)
    for drawn_values, sigma in (
        (link.turn_rad, songshan_draw.ATTITUDE_SIGMA_RAD),
        (link.shift_m, songshan_draw.POS_SIGMA_M),
    ):
        size = np.sqrt((np.asarray(drawn_values) ** 2).mean(axis=0)) / sigma
        assert ((0.2 < size) & (size < 2.0)).all()  # two strips of strongly correlated errors


def test_the_same_seed_draws_the_same_matching_truth(matching):
    again = songshan.simulate_block(dataclasses.replace(SCENE, truth="matching"), 2)
    np.testing.assert_array_equal(again.block.pixel_px, matching.block.pixel_px)


def test_wrong_ties_are_one_ray_each(drawn):
    block, wrong = spoil(drawn.block, 3)
    moved = np.column_stack([block.pixel_px[:, 0] - drawn.block.pixel_px[:, 0], block.key("time_s") - drawn.block.key("time_s")])
    moved[:, 1] /= songshan.LINE_S
    rays = np.flatnonzero(moved.any(axis=1))
    assert wrong.sum() == 5 and (block.role[wrong] == "tie").all()
    assert sorted(block.point[rays]) == np.flatnonzero(wrong).tolist()
    assert np.abs(moved).max() <= WRONG_PX and np.abs(moved[rays]).mean() == pytest.approx(WRONG_PX / 2, rel=0.6)
    np.testing.assert_array_equal(block.key("view"), drawn.block.key("view"))
    np.testing.assert_array_equal(spoil(drawn.block, 3)[0].pixel_px, block.pixel_px)


@pytest.mark.parametrize("count", [3, 11])
def test_control_points_are_spread(drawn, count):
    """Each is the farthest from those before, by a textbook loop; the first lies farthest out."""
    block, chosen = drawn.block, spread_control(drawn.block, count)
    control = [i for i, role in enumerate(block.role) if role == "control"]
    plan = block.position_m[:, :2]
    centre = plan[control].mean(axis=0)
    assert len(set(chosen.tolist())) == count and set(chosen.tolist()) <= set(control)
    assert chosen[0] == max(control, key=lambda i: np.hypot(*(plan[i] - centre)))
    for k in range(1, count):
        nearest = {i: min(np.hypot(*(plan[i] - plan[j])) for j in chosen[:k]) for i in control}
        assert nearest[chosen[k]] == max(nearest.values())


def test_attitude_error_is_the_angle_scipy_finds(drawn):
    """A constant turn of the body by known angles: their root mean square."""
    turn = np.radians([0.01, -0.02, 0.03])
    link = drawn.sensor["pos_error"]
    assert isinstance(link, Correction)
    turned = Correction(link.basis, np.tile(turn, (link.basis.size, 1)))
    turned = wj.Sensor({"body": drawn.sensor["body"], "pos_error": turned}, drawn.sensor.camera)
    expected = np.sqrt((Rotation.from_rotvec(turn).as_rotvec() ** 2).mean())
    assert attitude_rms_rad(SCENE, turned, drawn.sensor, "body") == pytest.approx(expected, rel=1e-5)
    assert attitude_rms_rad(SCENE, drawn.sensor, drawn.sensor, "camera") == pytest.approx(0.0, abs=1e-12)


def test_the_cameras_attitude_has_the_boresight_in_it(drawn):
    """Recorded and true body with the same pose: what differs is the boresight, R_c^b = Rx Ry Rz."""
    laboratory = wj.Sensor({name: drawn.sensor[name] for name in drawn.sensor.names}, drawn.sensor.camera)
    mounted = laboratory.links[:2] + drawn.truth.links[1:]
    true = wj.Sensor(dict(zip(laboratory.names, mounted, strict=True)), drawn.sensor.camera)
    turn = Rotation.from_euler("XYZ", songshan_draw.BORESIGHT_RAD).as_rotvec()
    found = attitude_rms_rad(SCENE, true, laboratory, "camera")
    assert found == pytest.approx(np.sqrt((turn**2).mean()), rel=1e-4)


def test_recorded_attitude_errs_as_its_sigmas_say(drawn):
    found = attitude_rms_rad(SCENE, drawn.sensor, drawn.truth, "body")
    assert 0.4 < found / np.sqrt((songshan_draw.ATTITUDE_SIGMA_RAD**2).mean()) < 1.8


def test_printed_rows_are_whole():
    assert len(PRINTED) == 4 + 4 + 2 + 5 + 5
    for axes in PRINTED.values():
        for largest, smallest, mean, rmse in axes:
            assert smallest <= mean <= largest and 0 < rmse < max(abs(largest), abs(smallest))
    assert contradictions() == [Row(1, "A", "direct"), Row(2, "B", "direct")]
    mean = np.mean(list(TABLE_3.values()), axis=0)
    np.testing.assert_allclose(mean[:3], songshan_draw.LEVER_ARM_M, atol=1e-9)
    np.testing.assert_allclose(np.radians(mean[3:]), songshan_draw.BORESIGHT_RAD, atol=1e-9)


def test_limits_are_those_of_the_paper():
    """Data set A of the paper meets 0.5 m in planimetry and misses 0.4 m in height."""
    assert limited((0.221, 0.223, 0.581)).fits == (True, False)
    assert limited((0.3, 0.401, 0.4)).fits == (False, True)
