"""One simulated flight and one calibration, shared by the tests of this room."""

import numpy as np
import pytest

import whiskjax as wj
from whiskjax.flights import haian


@pytest.fixture(scope="session")
def flight():
    return haian.simulate(11)


@pytest.fixture(scope="session")
def calibration(flight):
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)


@pytest.fixture(scope="session")
def textbook(flight):
    """Whitened residuals of the whiskbroom as a plain loop over observations: paper 000, equation 9, numpy and scipy only."""
    return Textbook(flight)


class Textbook:
    """Collinearity of paper 000 with its own interpolation, geodesy and rotations; x is the 15 values in m and rad."""

    def __init__(self, flight):
        from pyproj import Transformer
        from scipy.spatial.transform import Rotation, Slerp

        self.rotation = Rotation
        observations = flight.observations()
        used = observations.is_control
        body = flight.sensor["body"]
        time = np.asarray(body.knots.time_s)
        position = np.stack([np.asarray(c) for c in body.position_m], -1)
        attitude = Slerp(time, Rotation.from_quat(np.stack([np.asarray(c) for c in body.quaternion], -1)))
        at = np.asarray(observations.shot.time_s)[used]
        self.origin = np.stack([np.interp(at, time, c) for c in position.T], -1)
        # x forward, y left, z up from x forward, y right, z down.
        self.flu = attitude(at).as_matrix() @ np.diag([1.0, -1.0, -1.0])
        self.scan, self.pitch = (
            np.interp(at, np.asarray(flight.sensor[k].encoder.knots.time_s), np.asarray(flight.sensor[k].encoder.angle_rad))
            for k in ("scan", "pitch")
        )
        self.left = np.asarray(observations.shot.swing)[used] == 0
        self.points = observations.point_m[used]
        self.pixel = observations.pixel_px[used]
        lon, lat, _ = Transformer.from_crs(4978, 4979, always_xy=True).transform(*self.points.T)
        self.up = np.stack(
            [
                np.cos(np.radians(lat)) * np.cos(np.radians(lon)),
                np.cos(np.radians(lat)) * np.sin(np.radians(lon)),
                np.sin(np.radians(lat)),
            ],
            -1,
        )
        self.sigma = observations.sigma_px[used]

    def residuals_px(self, x):
        gps, left, right, arm, angles = x.reshape(5, 3)
        rotations = self.rotation.from_euler("XYZ", np.stack([left, right])).as_matrix()
        camera = self.rotation.from_euler("XYZ", angles).as_matrix()
        turn = self.rotation.from_euler("XY", np.stack([self.scan, self.pitch], -1)).as_matrix()
        out = np.empty_like(self.pixel)
        for i, point in enumerate(self.points):
            platform = rotations[0] if self.left[i] else rotations[1]
            q = camera.T @ (turn[i].T @ (platform.T @ (self.flu[i].T @ (point - self.origin[i]) - gps)) - arm)
            sign = 1.0 if self.left[i] else -1.0
            out[i] = self.pixel[i] - np.array([-10750 * q[0] / q[2], sign * -10750 * q[1] / q[2]])
        return out

    def covariances_px2(self, x, horizontal_m=0.03, vertical_m=0.05, step_m=1.0):
        """Image noise plus the survey's, through central differences of the projection."""
        points = self.points.copy()
        derivative = np.empty((len(points), 2, 3))
        for axis in range(3):
            sides = []
            for sign in (1, -1):
                self.points = points + sign * step_m * np.eye(3)[axis]
                sides.append(-self.residuals_px(x))
            derivative[:, :, axis] = (sides[0] - sides[1]) / (2 * step_m)
        self.points = points
        flat = np.eye(3) - np.einsum("ni,nj->nij", self.up, self.up)
        survey = horizontal_m**2 * flat + vertical_m**2 * np.einsum("ni,nj->nij", self.up, self.up)
        noise = np.einsum("ni,ij->nij", self.sigma**2, np.eye(2))
        return noise + derivative @ survey @ np.swapaxes(derivative, 1, 2)
