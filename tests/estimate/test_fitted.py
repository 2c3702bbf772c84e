"""The score test of a pattern against adjusting again with the pattern taken off the pixels, in all three verbs."""

import dataclasses

import jax
import numpy as np
import pytest
from scipy.sparse import csc_array

import whiskjax as wj
from tests.estimate.block.textbook import SCENES
from whiskjax.estimate.fitted import Dense, scores
from whiskjax.flights import haian, songshan, tianshan

SCENE = SCENES["orientation images"]


def calibrated():
    flight = haian.simulate(3, truth=haian.draw_truth(jax.random.key(3)))
    seen = flight.observations()

    def again(pixel_px):
        return wj.calibrate(flight.sensor, dataclasses.replace(seen, pixel_px=pixel_px), flight.unknowns, errors=flight.errors)

    return again, np.asarray(seen.pixel_px), np.asarray(seen.key("swing")) == 0


def adjusted():
    drawn = songshan.simulate_block(SCENE, 2)

    def again(pixel_px):
        block = dataclasses.replace(drawn.block, pixel_px=pixel_px)
        errors = songshan.frame_errors(SCENE)
        return wj.adjust(drawn.sensor, block, songshan.unknowns(SCENE), errors=errors, retime=False)

    return again, np.asarray(drawn.block.pixel_px), np.asarray(drawn.block.key("strip")) == 1


def located():
    """With noise of the pixel alone: errors of poses would weigh anew wherever the target goes."""
    time_s = tianshan.time_s(tianshan.STANDARD)
    recorded, pixel = tianshan.draw(jax.random.key(3), errors=())
    sensor, shot = tianshan.in_time(recorded, time_s), wj.Shot(time_s=time_s)

    def again(pixel_px):
        looks = wj.Looks(shot, pixel_px, (tianshan.PIXEL_SIGMA_PX,) * 2)
        start = {"surface": wj.HeightSurface(1000.0), "sigma_enu_m": (1500.0, 1500.0, 1500.0)}
        return wj.locate(sensor, looks, method="batch", **start)

    return again, np.asarray(pixel), np.arange(len(pixel)) < 12


VERBS = {"calibrate": calibrated, "adjust": adjusted, "locate": located}


@pytest.fixture(scope="module", params=VERBS)
def case(request):
    again, pixel, members = VERBS[request.param]()
    return request.param, again, pixel, members, again(pixel)


def pattern_of(members):
    """One pixel along the sample."""
    return np.stack([members, 0 * members], axis=1).astype(float)


def cost_of(answer):
    return float(answer.estimate.cost)


def test_the_cost_falls_by_the_statistic_where_the_size_is_taken_off(case):
    """The cost of fits with s times the pattern taken off the pixels is a parabola in s; weights and line times aside."""
    _, again, pixel, members, answer = case
    (found,) = scores(answer.evidence.fit, pattern_of(members).reshape(-1, 1), [slice(0, 1)])
    steps = found.size[0] + found.sigma[0] * np.array([-1.0, 0.0, 1.0])
    low, middle, high = (cost_of(again(pixel - s * pattern_of(members))) for s in steps)
    within = 2e-3
    assert cost_of(answer) - middle == pytest.approx(found.statistic, abs=within * max(1.0, found.statistic))
    assert low - middle == pytest.approx(1.0, abs=within) and high - middle == pytest.approx(1.0, abs=within)


def test_redundancies_add_up(case):
    """Over measurements and priors to the degrees of freedom; priors have what is left of them."""
    verb, _, _, _, answer = case
    fit = answer.evidence.fit
    of_rays = np.einsum("naa->", fit.left[np.asarray(answer.evidence.seen.used)])
    if verb == "calibrate":
        taken = fit.taken[answer.used]
        assert -1e-9 <= np.linalg.eigvalsh(taken).min() and np.linalg.eigvalsh(taken).max() <= 1
        assert 2 * answer.used.sum() - 15 < of_rays < 2 * answer.used.sum() + 1e-9
    elif verb == "locate":
        assert of_rays == pytest.approx(2 * len(members_of(answer)) - 3, abs=1e-3)
    else:
        inverse, block = np.asarray(answer._inverse), answer.block
        ready, state = answer._prepared.ready, answer._solved.state
        roots = np.asarray(ready.roots)
        size = state.x.size
        blocks = inverse[:size, :size].reshape(len(roots), -1, len(roots), size // len(roots))
        of_pos = np.abs(roots).sum(axis=2).astype(bool).sum() - sum(
            np.trace(root @ blocks[a, :, a] @ root.T) for a, root in enumerate(roots)
        )
        of_priors = np.sum(np.eye(len(state.u))) - np.sum(inverse[size:, size:] * np.asarray(ready.unknowns.others.information))
        of_priors -= (~np.asarray(ready.unknowns.others.has_prior)).sum()
        known = block.role == "control"
        spread = answer.covariance_m2[known] @ block.information()[known]
        of_points = 3 * known.sum() - np.einsum("nii->", spread)
        assert of_rays + of_pos + of_priors + of_points == pytest.approx(answer.freedom, rel=1e-6)


def members_of(answer):
    return np.flatnonzero(np.asarray(answer.evidence.seen.used))


def test_sparse_patterns_are_dense_ones(case):
    *_, members, answer = case
    flat = pattern_of(members).reshape(-1, 1)
    (one,), (other,) = (scores(answer.evidence.fit, of, [slice(0, 1)]) for of in (flat, csc_array(flat)))
    assert one.statistic == pytest.approx(other.statistic, rel=1e-9) and one.moves == pytest.approx(other.moves, rel=1e-9)


def test_what_the_fit_takes_whole_cannot_be_seen():
    """Least squares of a line: a pattern along it, one beside it, and both; against numpy's least squares."""
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(30, 2, 2))
    measured, hidden, seen = rng.normal(size=60), rows.reshape(60, 2)[:, :1], rng.normal(size=(60, 1))
    step = np.linalg.lstsq(rows.reshape(60, 2), measured, rcond=None)[0]
    residual = measured - rows.reshape(60, 2) @ step
    fit = Dense(residual.reshape(30, 2), -rows, np.zeros((2, 2)), np.zeros(2), lambda pattern: pattern)
    both = np.concatenate([hidden, seen, hidden, seen], axis=1)
    alone, beside, two = scores(fit, both, [slice(0, 1), slice(1, 2), slice(2, 4)])
    whole = np.concatenate([rows.reshape(60, 2), seen], axis=1)
    size, cost, *_ = np.linalg.lstsq(whole, measured, rcond=None)
    assert alone.freedom == 0 and alone.statistic == 0 and alone.tail == 1 and np.isinf(alone.sigma).all()
    assert beside.statistic == pytest.approx(residual @ residual - cost[0]) and beside.size[0] == pytest.approx(size[2])
    assert beside.sigma[0] == pytest.approx(np.sqrt(np.linalg.inv(whole.T @ whole)[2, 2]))
    assert two.freedom == 1 and two.statistic == pytest.approx(beside.statistic, rel=1e-9)
    # What it did to the two numbers, in their own covariance.
    moved = np.linalg.lstsq(rows.reshape(60, 2), beside.size[0] * seen[:, 0], rcond=None)[0]
    assert beside.moves == pytest.approx(np.linalg.norm(rows.reshape(60, 2) @ moved))
