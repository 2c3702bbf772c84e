"""What sigmas found from the data do to the covariances of a block, against adjustments with other sigmas."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.block.frames import POS, SIGMA, frames
from whiskjax.estimate.block import weights
from whiskjax.estimate.variance_components import LEAST_KNOWN

FOCAL = wj.Unknown("focal", "camera.focal_px", 3000.0, 5.0)
STEP = 0.02  # of a logarithm


@pytest.fixture(scope="module")
def case():
    return frames(seed=3, control=10)[:2]


@pytest.fixture(scope="module")
def found(case):
    sensor, block = case
    errors = [wj.FrameErrors("photo", **SIGMA)]
    return wj.adjust(sensor, block, [FOCAL], errors=errors, reweigh=wj.Reweigh(priors=True), retime=False)


def again(case, factor):
    """Adjusted with factors on the four groups of sigmas, and what its groups say."""
    sensor, block = case
    marked = block.role[block.point] != "tie"
    block = dataclasses.replace(
        block,
        sigma_px=block.sigma_px * np.where(marked, factor[1], factor[0])[:, None],
        covariance_m2=block.covariance_m2 * factor[1] ** 2,
    )
    turn, shift = (tuple(f * np.array(sigma)) for f, sigma in zip(factor[2:], SIGMA.values(), strict=True))
    answer = wj.adjust(sensor, block, [FOCAL], errors=[wj.FrameErrors("photo", turn, shift)])
    return answer, weights.groups_of(answer._prepared, answer._solved, answer.used)


def motions_and_value(answer):
    photo = answer.sensor["photo"]
    return np.concatenate([np.concatenate([photo.turn_rad, photo.shift_m], axis=1).ravel(), answer.value])


def test_the_covariance_is_that_of_refits(case, found):
    """J, g and the information on the factors by differences: Cov = C nu / (nu - 2) + J W J^T, of unknown and stations."""
    parts = found.components
    assert parts.names == ("tie rays", "control and check points", "POS attitude", "POS position")
    right, groups = again(case, parts.factor)
    assert right.value[0] == pytest.approx(found.value[0], abs=1e-4 * right.trust.sigma[0])
    whole = np.concatenate([right.trust.stations.ravel(), right.trust.sigma])
    answer, log_variance, information = [], [], np.diag(2 * groups.redundancy)
    for g in range(4):
        sides = [again(case, parts.factor * np.exp(side * STEP * (np.arange(4) == g))) for side in (1, -1)]
        (more, of_more), (less, of_less) = sides
        answer.append((motions_and_value(more) - motions_and_value(less)) / (2 * STEP))
        wide, tight = (np.concatenate([a.trust.stations.ravel(), a.trust.sigma]) for a in (more, less))
        log_variance.append(2 * np.log(wide / tight) / (2 * STEP))
        # What another group gains in redundancy, this one loses: 2 tr(S^-1 S_g S^-1 S_h).
        lost = (of_less.redundancy - of_more.redundancy) / (2 * STEP)
        others = np.arange(4) != g
        information[others, g] = lost[others]
    rest = np.array([FOCAL.sigma**-2 * right.trust.sigma[0] ** 2 * v[-1] for v in log_variance])  # of the prior
    for g in range(4):
        others = np.arange(4) != g
        information[g, g] -= information[g, others].sum() + rest[g]
    covariance = np.linalg.inv(information + np.log(30.0) ** -2 * np.eye(4))
    np.testing.assert_allclose(parts.covariance, covariance, rtol=0.02, atol=2e-4)
    answer, log_variance = np.array(answer), np.array(log_variance)
    relative = np.einsum("gk,gh,hk->k", log_variance, parts.covariance, log_variance)
    assert (relative < 4 * LEAST_KNOWN**2).all()
    expected = whole**2 / (1 - relative) + np.einsum("gk,gh,hk->k", answer, parts.covariance, answer)
    got = np.concatenate([found.trust.stations.ravel(), found.trust.sigma])
    np.testing.assert_allclose(got**2, expected, rtol=2e-3)
    assert (got > whole).all()
    np.testing.assert_allclose(found.estimate.sigma, found.trust.sigma, rtol=1e-12)
    # Points are known less well, too.
    wider, plain = (np.linalg.eigvalsh(of) for of in (found.covariance_m2, right.covariance_m2))
    assert (wider > plain * (1 - 1e-6)).all()


def test_few_values_decide_no_factor():
    """POS of three images and four control points: factors of fewer than five values are given up."""
    sensor, block, *_ = frames(seed=3, control=1)
    keep = np.flatnonzero(np.asarray(block.key("image")) < 3)
    few = block.keep(keep)
    errors = [wj.FrameErrors("photo", **SIGMA)]
    answer = wj.adjust(sensor, few, errors=errors, reweigh=wj.Reweigh(priors=True), throw=False)
    assert "control and check points" not in answer.components.names and answer.components.names[0] == "tie rays"
    assert (answer.components.log_sigma <= LEAST_KNOWN).all()
    marked = few.role[few.point] != "tie"
    np.testing.assert_array_equal(answer.block.sigma_px[marked], few.sigma_px[marked])
    np.testing.assert_array_equal(answer.block.covariance_m2[few.role == "control"], few.covariance_m2[few.role == "control"])


def test_where_no_sigma_is_known_none_is_found():
    """Two images and a handful of points: every group keeps what was stated, and the answer stands."""
    sensor, block, *_ = frames(seed=3, control=1)
    some = block.keep((block.key("image") < 2) & (block.point < 5))
    for rule in (wj.Reweigh(), wj.Reweigh(priors=True)):
        plain, answer = (wj.adjust(sensor, some, errors=POS, reweigh=r, throw=False) for r in (None, rule))
        assert answer.components is not None and not answer.components.names
        np.testing.assert_allclose(answer.covariance_m2, plain.covariance_m2, rtol=1e-9)


def test_rays_made_with_the_model_itself_are_not_reweighed():
    sensor, block, _, truth = frames(seed=3)
    exact = np.asarray(wj.project(sensor, block.shots(), truth[block.point]).pixel_px)
    answer = wj.adjust(sensor, dataclasses.replace(block, pixel_px=exact, position_m=truth), errors=POS, reweigh=wj.Reweigh())
    assert answer.components is None and answer.result == wj.RESULTS.successful
