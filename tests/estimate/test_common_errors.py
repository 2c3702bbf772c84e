"""Errors that are one and the same in all exposures though stated as new: against dense matrices of the textbook's chain."""

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.locate.conftest import Run, draw
from tests.locate.textbooks import EXACT, TABLE_1, differentiated, least_squares
from whiskjax.flights import tianshan


@pytest.fixture(scope="module")
def constant():
    """40 looks whose records all err by the same."""
    recorded, pixel = tianshan.draw(jax.random.key(3), errors=tianshan.frame_errors(correlation_s=np.inf))
    return Run(tianshan.STANDARD, recorded, np.asarray(pixel))


def in_common(answer):
    return [one for one in answer.reasons if one.kind == "errors in common"]


def test_sigmas_would_grow_as_dense_matrices_say(constant):
    answer = constant.locate(method="batch", errors=tianshan.frame_errors())
    (said,) = in_common(answer)
    assert said.grade == "failure" and set(said.figures["frames"]) == {"body", "gimbal_roll", "gimbal_pitch"}
    dense = least_squares(constant.image, constant.pixel_px, np.zeros(3), constant.prior, sigma_w=TABLE_1)
    weight = np.linalg.inv(dense.noise)
    by_error = np.array([differentiated(lambda w, k=k: constant.image(k, dense.state, w), EXACT) for k in range(40)]) * TABLE_1
    share = np.einsum("kam,kab,kbm->", by_error, weight, by_error) / 80
    factor = dense.cost / 80
    common = min((1 - factor) / share, 1.0)
    moved = dense.formal @ np.einsum("kan,kab,kbm->nm", dense.rows, weight, by_error)
    grown = factor * dense.formal + common * moved @ moved.T
    most = np.linalg.eigvals(np.linalg.solve(dense.formal, grown)).real.max()
    assert said.figures["share"] == pytest.approx(share, rel=1e-4) and share > 0.9
    assert said.figures["widens"] == pytest.approx(np.sqrt(most), rel=1e-3) and most > 25


def test_stated_as_constant_they_are_in_order(constant):
    answer = constant.locate(method="batch", errors=tianshan.frame_errors(correlation_s=np.inf))
    assert answer.is_sound and not in_common(answer)
    error = np.asarray(answer.world_from_enu).T @ (np.asarray(answer.point_m) - constant.target_m)
    assert error @ np.linalg.solve(answer.covariance_enu_m2, error) < 21.1


def test_sigmas_of_pixels_that_are_too_large_stay_a_caution():
    recorded, pixel = tianshan.draw(jax.random.key(2), errors=())
    run = Run(tianshan.STANDARD, recorded, np.asarray(pixel))
    looks = wj.Looks(wj.Shot(time_s=run.time_s), pixel, (20.0, 20.0))
    # Of errors of a hundredth of theirs nothing is missing.
    answer = run.locate(looks, errors=tianshan.frame_errors(tianshan.TABLE_1.scaled(0.01)))
    assert answer.is_sound and not in_common(answer)
    assert any(one.kind == "consistency" and one.grade == "caution" for one in answer.reasons)


def test_errors_that_are_new_are_not_said_to_be_the_same():
    assert not in_common(draw(5).locate(errors=tianshan.frame_errors()))
