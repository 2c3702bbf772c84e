"""Stone Soup (1.9, MIT): its extended and iterated Kalman filters over one target that moves, run here.

Claim: `wj.locate` has their states and covariances after every one of 16 looks, and the velocity at the end, within 1e-9 sigma.
The camera is written for Stone Soup here; its constant velocity with white acceleration is its own.
"""

import datetime
import functools
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.peers.bundle import in_sigmas
from tests.peers.figures import Figure, assert_inside

pytest.importorskip("stonesoup")
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, IteratedKalmanUpdater

PEER = "Stone Soup"
FOCAL_PX, SIGMA_PX, LOOKS = 2000.0, 0.5, 16
GUESS_M, SIGMA_M, SIGMA_MPS = np.array([60.0, 20.0, -30.0]), np.array([80.0, 80.0, 50.0]), np.array([8.0, 8.0, 0.5])
ACCELERATION = np.array([0.02, 0.03, 0.001])
PLACE, SPEED = [0, 2, 4], [1, 3, 5]  # Stone Soup's state is x, vx, y, vy, z, vz


class Camera(NonLinearGaussianMeasurement):
    """Column and row of a point, and their derivatives, by the collinearity equations."""

    centre_m: Any = Property(doc="Projection centre")
    camera_from_world: Any = Property(doc="Rotation matrix")

    @property
    def ndim_meas(self) -> int:
        return 2

    def _seen(self, state: Any) -> np.ndarray:
        return self.camera_from_world @ (np.asarray(state.state_vector, dtype=float)[PLACE, 0] - self.centre_m)

    def function(self, state, noise=False, **_):
        x, y, z = self._seen(state)
        return StateVector([-FOCAL_PX * x / z, FOCAL_PX * y / z])

    def jacobian(self, state, **_):
        x, y, z = self._seen(state)
        by_place = FOCAL_PX * np.array([[-1 / z, 0, x / z**2], [0, 1 / z, -y / z**2]]) @ self.camera_from_world
        full = np.zeros((2, 6))
        full[:, PLACE] = by_place
        return full


def scene():
    """Times, projection centres and attitudes of a circle about a moving target, and the pixels with their noise."""
    time, azimuth = 3.0 * np.arange(LOOKS), np.linspace(0, 2.5, LOOKS)
    centre = np.stack([1500 * np.cos(azimuth), 1500 * np.sin(azimuth), np.full(LOOKS, 1200.0)], axis=-1)
    back = centre / np.linalg.norm(centre, axis=1, keepdims=True)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    world_from_camera = Rotation.from_matrix(np.stack([right, np.cross(back, right), back], axis=-1))
    target = np.array([20.0, -30.0, 5.0]) + time[:, None] * [4.0, -3.0, 0.1]
    x, y, z = world_from_camera.inv().apply(target - centre).T
    noise = np.random.default_rng(3).normal(0, SIGMA_PX, (LOOKS, 2))
    return time, centre, world_from_camera, FOCAL_PX * np.stack([-x / z, y / z], axis=-1) + noise


def by_stone_soup(updater):
    """States (looks, 6) and covariances after every look."""
    start = datetime.datetime(2020, 1, 1)
    predictor = ExtendedKalmanPredictor(CombinedLinearGaussianTransitionModel([ConstantVelocity(q) for q in ACCELERATION]))
    mean, sigma = np.zeros(6), np.zeros(6)
    mean[PLACE], sigma[PLACE], sigma[SPEED] = GUESS_M, SIGMA_M, SIGMA_MPS
    belief: Any = GaussianState(StateVector(mean), CovarianceMatrix(np.diag(sigma**2)), timestamp=start)
    registration, states, covariances = CovarianceMatrix(SIGMA_PX**2 * np.eye(2)), [], []
    for time, centre, world_from_camera, pixel in zip(*scene(), strict=True):
        when = start + datetime.timedelta(seconds=float(time))
        camera = Camera(6, (0, 2, 4), registration, centre_m=centre, camera_from_world=world_from_camera.inv().as_matrix())
        seen = Detection(StateVector(pixel), timestamp=when, measurement_model=camera)
        belief = updater.update(SingleHypothesis(predictor.predict(belief, timestamp=when), seen))
        states.append(np.asarray(belief.state_vector, dtype=float)[:, 0])
        covariances.append(np.asarray(belief.covar, dtype=float))
    return np.array(states), np.array(covariances)


@functools.cache
def both(method):
    """Ours, and Stone Soup's states and covariances."""
    time, centre, world_from_camera, pixel = scene()
    poses = wj.PosePerImage(centre, world_from_camera.as_quat())
    ours = wj.locate(
        wj.Sensor({"photo": poses}, wj.FrameCamera(FOCAL_PX, (0.0, 0.0))),
        wj.Looks(wj.Shot(time_s=time, image=np.arange(LOOKS)), pixel, np.full(2, SIGMA_PX)),
        guess=wj.Guess.around(GUESS_M, SIGMA_M),
        motion=wj.ConstantVelocity(SIGMA_MPS, ACCELERATION),
        surface=wj.Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])),  # east, north and up are x, y and z
        method=method,
    )
    peer = ExtendedKalmanUpdater(None) if method == "extended" else IteratedKalmanUpdater(None, tolerance=1e-9)
    return ours, *by_stone_soup(peer)


def figures() -> list[Figure]:
    """What is claimed."""
    found = []
    for method in ("extended", "iterated"):
        ours, state, covariance = both(method)
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        place = np.abs((np.asarray(ours.looks.point_m) - state[:, PLACE]) / sigma[:, PLACE]).max()
        speed = np.abs((np.asarray(ours.velocity_enu_mps) - state[-1, SPEED]) / sigma[-1, SPEED]).max()
        spread = in_sigmas(np.asarray(ours.looks.covariance_enu_m2), covariance[:, PLACE][:, :, PLACE])
        rounding = "rounding: one algorithm" if method == "extended" else "it iterates until 1e-9 m"
        found += [
            Figure(f"{method} filter, positions after every look", place, "sigma", 1e-9, rounding),
            Figure(f"{method} filter, covariances after every look", spread, "sigma^2", 1e-9, rounding),
            Figure(f"{method} filter, velocity at the end", speed, "sigma", 1e-9, rounding),
        ]
    return found


def test_figures():
    assert_inside(figures())
