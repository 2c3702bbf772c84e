"""The density of the air as an unknown of a calibration, seen in oblique looks at a surveyed point."""

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.flights import tianshan
from whiskjax.flights.tianshan_open import in_time
from whiskjax.flights.tianshan_study import point_of

# From 60 deg off nadir at broadside to 72 deg at the ends: the air can be told from a turn of the camera.
SCENE = tianshan.Scene("fly", 12, off_nadir_rad=np.radians(60.0), spacing_m=4000.0)
TIME_S = tianshan.time_s(SCENE)
UNKNOWNS = (
    wj.Unknown("boresight x", "boresight.angles_rad[0]", 0.0, 1e-4),
    wj.Unknown("air", "refraction.scale", 1.0, 0.5),
)
TRUTH = np.array([-4e-5, 1.07])
SIGMA_PX = 0.3


@pytest.fixture(scope="module")
def sensor():
    """The gimballed camera in air, with a boresight."""
    dry = in_time(tianshan.true_records(SCENE), TIME_S).after("gimbal_pitch", "boresight", wj.Mount(angles_rad=np.zeros(3)))
    return wj.Sensor(dict(zip(dry.names, dry.links, strict=True)), dry.camera, wj.Refraction())


def test_calibrate_finds_the_scale_of_refraction(sensor):
    shot, points = wj.Shot(time_s=TIME_S), np.tile(point_of(SCENE.target), (SCENE.looks, 1))

    def seen(value):
        return np.asarray(wj.project(wj.assign(sensor, UNKNOWNS, value), shot, points).pixel_px)

    measured = seen(TRUTH) + np.random.default_rng(4).normal(0, SIGMA_PX, (SCENE.looks, 2))
    observations = wj.Observations(shot, points, measured, np.full((SCENE.looks, 2), SIGMA_PX), np.ones(SCENE.looks, dtype=bool))
    found = wj.calibrate(sensor, observations, UNKNOWNS)
    # The covariance from differences of whole chains at the solution, and the Gauss-Newton step there, which must be nothing.
    step = np.diag([1e-6, 1e-3])
    rows = np.stack([(seen(found.value + s) - seen(found.value - s)).ravel() / (2 * s.sum()) for s in step], axis=1) / SIGMA_PX
    prior = np.diag([unknown.sigma**-2.0 for unknown in UNKNOWNS])
    expected = np.linalg.inv(rows.T @ rows + prior)
    sigma = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.posterior.covariance / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-5)
    left = (measured - seen(found.value)).ravel() / SIGMA_PX
    mean = np.array([unknown.mean for unknown in UNKNOWNS])
    np.testing.assert_allclose(expected @ (rows.T @ left + prior @ (mean - found.value)) / sigma, 0.0, atol=1e-5)
    assert sigma[1] < 0.05, "the looks tell, not the prior"
    assert (np.abs(found.value - TRUTH) < 2 * sigma).all()
    assert float(found.sensor["refraction"].scale) == found.value[1]
