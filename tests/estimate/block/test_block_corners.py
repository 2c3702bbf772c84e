"""Blocks with something missing: points that nobody sees, no trajectory to correct, axes that stay as they are."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.block.frames import FREE, POS, SIGMA, frames


def in_order(block, points):
    """The block with these of its points only, among them all that are seen, in this order."""
    number = np.full(len(block.role), -1)
    number[points] = np.arange(len(points))
    return dataclasses.replace(
        block,
        point=number[block.point],
        position_m=block.position_m[points],
        covariance_m2=block.covariance_m2[points],
        role=block.role[points],
        points=[block.points[i] for i in points],
    )


@pytest.mark.parametrize("gone", [0, 7])
@pytest.mark.parametrize("control", [0, 3])
def test_a_point_without_rays_changes_nothing(gone, control):
    """The same solution and the same freedom as without that point; its place is not known."""
    sensor, block, *_ = frames(control=control)
    seen = block.keep(block.point != gone)
    others = np.delete(np.arange(len(block.role)), gone)
    without = in_order(seen, others)
    found, expected = (wj.adjust(sensor, b, errors=POS) for b in (seen, without))
    assert np.isnan(found.point_m[gone]).all()
    np.testing.assert_allclose(found.point_m[others], expected.point_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.covariance_m2[others], expected.covariance_m2, rtol=1e-6, atol=1e-12)
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.freedom == expected.freedom == 2 * len(seen) + 3 * (without.role == "control").sum() - 3 * len(others)


def test_images_are_resected_though_the_first_point_is_a_tie():
    """Without POS, and with poses far off, control has to come first wherever it stands in the list."""
    sensor, block, *_ = frames()
    place = np.roll(np.arange(len(block.role)), -5)  # ties come first
    other = in_order(block, place)
    found = wj.adjust(sensor, other, errors=FREE)
    assert other.role[0] == "tie"
    np.testing.assert_allclose(found.point_m, wj.adjust(sensor, block, errors=FREE).point_m[place], rtol=0, atol=1e-5)


def test_a_trajectory_that_is_kept():
    """Unknowns and points alone: a turn behind all poses. No small change of it, points following, lowers the cost."""
    sensor, block, *_ = frames()
    mounted = wj.Sensor({"photo": sensor["photo"], "mount": wj.Mount()}, sensor.camera)
    found = wj.adjust(mounted, block, [wj.Unknown("kappa", "mount.angles_rad[2]", 0.0, 1e-2)])
    assert found.result == wj.RESULTS.successful and np.isfinite(found.covariance_m2).all()
    assert found.freedom == 2 * len(block) + 3 * 3 + 1 - 1 - 3 * len(block.role)
    # At the optimum no small change of the unknown, points following, lowers the cost.
    for change in (-1e-6, 1e-6):
        fixed = wj.Sensor(
            {"photo": sensor["photo"], "mount": wj.Mount(angles_rad=[0, 0, found.value[0] + change])}, sensor.camera
        )
        met = wj.adjust(fixed, block, [wj.Unknown("none", "mount.lever_arm_m[0]", 0.0, 1e-9)])
        assert met.cost + (found.value[0] + change) ** 2 / 1e-4 > found.cost


def test_an_axis_with_sigma_zero_stays_as_it_is():
    """What an earlier adjustment found there is not lost."""
    sensor, block, *_ = frames()
    first = wj.adjust(sensor, block, errors=POS)
    held = wj.FrameErrors("photo", turn_sigma_rad=SIGMA["turn_sigma_rad"], shift_sigma_m=(0.0,) * 3)
    again = wj.adjust(first.sensor, block, errors=[held])
    np.testing.assert_array_equal(again.sensor["photo"].shift_m, first.sensor["photo"].shift_m)
    assert np.abs(again.sensor["photo"].shift_m).max() > 0.1


def test_a_start_without_numbers_is_refused():
    sensor, block, _, truth = frames()
    start = truth.copy()
    start[9, 1] = np.nan
    with pytest.raises(wj.WhiskjaxError, match="point P9: start_m holds no finite coordinates of it"):
        wj.adjust(sensor, block, errors=POS, start_m=start)
    with pytest.raises(wj.WhiskjaxError, match=r"start_m has shape \(23, 3\), expected \(24, 3\)"):
        wj.adjust(sensor, block, errors=POS, start_m=truth[1:])


def test_two_steps_need_pos():
    sensor, block, *_ = frames()
    mounted = wj.Sensor({"photo": sensor["photo"], "mount": wj.Mount()}, sensor.camera)
    with pytest.raises(wj.WhiskjaxError, match="step two fits the mounts to the motions that POS observed"):
        wj.two_step(mounted, block, [wj.Unknown("kappa", "mount.angles_rad[2]", 0.0, 1e-2)], errors=FREE, mounts=["kappa"])


@pytest.mark.parametrize(
    "how", [{}, {"blunders": wj.Blunders()}, {"reweigh": wj.Reweigh(priors=True)}], ids=lambda how: "".join(how) or "plain"
)
def test_points_seen_once_are_left_out_and_listed(how):
    """A tie and a check point: everything is as if their rays had never been measured, and their names are said."""
    sensor, block, _, truth = frames()
    role, place = block.role.copy(), block.position_m.copy()
    role[[9, 12]], place[[9, 12]] = "check", truth[[9, 12]]
    block = dataclasses.replace(block, role=role, position_m=place)
    lonely = np.isin(block.point, [7, 9])
    kept = ~lonely | (block.key("image") == 2)
    found = wj.adjust(sensor, block.keep(kept), errors=POS, **how)
    expected = wj.adjust(sensor, block.keep(~lonely), errors=POS, **how)
    assert found.left_out == ("P7", "P9") and expected.left_out == ()
    said = "2 check or tie points are seen by one ray only, which determines no point, and left out: P7, P9"
    assert said in found.warnings and set(found.warnings) - {said} == set(expected.warnings)
    np.testing.assert_array_equal(found.used, ~lonely[kept] if not how.get("blunders") else found.used & ~lonely[kept])
    np.testing.assert_array_equal(found.used[~lonely[kept]], expected.used)
    assert np.isnan(found.residual_px[lonely[kept]]).all() and np.isnan(found.point_m[[7, 9]]).all()
    np.testing.assert_allclose(found.point_m, expected.point_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.residual_px[~lonely[kept]], expected.residual_px, rtol=0, atol=1e-6)
    assert found.freedom == expected.freedom and found.cost == pytest.approx(expected.cost, rel=1e-8)
    assert found.check.freedom == 3 and found.check.chi_square == pytest.approx(expected.check.chi_square, rel=1e-5)
    assert found.is_sound


def test_start_places_of_points_seen_once_are_not_needed():
    sensor, block, _, truth = frames()
    start = truth.copy()
    start[7] = np.nan
    once = block.keep((block.point != 7) | (block.key("image") == 2))
    found = wj.adjust(sensor, once, errors=POS, start_m=start)
    assert found.is_sound and found.left_out == ("P7",)


def test_a_block_in_which_nothing_remains_is_refused():
    sensor, block, *_ = frames(control=0)
    with pytest.raises(wj.WhiskjaxError, match="point P0 and every other point of the block is seen by one ray only"):
        wj.adjust(sensor, block.keep(block.key("image") == 2), errors=POS)
