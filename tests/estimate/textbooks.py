"""What the tests of this room compare with: a plain loop over the whiskbroom, a small camera, dense made-up problems."""

from types import SimpleNamespace

import jax
import numpy as np
from pyproj import Transformer
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation, Slerp

import whiskjax as wj
from whiskjax.estimate.linearised import LeastSquares, Linearised
from whiskjax.estimate.surveys import common_surveys


class Stations:
    """A frame camera above 12 points at two stations: small enough to compile in a second or two.

    The first unknowns are the camera's mount (angles, prior) and its focal length (no prior); each station's pose may be off by a
    bias at the joint `pos`. Noise-free unless a seed says otherwise.
    """

    def __init__(self, seed=None):
        poses = {
            "a": wj.Mount(lever_arm_m=[30.0, -10.0, 200.0], angles_rad=[0.05, -0.1, 0.3]),
            "b": wj.Mount(lever_arm_m=[-40.0, 20.0, 260.0], angles_rad=[-0.1, 0.15, 2.0]),
        }
        none = wj.Correction(wj.Bias(), np.zeros((1, 3)), np.zeros((1, 3)))
        mounts = {name: wj.Mount(angles_rad=[0.0, 0.0, 0.0]) for name in poses}
        links = {
            "station": wj.By("image", poses),
            "pos": wj.By("image", dict.fromkeys(poses, none)),
            "arm": wj.By("image", mounts),
        }
        self.sensor = wj.Sensor(links, wj.FrameCamera(1000.0, (0.0, 0.0)))
        rng = np.random.default_rng(8)
        point = np.concatenate([rng.uniform(-60, 60, (12, 2)), rng.uniform(0, 40, (12, 1))], -1)
        self.shot = wj.Shot(time_s=np.zeros(24), image=np.repeat([0, 1], 12))
        self.point_m = np.tile(point, (2, 1))
        pixel = np.asarray(wj.project(self.sensor, self.shot, self.point_m).pixel_px)
        self.sigma_px = np.random.default_rng(9).uniform(0.5, 2.0, (24, 2))
        if seed is not None:
            pixel = pixel + np.random.default_rng(seed).normal(size=(24, 2)) * self.sigma_px
        self.observations = wj.Observations(
            self.shot, self.point_m, pixel, self.sigma_px, np.arange(24) % 12 < 10, images=["a"] * 12 + ["b"] * 12
        )
        both = [(f"arm.a.angles_rad[{i}]", f"arm.b.angles_rad[{i}]") for i in range(3)]
        self.angles = [wj.Unknown(f"arm_{axis}", where, 0.0, 0.01) for axis, where in zip("xyz", both, strict=True)]
        self.unknowns = [*self.angles, wj.Unknown("focal", "camera.focal_px", scale=10.0)]
        self.biases = wj.motion_unknowns(self.sensor, "pos", turn_sigma_rad=[1e-3, 1e-3, 2e-3], shift_sigma_m=[0.2, 0.3, 0.5])

    def derivatives(self, unknowns, values):
        """Of all pixels by the unknowns, (24, 2, k): autodiff through `project` alone."""

        def pixels(v):
            return wj.project(wj.assign(self.sensor, unknowns, v), self.shot, self.point_m, throw=False).pixel_px

        return np.asarray(jax.jit(jax.jacfwd(pixels))(np.asarray(values, dtype=float)))


class MadeUp:
    """A linear problem of random numbers: as our estimators take it, and as dense matrices over all 2n + k measurements.

    Unknowns are whitened; those of `has_prior` have a prior of sigma 1 about 0. Weights of x and y are correlated through the
    points' coordinates, and those of the `rays` that see one point. Check points come last, and share points with others.
    """

    def __init__(self, seed, n=40, check=6, has_prior=(True, True, True, False, False), point_m=0.5, rays=1):
        rng = np.random.default_rng(seed)
        self.k, self.has_prior = len(has_prior), np.array(has_prior)
        self.used = np.arange(n) < n - check
        self.sigma_px = rng.uniform(0.5, 2.0, (n, 2))
        follows = rng.normal(size=(n, 2, 3))
        self.point = np.arange(n) % (n // rays)
        root = (point_m * rng.normal(size=(n // rays, 3, 3)))[self.point]
        self.point_px2 = follows @ root @ np.swapaxes(root, 1, 2) @ np.swapaxes(follows, 1, 2)
        self.covariance_px2 = self.sigma_px[:, :, None] ** 2 * np.eye(2) + self.point_px2
        # Of all pixel coordinates: what rays of one point share, and with it their own.
        by = (follows @ root).reshape(2 * n, 3)
        self.survey_px2 = by @ by.T * np.repeat(np.repeat(self.point[:, None] == self.point, 2, axis=0), 2, axis=1)
        self.whole_px2 = np.diag(self.sigma_px.ravel() ** 2) + self.survey_px2
        self.rows_px = rng.normal(size=(n, 2, self.k)) * rng.uniform(0.2, 3.0, self.k)
        truth = rng.normal(size=self.k)
        error = (np.linalg.cholesky(self.whole_px2) @ rng.normal(size=2 * n)).reshape(n, 2)
        self.error_px = error
        self.measured_px = error - self.rows_px @ truth  # residual at u = 0
        self.observations = wj.Observations(
            wj.Shot(time_s=np.arange(n, dtype=float)),
            rng.normal(size=(n // rays, 3))[self.point],
            np.zeros((n, 2)),
            self.sigma_px,
            self.used,
            root @ np.swapaxes(root, 1, 2),
            ["A" if i % 2 else "B" for i in range(n)],
            point=self.point,
        )
        triangle = np.linalg.inv(np.linalg.cholesky(self.covariance_px2))
        weight = np.stack([triangle[:, 0, 0], triangle[:, 1, 0], triangle[:, 1, 1]], -1)
        problem = SimpleNamespace(scale=np.ones(self.k), mean=np.zeros(self.k), loss=None)
        # Measurements of pixels, and of zero by the priors.
        self.design = np.concatenate([self.rows_px[self.used].reshape(-1, self.k), np.eye(self.k)[self.has_prior]])
        self.deciding = np.flatnonzero(np.repeat(self.used, 2))
        self.weights = np.linalg.inv(block_diag(self.of_deciding(self.whole_px2), np.eye(sum(has_prior))))
        right = np.concatenate([self.measured_px[self.used].ravel(), np.zeros(sum(has_prior))])
        self.unknown_covariance = np.linalg.inv(self.design.T @ self.weights @ self.design)
        u = -self.unknown_covariance @ self.design.T @ self.weights @ right
        self.residuals = right + self.design @ u
        residual_px = self.measured_px + self.rows_px @ u
        unseen = np.zeros(n, dtype=np.int32)
        self.ready = LeastSquares(
            None,
            problem,
            [],
            self.observations,
            u,
            follows,
            self.point_px2,
            weight,
            np.diag(self.has_prior.astype(float)),
            self.measured_px,
            unseen,
            common_surveys(self.point, self.observations.point_covariance_m2, follows, np.zeros((n, 2, 2))),
        )
        self.here = Linearised(
            u,
            residual_px,
            np.einsum("nij,nj->ni", triangle, residual_px),
            np.einsum("nij,njk->nik", triangle, self.rows_px),
            self.rows_px,
            unseen,
        )

    def of_deciding(self, covariance):
        """Of the pixel coordinates that decide."""
        return covariance[np.ix_(self.deciding, self.deciding)]


class Textbook:
    """Collinearity of Jin et al. (2024) with its own interpolation, geodesy and rotations; x is the 15 values in m and rad.

    Of the control points, or of all.
    """

    def __init__(self, flight, check_too=False):
        observations = flight.observations()
        used = observations.is_control | check_too
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
        rotations = Rotation.from_euler("XYZ", np.stack([left, right])).as_matrix()
        camera = Rotation.from_euler("XYZ", angles).as_matrix()
        turn = Rotation.from_euler("XY", np.stack([self.scan, self.pitch], -1)).as_matrix()
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
