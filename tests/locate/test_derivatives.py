"""Derivatives of a located point by what was measured and by numbers of the sensor, through filter and batch."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.derivatives import assert_derivatives
from tests.locate.conftest import draw
from whiskjax.flights import tianshan


@pytest.mark.parametrize("method", ["extended", "batch"])
def test_a_point_follows_pixels_and_sensor(method):
    run = draw(8, looks=12)
    noise = tianshan.frame_errors()

    def located(x):
        """Two pixels beside one that was missed, the yaw of all records, the focal length, and the height of the guess."""
        pixel = jnp.asarray(run.pixel_px).at[3, 0].add(x[0]).at[11, 1].add(x[1]).at[5].set(jnp.nan)
        r = run.recorded
        heading = r.heading_rad + x[2]
        sensor = tianshan.sensor(eqx.tree_at(lambda r: r.heading_rad, r, heading))
        sensor = eqx.tree_at(lambda s: s.camera.focal_px, sensor, 1e5 + x[3])
        anchor = jnp.asarray(run.anchor_m)
        guess = wj.Guess.around(anchor + x[4] * anchor / jnp.linalg.norm(anchor), [1216.0, 1666.0, 1500.0])
        looks = wj.Looks(wj.Shot(time_s=run.time_s), pixel, (2.0, 2.0))
        found = wj.locate(sensor, looks, guess=guess, errors=noise, method=method, throw=False)
        return found.point_m - run.anchor_m

    # Metres; the point moves by 0.1 to 40 m. A batch ends its steps at rounding of ECEF, 1e-8 m.
    assert_derivatives(located, np.zeros(5), step=[20.0, 20.0, 1e-3, 200.0, 50.0], tolerance=2e-5)
