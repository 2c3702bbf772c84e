"""Exterior orientation and its covariance, beside the dense normal matrix of a textbook: every motion and point in one vector."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.estimate.block.frames import POS, frames

LEVER_M = np.array([0.3, -0.2, 1.5])  # of the camera, in the body
FLAT = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture(scope="module")
def found():
    sensor, block, *_ = frames()
    mounted = sensor.after("photo", "mount", wj.Mount(LEVER_M))
    lever = [wj.Unknown("lever z", "mount.lever_arm_m[2]", LEVER_M[2], 0.05)]
    return wj.adjust(mounted, block, lever, errors=POS)


@pytest.fixture(scope="module")
def orientation(found):
    return found.exterior_orientation(surface=FLAT)


def dense(found):
    """The covariance of (turn, shift) of each image in the world's axes, the lever and the points, by finite differences."""
    block, photo = found.block, found.sensor["photo"]
    given = Rotation.from_quat(np.stack([np.asarray(c) for c in photo.quaternion], -1))
    place = np.stack([np.asarray(c) for c in photo.position_m], -1)
    body, shift = given * Rotation.from_rotvec(np.array(photo.turn_rad)), place + given.apply(np.array(photo.shift_m))
    images, points = len(place), len(block.role)
    lever = LEVER_M[:2].tolist() + [float(found.value[0])]
    image, control = np.asarray(block.key("image")), block.role == "control"
    size = 6 * images + 1 + 3 * points

    def residuals(z):
        """Small motions in the world's axes at the end."""
        turn, moved = z[: 3 * images].reshape(-1, 3), z[3 * images : 6 * images].reshape(-1, 3)
        attitude, where = Rotation.from_rotvec(turn) * body, shift + moved
        point = found.point_m + z[6 * images + 1 :].reshape(-1, 3)
        centre = where + attitude.apply([*lever[:2], lever[2] + z[6 * images]])
        q = attitude[image].inv().apply(point[block.point] - centre[image])
        pixel = np.array([2000.0, 1500.0]) - 3000.0 * q[:, :2] / q[:, 2:] * np.array([1.0, -1.0])
        recorded = (given.inv() * attitude).as_rotvec() / 1e-3, given.inv().apply(where - place) / 1.0
        known = (block.position_m - point)[control] / 0.02
        prior = (lever[2] + z[6 * images] - LEVER_M[2]) / 0.05
        parts = (block.pixel_px - pixel) / block.sigma_px, *recorded, known, prior
        return np.concatenate([np.ravel(p) for p in parts])

    step = np.concatenate([np.full(3 * images, 1e-6), np.full(size - 3 * images, 1e-3)])
    rows = np.stack([(residuals(h * e) - residuals(-h * e)) / (2 * h) for h, e in zip(step, np.eye(size), strict=True)], -1)
    return np.linalg.inv(rows.T @ rows), body, shift, lever


def test_positions_attitudes_and_covariances(found, orientation):
    covariance, body, shift, lever = dense(found)
    n, m = len(shift), 6 * len(shift)
    centre = body.apply(lever)
    np.testing.assert_allclose(orientation.record.position_m, shift, rtol=0, atol=1e-9)
    np.testing.assert_allclose(orientation.camera.position_m, shift + centre, rtol=0, atol=1e-9)
    np.testing.assert_allclose(orientation.record.world_from_frame, body.as_matrix(), rtol=0, atol=1e-12)
    for k in range(n):
        index = np.concatenate([3 * k + np.arange(3), 3 * n + 3 * k + np.arange(3), [m]])
        own = covariance[np.ix_(index, index)]
        x, y, z = centre[k]
        turned = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # of the arm, by a turn
        along = body[k].apply([0.0, 0.0, 1.0])[:, None]
        at_camera = np.block([[np.eye(3), np.zeros((3, 4))], [turned, np.eye(3), along]])
        for one, rows in ((orientation.record, np.eye(6, 7)), (orientation.camera, at_camera)):
            expected = rows @ own @ rows.T
            sigma = np.sqrt(np.diag(expected))
            np.testing.assert_allclose((one.covariance[k] - expected) / np.outer(sigma, sigma), 0, rtol=0, atol=1e-5)
            np.testing.assert_allclose(one.sigma[k], sigma, rtol=1e-5)


def test_what_is_up_has_to_be_known(found):
    with pytest.raises(wj.WhiskjaxError, match="the world is a local one"):
        found.exterior_orientation()


def test_chosen_exposures(found, orientation):
    some = found.exterior_orientation(wj.Shot(image=np.array([4, 1])), surface=FLAT)
    np.testing.assert_allclose(some.camera.covariance, np.asarray(orientation.camera.covariance)[[4, 1]], rtol=1e-12, atol=0)
