"""The filter of location.cpp by numpy as it is mostly written: arrays (runs, 3, 3), products of matrices, one look at a time."""

from collections.abc import Callable

import numpy as np

from .location import FOCAL_PX, Located, Recorded, Sigmas, Start
from .numpy_location import platform

_AXES = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}


def _turn(axis: str, angle_rad: np.ndarray) -> np.ndarray:
    """Rotation matrices, (runs, 3, 3)."""
    i, j = _AXES[axis]
    matrix = np.zeros((*angle_rad.shape, 3, 3))
    matrix[..., 3 - i - j, 3 - i - j] = 1
    matrix[..., i, i] = matrix[..., j, j] = np.cos(angle_rad)
    matrix[..., j, i] = np.sin(angle_rad)
    matrix[..., i, j] = -matrix[..., j, i]
    return matrix


def _transposed(matrix: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrix, -1, -2)


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (matrix @ vector[..., None])[..., 0]


def prepared(recorded: Recorded, start: Start, sigmas: Sigmas, full: bool) -> Callable[[], Located]:
    """The filter as a call."""
    numbers = np.ascontiguousarray(np.swapaxes(recorded.numbers(), 1, 2))  # (10, looks, runs)
    a, g = sigmas.attitude_rad, sigmas.gimbal_rad
    # Shifts along the body's axes, turns about them (x is the gimbal's roll axis as well), and the turn about the gimbal's pitch.
    sigma = np.array([*sigmas.position_m, np.hypot(a[0], g[0]), *a[1:], g[1]])

    def run() -> Located:
        runs = numbers.shape[-1]
        x, P = np.zeros((runs, 3)), np.broadcast_to(start.covariance_m2, (runs, 3, 3))
        registration = sigmas.pixel_px**2 * np.eye(2)
        for lat, lon, height, roll, pitch, heading, beta, alpha, *pixel in np.swapaxes(numbers, 0, 1):
            position = np.stack(platform((np.sin(lat), np.cos(lat)), (np.sin(lon), np.cos(lon)), height), -1)
            ecef_from_ned = _turn("z", lon) @ _turn("y", -lat - np.pi / 2)
            ecef_from_body = ecef_from_ned @ _turn("z", heading) @ _turn("y", pitch) @ _turn("x", roll)
            body_from_camera = _turn("x", beta) @ _turn("y", alpha)
            camera_from_ecef = _transposed(ecef_from_body @ body_from_camera)
            u = _times(camera_from_ecef, x - (position - start.guess_ecef_m))
            by_u = np.zeros((runs, 2, 3))
            by_u[:, 0, 0] = by_u[:, 1, 1] = FOCAL_PX / u[:, 2]
            by_u[:, :, 2] = -FOCAL_PX * u[:, :2] / u[:, 2:] ** 2
            H, R = by_u @ camera_from_ecef, registration
            if full:
                axes = np.concatenate([body_from_camera, np.broadcast_to([[0.0, 1.0, 0.0]], (runs, 1, 3))], 1)  # in the camera's
                turns = np.cross(axes, u[:, None])
                errors = by_u @ _transposed(np.concatenate([axes[:, :3], turns], 1)) * sigma
                R = R + errors @ _transposed(errors)
            crossed = P @ _transposed(H)
            K = _transposed(np.linalg.solve(H @ crossed + R, _transposed(crossed)))
            x = x + _times(K, np.stack(pixel, -1) - FOCAL_PX * u[:, :2] / u[:, 2:])
            I_KH = np.eye(3) - K @ H
            P = I_KH @ P @ _transposed(I_KH) + K @ R @ _transposed(K)
        return x, P

    return run
