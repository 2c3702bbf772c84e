"""An answer as the joint prior of an adjustment, and one that calibrate hands on: dense least squares by scipy.

Frame images behind a mount; motions, the camera's and the mount's numbers and every point stand in one vector.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import whiskjax as wj

IMAGES, POINTS, CONTROL = 4, 12, 3
PLACE_M = np.array([[0.0, 0.0, 900.0], [250.0, 20.0, 880.0], [0.0, 220.0, 915.0], [240.0, 230.0, 890.0]])
TURN_RAD, SHIFT_M, MARK_PX, POINT_SIGMA_M = 2e-4, 0.3, 0.4, 0.03
UNKNOWNS = (
    *(wj.Unknown(f"turn {x}", f"mount.angles_rad[{i}]", scale=1e-3) for i, x in enumerate("xyz")),
    wj.Unknown("focal", "camera.focal_px", scale=1.0),
    wj.Unknown("centre", "camera.principal_point_px[0]", scale=1.0),
)
SIZE = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])
TRUTH = np.array([1.5e-3, -1.0e-3, 0.7e-3, 3001.2, 2000.8])
# Correlated, and the mean is off the truth by about a sigma.
ROOT = 0.8 * np.array(
    [[1.0, 0, 0, 0, 0], [0.5, 0.9, 0, 0, 0], [-0.4, 0.3, 0.6, 0, 0], [0.2, -0.7, 0.1, 0.9, 0], [0.9, 0.1, 0.2, -0.3, 0.4]]
)
ROOT *= SIZE[:, None]
MEAN = TRUTH + ROOT @ np.array([0.8, -1.1, 0.4, 0.9, -0.6])


class Scene(NamedTuple):
    """What was recorded and measured."""

    sensor: wj.Sensor
    recorded: Rotation
    place_m: np.ndarray
    block: wj.Block


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(11)
    point = np.column_stack([rng.uniform(-80, 330, POINTS), rng.uniform(-80, 310, POINTS), rng.uniform(0, 120, POINTS)])
    true = Rotation.from_euler("ZYX", rng.normal(0, 2, (IMAGES, 3)), degrees=True)
    image, seen = np.divmod(np.arange(IMAGES * POINTS), POINTS)
    recorded = true * Rotation.from_rotvec(rng.normal(0, TURN_RAD, (IMAGES, 3)))
    place = PLACE_M + rng.normal(0, SHIFT_M, (IMAGES, 3))
    exact = pinhole(true.as_matrix()[image], PLACE_M[image], point[seen], TRUTH)
    known = np.where(np.arange(POINTS)[:, None] < CONTROL, point + rng.normal(0, POINT_SIGMA_M, (POINTS, 3)), np.nan)
    block = wj.Block(
        wj.Shot(image=image),
        np.asarray(exact) + rng.normal(0, MARK_PX, exact.shape),
        np.full(exact.shape, MARK_PX),
        seen,
        known,
        np.broadcast_to(np.eye(3) * POINT_SIGMA_M**2, (POINTS, 3, 3)),
        np.array(["control"] * CONTROL + ["tie"] * (POINTS - CONTROL)),
    )
    photo = wj.PosePerImage(place, recorded.as_quat())
    camera = wj.FrameCamera(3000.0, (2000.0, 1500.0))
    return Scene(wj.Sensor({"photo": photo, "mount": wj.Mount(angles_rad=np.zeros(3))}, camera), recorded, place, block)


def turned(v):
    """exp([v]x) by its series, (..., 3) -> (..., 3, 3); v is small."""
    zero = jnp.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    k = jnp.stack([jnp.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))], -2)
    out = term = jnp.broadcast_to(jnp.eye(3), k.shape)
    for n in range(1, 9):
        term = term @ k / n
        out = out + term
    return out


def pinhole(world_from_frame, place_m, point_m, number):
    """Pixels of points, x to the right and y down, seen along -z behind a mount turned by Rx Ry Rz of its three angles."""
    (ax, ay, az), focal, centre = number[:3], number[3], number[4]
    (cx, cy, cz), (sx, sy, sz) = (jnp.cos(jnp.stack([ax, ay, az])), jnp.sin(jnp.stack([ax, ay, az])))
    rx = jnp.array([[1.0, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = jnp.array([[cy, 0, sy], [0, 1.0, 0], [-sy, 0, cy]])
    rz = jnp.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1.0]])
    q = jnp.einsum("nji,nj->ni", world_from_frame, point_m - place_m) @ (rx @ ry @ rz)
    return jnp.stack([centre - focal * q[:, 0] / q[:, 2], 1500.0 + focal * q[:, 1] / q[:, 2]], -1)


def dense(scene, mean, root):
    """The unknowns, the points and their covariances by scipy on the whole vector; the prior is root^-1 (number - mean)."""
    block, image = scene.block, np.asarray(scene.block.key("image"))
    attitude, m = scene.recorded.as_matrix(), 6 * IMAGES
    start = np.concatenate([np.zeros(m), np.zeros(len(mean)), np.zeros(3 * POINTS)])
    rough = np.nan_to_num(block.position_m, nan=50.0)
    met = wj.intersect(scene.sensor, block.shot, block.pixel_px, block.point, block.sigma_px).point_m
    rough[CONTROL:] = np.asarray(met)[CONTROL:]

    def residuals(z):
        motion, number, point = z[:m].reshape(IMAGES, 6), mean + SIZE * z[m : m + 5], rough + z[m + 5 :].reshape(-1, 3)
        turn, shift = TURN_RAD * motion[:, :3], SHIFT_M * motion[:, 3:]
        place = scene.place_m + jnp.einsum("nij,nj->ni", attitude, shift)
        pixel = pinhole((attitude @ turned(turn))[image], place[image], point[block.point], number)
        seen = (block.pixel_px - pixel) / MARK_PX
        control = (point[:CONTROL] - block.position_m[:CONTROL]) / POINT_SIGMA_M
        prior = jnp.linalg.solve(root, number - mean)
        return jnp.concatenate([seen.ravel(), motion.ravel(), prior, control.ravel()])

    jacobian = jax.jit(jax.jacfwd(residuals))
    best = least_squares(jax.jit(residuals), start, jacobian, xtol=1e-15, ftol=1e-15, gtol=1e-12, x_scale="jac")
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    sigma = np.sqrt(np.diag(covariance))
    own = covariance[m : m + 5, m : m + 5] * np.outer(SIZE, SIZE)
    point, of_point = (part[m + 5 :].reshape(-1, 3) for part in (best.x, sigma))
    return mean + SIZE * best.x[m : m + 5], own, rough + point, of_point, 2 * best.cost


def compare(found, expected):
    value, covariance, point, sigma_m, cost = expected
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((found.value - value) / sigma, 0, atol=1e-5)
    np.testing.assert_allclose(found.estimate.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-5)
    np.testing.assert_allclose((found.point_m - point) / sigma_m, 0, atol=1e-5)
    assert found.cost == pytest.approx(cost, rel=1e-8)


ERRORS = (wj.FrameErrors("photo", (TURN_RAD,) * 3, (SHIFT_M,) * 3),)


def knowledge(covariance):
    names, places = tuple(x.name for x in UNKNOWNS), tuple(x.places for x in UNKNOWNS)
    return wj.Estimate(MEAN, covariance, np.ones(5), np.zeros(()), 0, wj.RESULTS.successful, names, places)


def test_a_joint_prior_is_scipys(scene):
    covariance = ROOT @ ROOT.T
    found = wj.adjust(scene.sensor, scene.block, knowledge(covariance), errors=ERRORS)
    compare(found, dense(scene, MEAN, ROOT))
    # Taken one by one, the same priors say something else.
    alone = wj.adjust(scene.sensor, scene.block, knowledge(np.diag(np.diag(covariance))), errors=ERRORS)
    assert np.abs((alone.value - found.value) / found.estimate.sigma).max() > 0.1


def test_what_calibrate_found_is_handed_on(scene):
    """Calibrated over a test field from one place, then the prior of the block: the answer is scipy's with that covariance."""
    rng = np.random.default_rng(12)
    field = np.column_stack([rng.uniform(-200, 200, (20, 2)), rng.uniform(0, 150, 20)])
    station = np.array([[10.0, -20.0, 600.0]])
    still = wj.PosePerImage(station, Rotation.identity(1).as_quat())
    shot = wj.Shot(image=np.zeros(20, dtype=int))
    laboratory = wj.Sensor({"photo": still, "mount": scene.sensor["mount"]}, scene.sensor.camera)
    exact = np.asarray(pinhole(np.broadcast_to(np.eye(3), (20, 3, 3)), station, field, TRUTH))
    seen = wj.Observations(shot, field, exact + rng.normal(0, 0.5, exact.shape), np.full((20, 2), 0.5), np.ones(20, dtype=bool))
    calibrated = wj.calibrate(laboratory, seen, UNKNOWNS)
    root = np.linalg.cholesky(np.asarray(calibrated.estimate.covariance))
    found = wj.adjust(scene.sensor, scene.block, calibrated, errors=ERRORS)
    compare(found, dense(scene, np.asarray(calibrated.value), root))
    assert (np.asarray(found.estimate.sigma) < np.asarray(calibrated.estimate.sigma)).all()
    # Number by number, the same answer says less.
    alone = wj.adjust(scene.sensor, scene.block, calibrated.estimate.unknowns, errors=ERRORS)
    compare(alone, dense(scene, np.asarray(calibrated.value), np.diag(calibrated.estimate.sigma)))
    # What calibrate knew hangs together: turns about x and y shift the image like its centre does.
    correlation = np.asarray(calibrated.estimate.correlation)
    assert np.abs(correlation - np.eye(5)).max() > 0.9
