"""Real blocks of frame images: sxb_frame against a dense bundle adjustment of numpy, ign_frame from perturbed poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.real import convert_sxb_frame as sxb
from tests.real import reach_blocks


@pytest.fixture(scope="module")
def adjusted_sxb(source_of, tmp_path_factory):
    return reach_blocks.adjust_sxb(source_of(reach_blocks.SXB), tmp_path_factory.mktemp("sxb") / "flight")


def dense(block, start, images):
    """Twice the cost, and poses, of one dense Gauss-Newton over all poses and points; residuals by the collinearity equations."""
    control = np.flatnonzero(block.role == "control")
    points, image = len(block.role), np.asarray(block.key("image"))
    size = np.concatenate([np.tile([10.0, 10, 10, 0.5, 0.5, 0.5], images), np.full(3 * points, 10.0)])
    # Ties begin on the ground plane, which is near 139 m.
    ground = np.where((block.role == "control")[:, None], block.position_m, [1_000_000.0, 112_400.0, 139.0])
    begin = np.concatenate([start.ravel(), ground.ravel()])
    sigma = np.sqrt(np.diagonal(block.covariance_m2[control], axis1=1, axis2=2))

    def residuals(u):
        v = begin + size * u
        pose, point = v[: 6 * images].reshape(-1, 6), v[6 * images :].reshape(-1, 3)
        rotation = Rotation.from_euler("XYZ", pose[:, 3:], degrees=True).as_matrix()
        x, y, z = np.einsum("nij,ni->jn", rotation[image], point[block.point] - pose[image, :3])
        pixel = np.stack([sxb.PRINCIPAL_POINT_PX[0] - sxb.FOCAL_PX * x / z, sxb.PRINCIPAL_POINT_PX[1] + sxb.FOCAL_PX * y / z], -1)
        # Pixels of the flight count from the centre of the first, those of the set from its corner.
        rows = (block.pixel_px - (pixel - 0.5)) / block.sigma_px
        return rows.ravel(), ((point[control] - block.position_m[control]) / sigma).ravel()

    def jacobian(u):
        """Central differences; a ray follows its own pose and point alone, so that all points move at once, and all poses."""
        rows, n = np.zeros((2 * len(block) + 3 * len(control), len(u))), len(block)
        at = np.arange(n)
        for k in range(9):
            columns = 6 * image + k if k < 6 else 6 * images + 3 * block.point + k - 6
            step = np.zeros(len(u))
            step[np.unique(columns)] = 1e-4
            change = (residuals(u + step)[0] - residuals(u - step)[0]).reshape(n, 2) / 2e-4
            rows[2 * at, columns], rows[2 * at + 1, columns] = change[:, 0], change[:, 1]
        own = 6 * images + (3 * control[:, None] + np.arange(3)).ravel()
        rows[2 * n + np.arange(3 * len(control)), own] = (10.0 / sigma).ravel()
        return rows

    u = np.zeros(len(begin))
    for _ in range(40):
        rows = jacobian(u)
        step = np.linalg.solve(rows.T @ rows, -rows.T @ np.concatenate(residuals(u)))
        u += step
        if np.abs(step).max() < 1e-7:
            break
    return (np.concatenate(residuals(u)) ** 2).sum(), (begin + size * u)[: 6 * images].reshape(-1, 6)


def test_sxb_is_the_dense_bundle(adjusted_sxb, source_of):
    """The same cost and the same poses from the same coarse starts."""
    photos = sxb.Rows(source_of(reach_blocks.SXB) / "eo_start.csv")
    start = photos.numbers("xc", "yc", "zc", "omega_deg", "phi_deg", "kappa_deg")
    cost, expected = dense(adjusted_sxb.block, start, len(photos))
    assert adjusted_sxb.cost == pytest.approx(cost, rel=1e-9)
    pose = adjusted_sxb.sensor["photo"].pose(wj.Shot(image=np.arange(len(photos))))
    np.testing.assert_allclose(pose.origin_m, expected[:, :3], rtol=0, atol=1e-4)
    angles = Rotation.from_matrix(np.asarray(pose.matrix)).as_euler("XYZ", degrees=True)
    np.testing.assert_allclose(angles, expected[:, 3:], rtol=0, atol=1e-6)


def test_sxb_statistics(adjusted_sxb):
    """1180 rays, 11 control points and 365 ties less 5 poses and all points: 1235 to spare, as DBAT counts 1261 of its own."""
    found = adjusted_sxb
    assert found.freedom == 2 * 1180 + 3 * 11 - 6 * 5 - 3 * (11 + 365)
    assert np.sqrt(found.variance_factor) == pytest.approx(1.1407, abs=1e-4)
    assert found.result == wj.RESULTS.successful
    for axis in found.statistics("control"):
        assert axis.count == 11 and axis.rmse < 0.03 and abs(axis.mean) < 1e-6
    assert [s.count for s in found.statistics("check")] == [0, 0, 0]


def test_sxb_is_near_dbat(adjusted_sxb):
    """DBAT has five more surveyed points; what it prints lies within two of its sigmas."""
    assert np.abs(reach_blocks.from_dbat(adjusted_sxb)).max() < 2


@pytest.mark.slow
@pytest.mark.parametrize("known", ["laboratory", "control"])
def test_ign_from_perturbed_poses(source_of, tmp_path, known):
    found = reach_blocks.adjust_ign(source_of(reach_blocks.IGN), tmp_path / "flight", known)
    assert found.result == wj.RESULTS.successful
    assert len(found.point_m) == 1804 and np.isfinite(found.point_m).all()
    ties = found.block.role[found.block.point] == "tie"
    assert (np.sqrt((found.residual_px[ties] ** 2).mean(axis=0)) < (0.147, 0.174)).all()
    truth = (0.0, 0.0, 0.0, reach_blocks.ign.FOCAL_PX, *reach_blocks.ign.PRINCIPAL_POINT_PX)
    assert reach_blocks.largest_sigma(found, truth) < 3.5
    # The surveyed point, over what is claimed of it.
    role = "check" if known == "laboratory" else "control"
    (error,), (covariance,) = found.errors_m(role), found.covariance_m2[found.block.role == role]
    assert error @ np.linalg.solve(covariance + reach_blocks.GCP_SIGMA_M**2 * np.eye(3), error) < 14.2  # chi-squared, 99.7 %
