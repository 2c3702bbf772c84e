"""A target that moves, against the textbook's transition and its own linear limit."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad_vec
from scipy.linalg import block_diag

import whiskjax as wj
from tests.locate.textbooks import TABLE_1, assert_in_sigmas, enu, kalman, least_squares
from whiskjax.flights import tianshan
from whiskjax.locate.motion import Transition, predict

VELOCITY_ENU_MPS = np.array([6.0, -4.0, 0.2])
SIGMA_ENU_MPS = np.array([8.0, 8.0, 0.5])
DENSITY_ENU = np.array([0.02, 0.03, 0.001])


def forward(step_s, n=6):
    f = np.eye(n)
    f[:3, 3:6] = step_s * np.eye(3)
    return f


def spread(step_s, density):
    """Q as the integral of what the acceleration adds at each moment."""
    into = np.vstack([np.zeros((3, 3)), np.eye(3)])

    def added(t):
        return forward(step_s - t) @ into @ density @ into.T @ forward(step_s - t).T

    return quad_vec(added, 0, step_s)[0] if step_s > 0 else np.zeros((6, 6))


@pytest.mark.parametrize("n", [6, 8])
def test_the_prediction_is_that_of_the_textbook(n):
    rng = np.random.default_rng(n)
    state, root, q = rng.normal(size=n), rng.normal(size=(n, n)), rng.normal(size=(3, 3))
    covariance, density = root @ root.T, q @ q.T
    moved, wider = predict(tuple(state), tuple(map(tuple, covariance)), Transition(3.7, tuple(map(tuple, density))))
    f = forward(3.7, n)
    np.testing.assert_allclose(moved, f @ state, rtol=0, atol=1e-13)
    expected = f @ covariance @ f.T + block_diag(spread(3.7, density), np.zeros((n - 6, n - 6)))
    np.testing.assert_allclose(np.array(wider), expected, rtol=1e-12, atol=1e-12)


@pytest.fixture(scope="module")
def pixels(run):
    """The target passes its place at the last look; the pixel moves as its image does."""
    velocity = enu(run.target_m) @ VELOCITY_ENU_MPS
    since = run.time_s - run.time_s[-1]
    moved = [run.chain.image(k, run.target_m + since[k] * velocity) - run.chain.image(k, run.target_m) for k in range(40)]
    return run.pixel_px + np.array(moved)


def locate(run, pixels, acceleration=DENSITY_ENU, **options):
    motion = wj.ConstantVelocity(SIGMA_ENU_MPS, acceleration)
    return run.locate(run.looks_at(pixels), motion=motion, errors=tianshan.frame_errors(), throw=False, **options)


def prior_of(run, anchor_m, position):
    axes = enu(anchor_m)
    return block_diag(position, axes @ np.diag(SIGMA_ENU_MPS**2) @ axes.T)


def assert_at_the_end(found, anchor_m, state, covariance, tolerance):
    sigma = np.sqrt(np.diag(covariance))
    axes = enu(np.asarray(found.line_m))
    assert np.abs((np.asarray(found.line_m) - anchor_m - state[:3]) / sigma[:3]).max() < tolerance
    assert np.abs((axes @ np.asarray(found.velocity_enu_mps) - state[3:6]) / sigma[3:6]).max() < tolerance
    for got, block in ((found.covariance_enu_m2, covariance[:3, :3]), (found.velocity_covariance_enu, covariance[3:6, 3:6])):
        expected = axes.T @ block @ axes
        assert_in_sigmas(got, expected, expected, tolerance)


def test_the_iterated_filter_follows_a_target_as_the_textbook_does(run, pixels):
    found = locate(run, pixels)
    axes = enu(run.anchor_m)
    density = axes @ np.diag(DENSITY_ENU) @ axes.T

    def moves(k):
        step = run.time_s[k] - run.time_s[max(k - 1, 0)]
        return forward(step), spread(step, density)

    prior = prior_of(run, run.anchor_m, run.prior)
    plain = kalman(run.image, pixels, np.zeros(6), prior, sigma_w=TABLE_1, relinearised=5, moves=moves)
    assert_at_the_end(found, run.anchor_m, plain.state[-1], plain.covariance[-1], 1e-6)
    sigma = np.sqrt(np.diagonal(plain.covariance, axis1=1, axis2=2))[:, :3]
    assert np.abs((np.asarray(found.looks.point_m) - run.anchor_m - plain.state[:, :3]) / sigma).max() < 1e-6
    np.testing.assert_allclose(found.looks.nis, plain.nis, rtol=1e-4, atol=1e-6)
    velocity = np.asarray(found.velocity_enu_mps) - VELOCITY_ENU_MPS
    assert velocity @ np.linalg.solve(found.velocity_covariance_enu, velocity) < 21.1
    assert found.is_sound


def test_a_target_with_accelerations_is_gated_by_the_filter(run, pixels):
    """Least squares does not know where it went: the textbook's filter leaves out a look whose NIS is too large."""
    spoilt = pixels + np.where(np.arange(40) == 25, 3000.0, 0.0)[:, None]
    found = locate(run, spoilt, gate=1e-3)
    axes = enu(run.anchor_m)
    density = axes @ np.diag(DENSITY_ENU) @ axes.T

    def moves(k):
        step = run.time_s[k] - run.time_s[max(k - 1, 0)]
        return forward(step), spread(step, density)

    prior, gate = prior_of(run, run.anchor_m, run.prior), stats.chi2.isf(1e-3, 2)
    plain = kalman(run.image, spoilt, np.zeros(6), prior, sigma_w=TABLE_1, relinearised=5, moves=moves, gate=gate)
    assert 25 in found.gated and found.gated == tuple(np.flatnonzero(plain.nis > gate))
    assert_at_the_end(found, run.anchor_m, plain.state[-1], plain.covariance[-1], 1e-6)
    assert np.isnan(found.off_optimum_sigmas)


def test_a_batch_of_an_even_motion_is_gauss_newton_with_dense_matrices(run, pixels):
    found = locate(run, pixels, np.zeros(3), method="batch")
    since = run.time_s - run.time_s[-1]

    def image(k, state, w):
        return run.image(k, state[:3] + since[k] * state[3:6], w)

    f = forward(run.time_s[-1] - run.time_s[0])
    prior = f @ prior_of(run, run.anchor_m, run.prior) @ f.T
    dense = least_squares(image, pixels, np.zeros(6), prior, sigma_w=TABLE_1, steps=12)
    assert_at_the_end(found, run.anchor_m, dense.state, dense.formal, 1e-6)
    np.testing.assert_allclose(found.chi_square, dense.cost, rtol=1e-6)
    # The track is where the target was at each look.
    track = run.anchor_m + dense.state[:3] + since[:, None] * dense.state[3:6]
    assert np.abs(np.asarray(found.looks.point_m) - track).max() < 1e-4


def test_in_the_linear_limit_filter_and_batch_agree(run, pixels):
    """With a guess that is known to metres the looks are linear in it, and what a filter forgets is nothing."""
    start = run.target_m + (run.time_s[0] - run.time_s[-1]) * enu(run.target_m) @ VELOCITY_ENU_MPS
    guess = wj.Guess.around(start, [5.0, 5.0, 5.0])
    filtered = locate(run, pixels, np.zeros(3), guess=guess)
    batch = locate(run, pixels, np.zeros(3), guess=guess, method="batch")
    sigma = np.sqrt(np.diag(batch.covariance_enu_m2))
    away = np.asarray(batch.world_from_enu).T @ (np.asarray(filtered.line_m) - np.asarray(batch.line_m))
    assert np.abs(away / sigma).max() < 0.02
    assert_in_sigmas(filtered.covariance_enu_m2, batch.covariance_enu_m2, batch.covariance_enu_m2, 0.02)


def test_a_motion_of_another_shape_is_refused():
    with pytest.raises(wj.WhiskjaxError, match=r"sigma_enu_mps has shape \(2,\)"):
        wj.ConstantVelocity([1.0, 2.0])
    with pytest.raises(wj.WhiskjaxError, match=r"acceleration_enu has shape \(\)"):
        wj.ConstantVelocity([1.0, 2.0, 3.0], 0.1)
