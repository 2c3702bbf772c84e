"""Looks at two targets: against least squares with a second target, by the textbook's chain."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.locate.conftest import Run
from tests.locate.textbooks import enu, least_squares
from whiskjax.estimate.fitted import scores
from whiskjax.flights import tianshan


@pytest.fixture(scope="module")
def still():
    """Noise of the pixels alone: errors of poses would weigh anew wherever the target goes."""
    recorded, pixel = tianshan.draw(jax.random.key(3), errors=())
    return Run(tianshan.STANDARD, recorded, np.asarray(pixel))


def beside(run, looks, by_enu_m):
    """Pixels of looks that saw a point beside the target."""
    pixel, exact = run.pixel_px.copy(), np.zeros(8)
    for k in looks:
        there = run.target_m + enu(run.target_m) @ np.asarray(by_enu_m)
        pixel[k] += run.chain.image(k, there, exact) - run.chain.image(k, run.target_m, exact)
    return pixel


def two_targets(answer):
    return [one for one in answer.reasons if one.kind == "two targets"]


@pytest.mark.parametrize(("first", "last"), [(0, 19), (10, 26), (30, 39)])
def test_a_run_of_looks_at_another_target_is_named_as_least_squares_of_both_finds_it(still, first, last):
    looks = range(first, last + 1)
    pixel = beside(still, looks, (1.0, -0.5, 0.0))
    (said,) = two_targets(answer := still.locate(still.looks_at(pixel), method="batch"))
    assert said.grade == "failure" and not answer.is_sound
    assert (said.figures["first"], said.figures["last"]) == (f"look {first}", f"look {last}")
    assert said.figures["looks"] == list(looks)

    def image(k, state, w):
        return still.chain.image(k, still.anchor_m + state[:3] + (state[3:] if k in looks else 0.0), w)

    prior = np.zeros((6, 6))
    prior[:3, :3], prior[3:, 3:] = still.prior, 1e8 * np.eye(3)
    both = least_squares(image, pixel, np.zeros(6), prior)
    alone = least_squares(still.image, pixel, np.zeros(3), still.prior)
    shift = enu(still.target_m).T @ both.state[3:]
    sigma = np.sqrt(np.diag(enu(still.target_m).T @ both.formal[3:, 3:] @ enu(still.target_m)))
    assert (np.abs(said.figures["shift_enu_m"] - shift) < 0.01 * sigma).all()
    assert said.figures["sigmas"] ** 2 == pytest.approx(alone.cost - both.cost, rel=1e-3)
    assert said.figures["distance_m"] == pytest.approx(np.linalg.norm(shift), rel=1e-2)
    # How far the answer lies from that of the others, in its own sigmas.
    moved = alone.state - both.state[:3]
    assert said.figures["moves"] == pytest.approx(np.sqrt(moved @ np.linalg.solve(alone.formal, moved)), rel=1e-2)


def test_a_run_between_the_edges_that_are_tried_is_found_near_it(still):
    (said,) = two_targets(still.locate(still.looks_at(beside(still, range(12, 25), (1.5, 0.0, 0.0)))))
    assert 10 <= said.figures["looks"][0] <= 13 and 22 <= said.figures["looks"][-1] <= 27


def test_looks_at_one_target_are_not_said_to_see_two(still):
    assert not two_targets(still.locate())
    few = still.looks_at(np.where(np.arange(40)[:, None] < 3, still.pixel_px, np.nan))
    assert not two_targets(still.locate(few))  # no two runs


def test_errors_of_poses_weigh(run):
    """60 m are much for the pixels and little for the recorded poses, and only these are stated here."""
    pixel = beside(run, range(20), (60.0, 0.0, 0.0))
    (said,) = two_targets(run.locate(run.looks_at(pixel), errors=tianshan.frame_errors()))
    clean = run.locate(errors=tianshan.frame_errors())
    assert not two_targets(clean) and said.figures["distance_m"] == pytest.approx(60.0, abs=40.0)


def test_numbers_that_a_prior_holds_take_their_part(still):
    """A prior that pulls: with the shift taken off the pixels the cost falls by the statistic, and the least of it is there."""
    zero = wj.Unknown("zero", "gimbal_pitch.zero_rad", 1e-4, 3e-5)
    pattern = beside(still, range(20), (1.0, 0.0, 0.0)) - still.pixel_px

    def again(times):
        return still.locate(still.looks_at(still.pixel_px + times * pattern), method="batch", estimate=[zero])

    answer = again(1.0)
    assert abs(float(answer.shift[0])) > 0.5
    (found,) = scores(answer.evidence.fit, pattern.reshape(-1, 1), [slice(0, 1)])
    low, middle, high = (float(again(1.0 - found.size[0] + s * found.sigma[0]).chi_square) for s in (-1, 0, 1))
    assert float(answer.chi_square) - middle == pytest.approx(found.statistic, rel=2e-3)
    assert low - middle == pytest.approx(1.0, abs=2e-3) and high - middle == pytest.approx(1.0, abs=2e-3)
