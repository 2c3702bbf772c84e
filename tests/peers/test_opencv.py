"""OpenCV (5.0, Apache-2.0): `projectPoints` and `calibrateCameraExtended`, run here.

Claim: pixels of a camera with k1, k2, p1, p2, k3 (OpenCV's order; ours is k1, k2, k3, p1, p2) and their derivatives are those of
`projectPoints` within 1e-9 px and 1e-9 of themselves, the rays of those pixels come back to them within 1e-9 px; `wj.calibrate`
has the optimum of `calibrateCamera` within 1e-6 sigma, and after scaling by the variance factor, as OpenCV does, its standard
deviations of f, c and the distortion within 1e-5.
"""

import functools

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.peers.figures import Figure, assert_inside

cv2 = pytest.importorskip("cv2")

PEER = "OpenCV"
FOCAL_PX, CENTRE_PX = 1200.0, np.array([640.0, 480.0])
DISTORTION = np.array([-0.2, 0.08, 1e-3, -7e-4, 0.02])  # k1, k2, p1, p2, k3
OURS = [0, 1, 4, 2, 3]  # of OpenCV's order
PLACES = ("focal_px", "principal_point_px[0]", "principal_point_px[1]", *(f"distortion[{i}]" for i in (0, 1, 3, 4, 2)))
VIEWS = 3


def matrix(focal_px, centre_px):
    """OpenCV's camera matrix."""
    return np.array([[focal_px, 0, centre_px[0]], [0, focal_px, centre_px[1]], [0, 0, 1.0]])


def sensor(turns, shifts_m):
    """Our camera at OpenCV's poses camera from world (rotation vectors, translations)."""
    back = Rotation.from_rotvec(turns).inv()
    links = {"photo": wj.PosePerImage(-back.apply(shifts_m), back.as_quat()), "lens": wj.Axes("x -y -z")}
    return wj.Sensor(links, wj.FrameCamera(FOCAL_PX, CENTRE_PX, DISTORTION[OURS]))


def unknowns(sigma_or_scale=(1.0, 1.0, 1.0, 0.01, 0.01, 1e-3, 1e-3, 0.01)):
    """f, c and the distortion, in OpenCV's order."""
    names = ("f", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    return [wj.Unknown(n, f"camera.{p}", scale=s) for n, p, s in zip(names, PLACES, sigma_or_scale, strict=True)]


@functools.cache
def imaging():
    """Largest differences of pixels, of their derivatives by each number over the largest by it, and of pixels come back."""
    rng = np.random.default_rng(8)
    points = rng.uniform(-0.5, 0.5, (400, 3))
    turn, shift = np.array([0.3, -0.2, 0.5]), np.array([0.05, -0.02, 1.6])
    lens = matrix(FOCAL_PX, CENTRE_PX), DISTORTION
    pixel, derivative = cv2.projectPoints(points, turn, shift, *lens)
    pixel = pixel[:, 0]
    camera, shot = sensor(turn[None], shift[None]), wj.Shot(image=0)
    value = np.r_[FOCAL_PX, CENTRE_PX, DISTORTION]

    @jax.jit
    def ours(value):
        at = wj.assign(camera, unknowns(), value)
        return wj.project(at, shot, points).pixel_px

    # Columns of OpenCV: turn, shift, fx, fy, cx, cy, k1, k2, p1, p2, k3; ours has one f.
    expected = np.c_[derivative[:, 6] + derivative[:, 7], derivative[:, 8:15]].reshape(400, 2, 8)
    by_lens = np.abs(np.asarray(jax.jacfwd(ours)(value)) - expected) / np.abs(expected).max(axis=(0, 1))
    sight = wj.ray(camera, shot, pixel)
    ahead = np.asarray(sight.origin_m) + 2 * np.asarray(sight.direction)
    again = cv2.projectPoints(ahead, turn, shift, *lens)[0][:, 0]
    return np.abs(np.asarray(ours(value)) - pixel).max(), by_lens.max(), np.abs(again - pixel).max()


@functools.cache
def calibrations():
    """Ours, its sigmas times the root of its variance factor, and OpenCV's optimum and standard deviations, (8,) each.

    A target of 40 marks in two planes seen three times, with 0.2 px of noise; both are given what float32 holds, which is what
    OpenCV takes, and start at the truth.
    """
    rng = np.random.default_rng(5)
    target = np.stack(np.meshgrid(np.arange(5), np.arange(4), np.arange(2), indexing="ij"), axis=-1).reshape(-1, 3)
    target = ((target - target.mean(axis=0)) * [0.1, 0.1, 0.08]).astype(np.float32)
    turns, shifts = rng.normal(0, 0.35, (VIEWS, 3)), np.array([0, 0, 1.0]) + rng.normal(0, 0.04, (VIEWS, 3))
    lens = matrix(FOCAL_PX, CENTRE_PX), DISTORTION
    seen = [cv2.projectPoints(target, t, s, *lens)[0][:, 0] for t, s in zip(turns, shifts, strict=True)]
    seen = [(s + rng.normal(0, 0.2, s.shape)).astype(np.float32) for s in seen]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-15)
    _, found, distortion, _, _, deviation, *_ = cv2.calibrateCameraExtended(
        [target] * VIEWS, seen, (1280, 960), lens[0].copy(), lens[1].copy(), flags=flags, criteria=stop
    )
    marks = VIEWS * len(target)
    observations = wj.Observations(
        shot=wj.Shot(image=np.repeat(np.arange(VIEWS), len(target))),
        point_m=np.tile(target.astype(float), (VIEWS, 1)),
        pixel_px=np.concatenate(seen).astype(float),
        sigma_px=np.full((marks, 2), 0.2),
        is_control=np.ones(marks, dtype=bool),
    )
    poses = [
        wj.Unknown(f"{field} {i} {axis}", f"photo.{field}[{i},{axis}]", scale=1e-3)
        for i in range(VIEWS)
        for field in ("turn_rad", "shift_m")
        for axis in range(3)
    ]
    ours = wj.calibrate(sensor(turns, shifts), observations, [*unknowns(), *poses])
    peer = np.r_[found[0, 0], found[:2, 2], distortion.ravel()[:5]]
    scaled = ours.posterior.sigma[:8] * np.sqrt(ours.fit.variance_factor)
    # fx follows fy by the fixed ratio and has no deviation of its own.
    return ours, scaled, peer, deviation.ravel()[1:9]


def figures() -> list[Figure]:
    """What is claimed."""
    pixels, derivatives, back = imaging()
    ours, scaled, peer, deviation = calibrations()
    rounding, stops = "rounding of 1000 px", "where OpenCV's iteration stops"
    return [
        Figure("projectPoints, pixels", pixels, "px", 1e-9, rounding),
        Figure("projectPoints, derivatives by f, c, k1, k2, p1, p2, k3", derivatives, "1", 1e-9, "rounding"),
        Figure("rays of its pixels, projected by it again", back, "px", 1e-9, rounding),
        Figure("calibrateCamera, f, c, distortion", np.abs((ours.value[:8] - peer) / scaled).max(), "sigma", 1e-6, stops),
        Figure("calibrateCamera, their standard deviations", np.abs(scaled / deviation - 1).max(), "1", 1e-5, stops),
    ]


def test_figures():
    assert_inside(figures())
