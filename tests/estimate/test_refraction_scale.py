"""The density of the air as an unknown of a calibration: oblique frames of surveyed points, and a boresight beside it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles

LOOKS, SIGMA_PX, TRUTH = 12, 0.3, np.array([-4e-5, 1.07])
UNKNOWNS = (wj.Unknown("boresight x", "boresight.angles_rad[0]", 0.0, 1e-4), wj.Unknown("air", "refraction.scale", 1.0, 0.5))
SHOT = wj.Shot(image=np.arange(LOOKS))
# From 10 km, 15 to 40 km away: 60 to 78 deg off nadir, so that the air can be told from a turn of the camera.
POINTS = oracles.ecef(np.radians(43.3), np.radians(84.2) + np.linspace(15e3, 40e3, LOOKS) / 4.65e6, 1551.0)


def flown_over():
    """A camera above one place that looks along its -z axis at one point after the other, x to the side."""
    platform = oracles.ecef(np.radians(43.3), np.radians(84.2), 10e3)
    back = (platform - POINTS) / np.linalg.norm(platform - POINTS, axis=1)[:, None]
    side = np.cross(platform, back)
    side /= np.linalg.norm(side, axis=1)[:, None]
    axes = Rotation.from_matrix(np.stack([side, np.cross(back, side), back], axis=-1))
    links = {
        "body": wj.PosePerImage(np.tile(platform, (LOOKS, 1)), axes.as_quat()),
        "boresight": wj.Mount(angles_rad=np.zeros(3)),
    }
    return wj.Sensor(links, wj.FrameCamera(1e5, (0.0, 0.0)), wj.Refraction())


@pytest.mark.slow
def test_calibrate_finds_the_scale_of_refraction():
    sensor = flown_over()

    def seen(value):
        return np.asarray(wj.project(wj.assign(sensor, UNKNOWNS, value), SHOT, POINTS).pixel_px)

    measured = seen(TRUTH) + np.random.default_rng(4).normal(0, SIGMA_PX, (LOOKS, 2))
    sigma_px, is_control = np.full((LOOKS, 2), SIGMA_PX), np.ones(LOOKS, dtype=bool)
    found = wj.calibrate(sensor, wj.Observations(SHOT, POINTS, measured, sigma_px, is_control), UNKNOWNS)
    # The covariance from differences of whole chains at the solution, and the Gauss-Newton step there, which must be nothing.
    step = np.diag([1e-6, 1e-3])
    rows = np.stack([(seen(found.value + s) - seen(found.value - s)).ravel() / (2 * s.sum()) for s in step], axis=1) / SIGMA_PX
    prior = np.diag([1e-4**-2, 0.5**-2])
    expected = np.linalg.inv(rows.T @ rows + prior)
    sigma = np.sqrt(np.diag(expected))
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(found.posterior.covariance / scale, expected / scale, rtol=0, atol=1e-5)
    left = (measured - seen(found.value)).ravel() / SIGMA_PX
    gradient = rows.T @ left + prior @ (np.array([0.0, 1.0]) - found.value)
    np.testing.assert_allclose(expected @ gradient / sigma, 0.0, rtol=0, atol=1e-5)
    assert sigma[1] < 0.05, "the looks tell, not the prior"
    assert (np.abs(found.value - TRUTH) < 2 * sigma).all()
    assert float(found.sensor["refraction"].scale) == found.value[1]
