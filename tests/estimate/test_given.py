"""An earlier answer as joint prior: least squares with the whole inverse covariance, by scipy."""

import jax
import numpy as np
import pytest
from scipy.optimize import least_squares

import whiskjax as wj
from tests.estimate.test_pure import PIXEL_PX, POINT_M, SIZE, TIME_S, UNKNOWNS, N, sensor

SEEN = wj.Observations(wj.Shot(time_s=TIME_S), POINT_M, PIXEL_PX, np.full((N, 2), 0.7), np.ones(N, dtype=bool))
ROOT = 0.05 * SIZE[:, None] * np.array([[1.0, 0, 0, 0], [0.6, 0.8, 0, 0], [-0.5, 0.3, 0.4, 0], [0.2, -0.7, 0.1, 0.5]])
MEAN = np.array([0.008, -0.018, 0.02, 1003.0])


def knowledge(covariance, unknowns=UNKNOWNS):
    names, places = tuple(x.name for x in unknowns), tuple(x.places for x in unknowns)
    return wj.Estimate(MEAN, covariance, np.ones(4), np.zeros(()), 0, wj.RESULTS.successful, names, places)


def test_a_joint_prior_is_scipys():
    project = jax.jit(lambda v: wj.project(wj.assign(sensor(), UNKNOWNS, v), SEEN.shot, POINT_M, throw=False).pixel_px)

    def residuals(u):
        value = MEAN + SIZE * u
        seen = (PIXEL_PX - np.asarray(project(value))) / 0.7
        return np.concatenate([seen.ravel(), np.linalg.solve(ROOT, value - MEAN)])

    best = least_squares(residuals, np.zeros(4), xtol=1e-15, ftol=1e-15, gtol=1e-15, jac="3-point")
    expected = np.linalg.inv(best.jac.T @ best.jac)
    found = wj.calibrate(sensor(), SEEN, knowledge(ROOT @ ROOT.T))
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((found.value - MEAN) / SIZE / sigma, best.x / sigma, atol=1e-5)
    covariance = np.asarray(found.estimate.covariance) / np.outer(SIZE, SIZE) / np.outer(sigma, sigma)
    np.testing.assert_allclose(covariance, expected / np.outer(sigma, sigma), atol=1e-5)
    # Taken one by one, the same priors say something else.
    alone = wj.calibrate(sensor(), SEEN, knowledge(np.diag(np.diag(ROOT @ ROOT.T))))
    assert np.abs((alone.value - found.value) / SIZE / sigma).max() > 0.1


def test_what_is_no_joint_prior_is_named():
    flat = ROOT.copy()
    flat[3] = flat[2]
    with pytest.raises(wj.WhiskjaxError, match="not positive definite"):
        wj.calibrate(sensor(), SEEN, knowledge(flat @ flat.T))
    elsewhere = [*UNKNOWNS[:3], wj.Unknown("arm", "wing.lever_arm_m[0]", 0.0, 1.0)]
    with pytest.raises(wj.WhiskjaxError, match="wing"):
        wj.calibrate(sensor(), SEEN, knowledge(ROOT @ ROOT.T, elsewhere))
