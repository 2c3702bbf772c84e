"""The batch on 40 looks of tianshan against scipy and dense matrices."""

import numpy as np
import pytest
from scipy import optimize

import whiskjax as wj
from tests.locate.conftest import SIGMA_ENU_M
from tests.locate.textbooks import MOTIONS, TABLE_1, assert_in_sigmas, differentiated, enu, least_squares
from whiskjax.flights import tianshan

NOTHING = np.zeros(MOTIONS)


@pytest.fixture(scope="module")
def paper(run):
    """With R = (2 px)^2."""
    return run.locate(method="batch", throw=False)


@pytest.fixture(scope="module")
def full(run):
    return run.locate(method="batch", errors=tianshan.frame_errors())


def test_with_constant_r_it_is_least_squares_of_scipy(run, paper):
    root = np.linalg.inv(np.linalg.cholesky(run.prior))

    def residuals(x):
        image = [run.image(k, x, NOTHING) for k in range(40)]
        return np.concatenate([((run.pixel_px - image) / 2.0).ravel(), root @ x])

    found = optimize.least_squares(
        residuals, np.zeros(3), lambda x: differentiated(residuals, x), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    # scipy stops where the cost no longer changes in float64, some 1e-6 sigma before the normal equations vanish.
    best = found.x - covariance @ found.jac.T @ found.fun
    error = np.asarray(paper.line_m) - run.anchor_m - best
    assert np.abs(error / np.sqrt(np.diag(covariance))).max() < 1e-6
    axes = enu(run.anchor_m + found.x)
    assert_in_sigmas(paper.covariance_enu_m2, axes.T @ covariance @ axes, axes.T @ covariance @ axes, 1e-8)
    np.testing.assert_allclose(paper.chi_square, 2 * found.cost, rtol=1e-9)
    np.testing.assert_allclose(paper.world_from_enu, axes, rtol=0, atol=1e-9)


def test_with_full_r_it_is_gauss_newton_with_dense_matrices(run, full):
    dense = least_squares(run.image, run.pixel_px, np.zeros(3), run.prior, sigma_w=TABLE_1)
    error = np.asarray(full.point_m) - run.anchor_m - dense.state
    assert np.abs(error / np.sqrt(np.diag(dense.formal))).max() < 1e-6
    axes = enu(run.anchor_m + dense.state)
    assert_in_sigmas(full.covariance_enu_m2, axes.T @ dense.formal @ axes, axes.T @ dense.formal @ axes, 1e-6)
    np.testing.assert_allclose(full.chi_square, dense.cost, rtol=1e-6)
    # Residuals at the solution: fitted, so that their covariance is R - H C H^T.
    fitted = dense.noise - np.einsum("kan,nm,kbm->kab", dense.rows, dense.formal, dense.rows)
    np.testing.assert_allclose(full.looks.innovation_px, dense.residual, rtol=0, atol=1e-4)
    assert_in_sigmas(full.looks.innovation_covariance_px2, fitted, fitted, 1e-6)
    nis = np.einsum("ka,kab,kb->k", dense.residual, np.linalg.inv(fitted), dense.residual)
    np.testing.assert_allclose(full.looks.nis, nis, rtol=1e-5, atol=1e-6)


def test_a_batch_has_one_answer_for_all_looks(full):
    np.testing.assert_array_equal(full.looks.point_m, np.tile(full.point_m, (40, 1)))
    covariance = np.asarray(full.covariance_enu_m2)
    np.testing.assert_allclose(full.looks.covariance_enu_m2, np.tile(covariance, (40, 1, 1)), rtol=1e-12, atol=1e-12)


def test_the_guess_hardly_matters(run, full):
    """A guess 500 m off moves the answer by less than a hundredth of a sigma."""
    moved = wj.Guess.around(run.anchor_m + 500 * run.anchor_m / np.linalg.norm(run.anchor_m), SIGMA_ENU_M)
    other = run.locate(method="batch", errors=tianshan.frame_errors(), guess=moved)
    away = np.asarray(full.world_from_enu).T @ (np.asarray(other.point_m) - np.asarray(full.point_m))
    assert (np.abs(away) < 0.01 * np.sqrt(np.diag(full.covariance_enu_m2))).all()
