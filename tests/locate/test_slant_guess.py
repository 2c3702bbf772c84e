"""How far off the first guess may be, by how slant its look is."""

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.locate.slant_guess import slant_guess

FLAT = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def seen_from(place_m):
    """One look of a camera that hangs at a place with its axes level, at the origin, behind one that was missed."""
    sensor = wj.Sensor({"mount": wj.Mount(place_m)}, wj.FrameCamera(1000.0, (0.0, 0.0)))
    x, y, height = place_m
    pixel = [[np.nan, np.nan], [-1000.0 * x / height, 1000.0 * y / height]]
    return sensor, wj.Looks(wj.Shot(), pixel, [1.0, 1.0])


@pytest.mark.parametrize(
    "place_m, sigma_m",
    [
        ((0.0, 6000.0, 9000.0), (1000.0, 1500.0)),  # the sigma of the height, times the tangent
        ((0.0, 0.0, 9000.0), (300.0, 1500.0)),  # straight down: a fifth at least
        ((600.0, 800.0, 900.0), (330.0, 300.0)),  # a third of a low platform's height
    ],
)
def test_sigmas_follow_from_height_and_slant(place_m, sigma_m):
    guess, off_vertical_rad = slant_guess(*seen_from(place_m), FLAT)
    np.testing.assert_allclose(guess.point_m, 0.0, rtol=0, atol=1e-9)
    across, up = sigma_m
    np.testing.assert_allclose(guess.covariance_enu_m2, np.diag([across**2, across**2, up**2]), rtol=1e-12)
    assert off_vertical_rad == pytest.approx(np.arctan2(np.hypot(*place_m[:2]), place_m[2]), abs=1e-12)
