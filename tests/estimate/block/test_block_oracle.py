"""The block adjustment against one dense least-squares problem that eliminates nothing."""

import jax
import numpy as np
import optimistix as optx
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

import whiskjax as wj
from tests.estimate.block.textbook import PRIOR, SCENES, SIGMA, Textbook, epochs_of
from whiskjax.flights import songshan


class Case:
    """One scene, adjusted and solved densely."""

    def __init__(self, scene, drawn, adjusted):
        self.drawn, self.adjusted = drawn, adjusted
        self.textbook = Textbook(scene, drawn.block, drawn.sensor["body"], epochs_of(scene))
        # From the true points, which the adjustment never sees.
        self.z, self.cost, self.covariance = self.textbook.solve(drawn.point_m)
        a, b, _ = self.textbook.shape
        self.motion, self.unknown, self.point = self.textbook.parts(self.z)
        sigma = np.sqrt(np.diag(self.covariance))
        self.sigma_motion, self.sigma_unknown = sigma[:a].reshape(6, -1).T * SIGMA, sigma[a : a + b] * PRIOR
        self.sigma_point = sigma[a + b :].reshape(-1, 3)


@pytest.fixture(scope="module", params=["orientation images", pytest.param("spline", marks=pytest.mark.slow)])
def case(request, drawn, adjusted):
    scene = SCENES[request.param]
    if request.param == "orientation images":
        return Case(scene, drawn, adjusted)
    other = songshan.simulate_block(scene, 2)
    errors = songshan.frame_errors(scene)
    return Case(scene, other, wj.adjust(other.sensor, other.block, songshan.unknowns(scene), errors=errors, retime=False))


def test_cost(case):
    assert case.adjusted.cost == pytest.approx(case.cost, rel=1e-9)
    assert case.adjusted.steps <= 12
    assert case.adjusted.result == wj.RESULTS.successful


def test_freedom(case):
    """Observations less unknowns, counted on the dense system."""
    rows = case.textbook.residuals(case.z).shape[0]
    assert case.adjusted.freedom == rows - len(case.z)
    assert case.adjusted.variance_factor == pytest.approx(case.cost / case.adjusted.freedom, rel=1e-9)


def test_unknowns_points_and_motions(case):
    """All within a millionth of their sigma."""
    np.testing.assert_allclose((case.adjusted.value - case.unknown) / case.sigma_unknown, 0, atol=1e-6)
    np.testing.assert_allclose((case.adjusted.point_m - case.point) / case.sigma_point, 0, atol=1e-6)
    link = case.adjusted.sensor["pos_error"]
    found = np.concatenate([link.turn_rad, link.shift_m], axis=1)
    np.testing.assert_allclose((found - case.motion) / case.sigma_motion, 0, atol=1e-6)


def test_residuals(case):
    rays = 2 * len(case.drawn.block)
    found = (case.adjusted.residual_px / case.drawn.block.sigma_px).ravel()
    np.testing.assert_allclose(found, case.textbook.residuals(case.z)[:rays], rtol=0, atol=1e-6)


def test_covariances(case):
    """The reduced system against the inverse of the whole."""
    a, b, _ = case.textbook.shape
    trust = case.adjusted.trust
    root = np.outer(case.sigma_unknown, case.sigma_unknown)
    whole = case.covariance[a : a + b, a : a + b] * np.outer(PRIOR, PRIOR)
    np.testing.assert_allclose(trust.covariance / root, whole / root, rtol=0, atol=1e-6)
    np.testing.assert_allclose(trust.sigma, case.sigma_unknown, rtol=1e-6)
    np.testing.assert_allclose(trust.stations, case.sigma_motion, rtol=1e-6)
    np.testing.assert_allclose(trust.data_share, 1 - (case.sigma_unknown / PRIOR) ** 2, rtol=0, atol=1e-6)
    points = case.covariance[a + b :, a + b :].reshape(len(case.point), 3, len(case.point), 3)
    own = np.stack([points[i, :, i] for i in range(len(case.point))])
    size = case.sigma_point[:, :, None] * case.sigma_point[:, None]
    np.testing.assert_allclose(case.adjusted.covariance_m2 / size, own / size, rtol=0, atol=1e-6)


def test_check_points_are_judged_by_their_joint_covariance(case):
    """e^T (C + S)^-1 e with C out of the inverse of the whole, all check points together, and each of them alone."""
    a, b, _ = case.textbook.shape
    block, check = case.drawn.block, np.flatnonzero(case.drawn.block.role == "check")
    rows = (a + b + 3 * check[:, None] + np.arange(3)).ravel()
    spread = case.covariance[np.ix_(rows, rows)] + block_diag(*block.covariance_m2[check])
    error = (case.point - block.position_m)[check].ravel()
    found = case.adjusted.check
    assert found.chi_square == pytest.approx(error @ np.linalg.solve(spread, error), rel=1e-6)
    assert found.freedom == 3 * len(check) and found.tail_probability == pytest.approx(chi2(3 * len(check)).sf(found.chi_square))
    alone = [
        float(e @ np.linalg.solve(spread[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], e)) for i, e in enumerate(error.reshape(-1, 3))
    ]
    assert found.worst[0] == block.point_label(int(check[np.argmax(alone)]))
    assert found.worst_sigmas[0] == pytest.approx(np.sqrt(max(alone)), rel=1e-6)


def test_levenberg_marquardt_reaches_the_same_cost(case):
    """optimistix on the dense residual vector."""
    z = np.concatenate([np.zeros(sum(case.textbook.shape[:2])), case.drawn.point_m.ravel()])
    solver = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
    found = optx.least_squares(lambda z, _: case.textbook.residuals(z), solver, z, max_steps=60)
    assert case.adjusted.cost == pytest.approx(float((jax.jit(case.textbook.residuals)(found.value) ** 2).sum()), rel=1e-9)
