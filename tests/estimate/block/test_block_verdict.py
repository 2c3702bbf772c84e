"""Blocks whose residuals are fine and whose answer is not: check points and weights say so."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import whiskjax as wj
from benchmarks.trust import block_spoils, block_spread, blocks
from tests.estimate.block.frames import FREE, PLACE_M, POINTS, POS, frames

CHECK = np.arange(3, 11)


def checked_frames(seed=5):
    """The block of frames with eight check points, known to 0.02 m."""
    sensor, block, _, truth = frames(seed=seed)
    place = block.position_m.copy()
    place[CHECK] = truth[CHECK] + np.random.default_rng(100 + seed).normal(0, 0.02, (len(CHECK), 3))
    role = np.where(np.isin(np.arange(POINTS), CHECK), "check", block.role)
    return sensor, dataclasses.replace(block, role=role, position_m=place)


def moved(block, which, by_m):
    place = block.position_m.copy()
    place[which] += by_m
    return dataclasses.replace(block, position_m=place)


@pytest.fixture(scope="module")
def clean():
    """Twenty blocks with everything as stated."""
    return [wj.adjust(*checked_frames(seed), errors=POS) for seed in range(20)]


def test_clean_blocks_are_sound(clean):
    """The mean of 20 chi-squares of 24 is 24 +- 1.5."""
    assert all(found.is_sound for found in clean)
    assert np.mean([found.check.chi_square for found in clean]) == pytest.approx(24, abs=3 * np.sqrt(2 * 24 / 20))


def test_the_chi_square_is_what_the_block_pays_for_them_as_control(clean):
    """Check points made control points: the cost rises by it, but for what is not linear (0.01 sigma in 30)."""
    sensor, block = checked_frames(0)
    tied = dataclasses.replace(block, role=np.where(block.role == "check", "control", block.role))
    joined = wj.adjust(sensor, tied, errors=POS)
    assert joined.cost - clean[0].cost == pytest.approx(clean[0].check.chi_square, rel=2e-3)


@pytest.mark.parametrize(
    "how", [{}, {"blunders": wj.Blunders()}, {"reweigh": wj.Reweigh(priors=True)}], ids=lambda how: "".join(how) or "plain"
)
@pytest.mark.parametrize(
    ("which", "by_m"),
    [(CHECK, 10.0), (CHECK[2:3], 10.0), (np.arange(3), (0.0, 0.0, 1.0))],
    ids=["all check points 10 m off", "one of them", "control 1 m high"],
)
def test_a_contradiction_is_heard_whatever_is_asked(which, by_m, how):
    sensor, block = checked_frames(0)
    found = wj.adjust(sensor, moved(block, which, by_m), errors=POS, **how)
    assert not found.is_sound and not found.check.agrees
    assert found.warnings[0].startswith("the check points contradict the answer: ")
    if len(which) == 1:
        assert found.check.worst[0] == "point P5"


def test_a_shift_of_all_check_points_is_told_in_metres(clean):
    """Given coordinates 0.3 m off are 0.3 m from where they fit, whatever they were off before."""
    sensor, block = checked_frames(0)
    off = np.array([0.3, -0.1, 0.2])
    moved = dataclasses.replace(block, position_m=block.position_m + np.where(block.role == "check", 1.0, 0.0)[:, None] * off)
    found = wj.adjust(sensor, moved, errors=POS).check
    np.testing.assert_allclose(np.array(found.shift_m) - clean[0].check.shift_m, -off, atol=1e-6)
    assert clean[0].check.shift_tail > 1e-4 > found.shift_tail
    assert found.chi_square >= clean[0].check.chi_square


def test_without_check_points_nothing_is_tested(clean):
    sensor, block = checked_frames(0)
    tied = dataclasses.replace(block, role=np.where(block.role == "check", "tie", block.role))
    found = wj.adjust(sensor, tied, errors=POS)
    assert found.check.freedom == 0 and found.check.agrees and found.is_sound
    assert clean[0].check.freedom == 3 * len(CHECK)
    np.testing.assert_allclose(found.point_m, clean[0].point_m, rtol=0, atol=1e-9)


def test_a_stretched_group_is_named():
    """Rows of tie rays off by 20 px, up or down: sixty sigmas, of which the weights make a consistent block."""
    sensor, block = checked_frames(0)
    off = 20.0 * np.random.default_rng(1).choice([-1, 1], len(block)) * (block.role[block.point] == "tie")
    spoilt = dataclasses.replace(block, pixel_px=block.pixel_px + np.stack([0 * off, off], -1))
    found = wj.adjust(sensor, spoilt, errors=POS, reweigh=wj.Reweigh(priors=True))
    assert found.is_consistent and not found.is_sound
    assert any(said.startswith("the errors of tie rays are ") for said in found.warnings)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_mirrored_block_is_no_answer(axis):
    """All points are control, the poses free, and start 120 deg off: it converges with the cameras below the ground."""
    sensor, block, *_ = frames(control=POINTS)
    recorded = Rotation.from_quat(np.stack([np.asarray(c) for c in sensor["photo"].quaternion], -1))
    start = wj.PosePerImage(PLACE_M, (recorded * Rotation.from_euler(axis, 120, degrees=True)).as_quat())
    mirrored = wj.Sensor({"photo": start}, sensor.camera)
    with pytest.raises(wj.SensorError, match=r"adjust: where the iteration ended, ray 0, image im0, point P0: the point lies "
                       r"behind the camera \(144 of 144 rays fail\)"):  # fmt: skip
        wj.adjust(mirrored, block, errors=FREE, max_steps=60)
    found = wj.adjust(mirrored, block, errors=FREE, max_steps=60, throw=False)
    pose = found.sensor["photo"].pose(wj.Shot(image=np.arange(6)))
    assert (np.asarray(pose.translation[2]) < 0).all()
    assert found.result == wj.RESULTS.point_behind_camera and not found.is_sound
    assert found.warnings[0].startswith("where the iteration ended, ray 0, image im0, point P0: ")
    right = wj.adjust(sensor, block, errors=FREE)
    assert right.is_sound and (np.asarray(right.sensor["photo"].pose(wj.Shot(image=np.arange(6))).translation[2]) > 0).all()


def test_an_adjustment_is_not_silent():
    sensor, block = checked_frames(0)
    said = []
    with wj.telling(said.append):
        wj.adjust(sensor, block, errors=POS, blunders=wj.Blunders(), reweigh=wj.Reweigh(priors=True))
    assert said[0] == f"adjust: {len(block)} rays of {POINTS} points"
    for beginning in ("adjust: step 1, sum of squares ", "wrong rays: round 1, 0 of 144 rays", "weights: round 1"):
        assert any(one.startswith(beginning) for one in said)


def test_records_keep_their_sigmas_unless_asked():
    """`Reweigh()` asks the rays alone, and the poses' sigmas are then those that were given."""
    sensor, block = checked_frames(0)
    rays, everything = (wj.adjust(sensor, block, errors=POS, reweigh=wj.Reweigh(priors=p)).components for p in (False, True))
    assert rays.names == ("tie rays", "control and check points") and not rays.is_prior.any()
    assert everything.names[2:] == ("POS attitude", "POS position") and everything.is_prior[2:].all()


def test_the_spread_of_sigmas_is_a_prior_of_their_factors():
    """Tie rays whose sigmas are three times too small: where they are known to 2 %, both that and the residuals are heard.

    With s^2 squares per redundancy r and the prior's log(spread)^-2 = g, the most probable f has r s^2 / f^2 = r + g log f.
    """
    sensor, block = checked_frames(0)
    off = np.where((block.role[block.point] == "tie")[:, None], 1 / 3, 1.0)
    small = dataclasses.replace(block, sigma_px=block.sigma_px * off)
    found = [wj.adjust(sensor, small, errors=POS, reweigh=wj.Reweigh(spread=s)).components for s in (1.02, 30.0, 1e6)]
    near, usual, wide = (of.factor[0] for of in found)
    assert 2.5 < usual < 3.5 and usual == pytest.approx(wide, rel=0.01)
    redundancy, g = (found[2].log_sigma[0] ** -2 - np.log(1e6) ** -2) / 2, np.log(1.02) ** -2
    expected = brentq(lambda f: redundancy * (wide / f) ** 2 - redundancy - g * np.log(f), 1.0, 3.5)
    # How much the rays take of their own errors changes with their weights.
    assert near == pytest.approx(expected, rel=0.03) and 1.1 < near < 1.4


def test_sigmas_are_pulled_to_what_was_given_once():
    """With blunders the weights are found twice; where none is left out they are what they are without."""
    sensor, block = checked_frames(0)
    off = np.where((block.role[block.point] == "tie")[:, None], 1 / 1.3, 1.0)
    small, rule = dataclasses.replace(block, sigma_px=block.sigma_px * off), wj.Reweigh(spread=1.1)
    once = wj.adjust(sensor, small, errors=POS, reweigh=rule)
    twice = wj.adjust(sensor, small, errors=POS, reweigh=rule, blunders=wj.Blunders(level=1e-9))
    assert twice.used.all() and 1.1 < once.components.factor[0] < 1.4
    np.testing.assert_allclose(twice.components.factor, once.components.factor, rtol=2e-2)
    np.testing.assert_allclose(twice.components.log_sigma, once.components.log_sigma, rtol=2e-2)


def test_an_error_that_all_poses_share_is_named():
    """Every position 0.3 m to the same side, where POS is stated to err by 5 cm, anew in every image."""
    case = blocks.Blocks().draw(3, True)
    spoiled, _ = block_spoils.pose(blocks.IMAGES, shift_m=0.3)(case, np.random.default_rng(0))
    answer = blocks.Blocks().answer(spoiled)
    (reason,) = [one for one in answer.reasons if one.kind == "one pose"]
    assert reason.grade == "failure" and "photo" in reason.figures["groups"]
    assert "one pose" not in {one.kind for one in blocks.Blocks().answer(case).reasons}


def test_kinds_of_observations_have_a_bound_of_their_own():
    """Surveyed coordinates that are twenty times as wrong as stated are named, beside rays of ties that are in order."""
    case = blocks.Blocks().draw(3, True)
    spoiled, _ = block_spread.stated_control(20.0)(case, np.random.default_rng(0))
    (reason,) = [one for one in blocks.Blocks().answer(spoiled).reasons if one.kind == "a group too large"]
    assert "control and check points" in reason.figures["groups"] and "tie rays" not in reason.figures["groups"]
