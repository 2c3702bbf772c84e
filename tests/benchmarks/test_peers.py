"""The C++ peers against plain numpy and scipy: a benchmark against a wrong program would measure nothing."""

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation, Slerp

from benchmarks import peers
from benchmarks.peers import build
from benchmarks.peers.scipy_calibration import ScipyCalibration

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
FOCAL_PX = 10_750.0
FORWARD_LEFT_UP = np.diag([1.0, -1.0, -1.0])
# u_gps, R_pos left, R_pos right, u_sen, R_sen: sizes as in the paper's Table 4, prior sigmas of the haian scenario.
TRUTH = np.r_[0.05, -0.12, 0.6, np.radians([2.7, 0.01, 0.3, 2.72, 0.015, 0.33]), -0.06, 0.1, 1.1, np.radians([0.02, 0.45, -0.08])]
SIGMA = np.r_[0.2, 0.2, 1, np.radians([5, 0.02, 0.5, 5, 0.02, 0.5]), 0.2, 0.2, 2, np.radians([0.03, 5, 0.1])]


def geodetic_to_ecef(lat, lon, height):
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    across = (n + height) * np.cos(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), (n * (1 - E2) + height) * np.sin(lat)], -1)


def geodetic_height(point):
    """By iterating the latitude to convergence: slow, and nothing like the peers' closed form."""
    x, y, z = np.moveaxis(point, -1, 0)
    p = np.hypot(x, y)
    lat = np.arctan2(z, p * (1 - E2))
    for _ in range(50):
        n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
        height = p * np.cos(lat) + z * np.sin(lat) - A * A / n
        lat = np.arctan2(z, p * (1 - E2 * n / (n + height)))
    return height


def opk(angles_rad):
    return Rotation.from_euler("XYZ", angles_rad)


def about(axis, angle_rad):
    return Rotation.from_rotvec(np.multiply.outer(angle_rad, np.eye(3)["xyz".index(axis)]))


def flight(seed, swing=1, segments=1, altitude_m=3010.0):
    """Swings of 3.2 s, 100 degrees each, with POS at 200 Hz and encoders at 250 Hz; 10 s without data in between."""
    rng = np.random.default_rng(seed)
    starts = 900.0 + 13.2 * np.arange(segments)
    local_s = np.arange(641) / 200
    time_s = (starts[:, None] + local_s).ravel()
    t = time_s - 900.0
    heading, lat, lon = np.radians([30.0, 32.5, 120.5])
    east, north = (
        np.array([-np.sin(lon), np.cos(lon), 0]),
        np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]),
    )
    along = 70.0 * (np.cos(heading) * north + np.sin(heading) * east)
    position_m = geodetic_to_ecef(lat, lon, altitude_m) + t[:, None] * along + rng.normal(0, 0.01, (len(t), 3))
    motion = np.radians(0.2) * np.stack([np.sin(2 * np.pi * t / p) for p in (0.9, 1.7, 4.1)], -1)
    jitter = np.radians(0.002) * rng.normal(size=(len(t), 3))
    roll, pitch, yaw = (motion + jitter + [0, np.radians(0.5), heading]).T
    down = np.cross(north, east)
    ned = Rotation.from_matrix(np.stack([north, east, down], -1))
    quaternion = (ned * Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], -1))).as_quat()
    quaternion[rng.random(len(t)) < 0.3] *= -1  # the same attitudes: a quaternion's sign means nothing
    encoder_local_s = np.arange(801) / 250
    encoder_s = (starts[:, None] + encoder_local_s).ravel()
    scan = np.tile(swing * np.radians(-50 + 100 * encoder_local_s / 3.0), segments)
    ring = np.arctan(70.0 * (np.tile(encoder_local_s, segments) - 1.5) * np.cos(scan) / 3000)
    return peers.Flight(
        time_s, position_m, quaternion, encoder_s, scan, encoder_s, ring,
        TRUTH[:3], TRUTH[3:6] if swing > 0 else TRUTH[6:9], TRUTH[9:12], TRUTH[12:], FOCAL_PX, swing, 0.1,
    )  # fmt: skip


class Oracle:
    """The same chain from scipy's rotations and Slerp, one pose at a time or many."""

    def __init__(self, flight):
        self.flight = flight
        self.slerp = Slerp(flight.pos_time_s, Rotation.from_quat(flight.quaternion_xyzw))

    def pose(self, t):
        f = self.flight
        body = self.slerp(t)
        antenna = np.stack([np.interp(t, f.pos_time_s, f.position_m[:, k]) for k in range(3)], -1)
        scan = about("x", np.interp(t, f.scan_time_s, f.scan_rad))
        ring = about("y", np.interp(t, f.pitch_time_s, f.pitch_rad))
        platform = body * Rotation.from_matrix(FORWARD_LEFT_UP)
        turned = opk(f.angles_pos_rad) * scan * ring
        rotation = platform * turned * opk(f.angles_sen_rad)
        return rotation, antenna + platform.apply(f.u_gps_m + turned.apply(f.u_sen_m))

    def ray(self, t, sample_px):
        rotation, origin = self.pose(t)
        look = np.stack([sample_px, 0 * sample_px, np.full_like(sample_px, -self.flight.focal_px)], -1)
        return origin, rotation.apply(look)

    def camera(self, t, point):
        rotation, origin = self.pose(t)
        return rotation.inv().apply(point - origin)


@pytest.mark.parametrize("swing", [1, -1])
@pytest.mark.parametrize(("segments", "sort"), [(1, True), (3, False)])
def test_image_to_ground_lies_on_the_ray_and_the_height_surface(swing, segments, sort):
    f = flight(1, swing, segments)
    rng = np.random.default_rng(2)
    n = 1000
    start_s = f.pos_time_s[0] + 13.2 * rng.integers(0, segments, n)
    time_s = start_s + rng.uniform(0, 3.2, n)
    if sort:
        time_s.sort()
    sample_px = rng.uniform(-1000, 1000, n)
    ground = peers.image_to_ground(f, time_s, sample_px, 250.0)
    np.testing.assert_allclose(geodetic_height(ground), 250.0, rtol=0, atol=5e-9)
    origin, direction = Oracle(f).ray(time_s, sample_px)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    along = np.sum((ground - origin) * direction, -1)
    assert np.all((along > 2700) & (along < 9000))  # the near side of the Earth
    np.testing.assert_allclose(ground, origin + along[:, None] * direction, rtol=0, atol=1e-8)


@pytest.mark.parametrize("height_m", [-100.0, 0.0, 1551.0, 8800.0])
@pytest.mark.parametrize("off_nadir_deg", [0.0, 45.0, 78.0])
def test_height_is_true_far_off_nadir(off_nadir_deg, height_m):
    f = flight(3, altitude_m=10_000.0)
    # The mirror held still at the angle asked for, in place of a swing.
    scan = np.full_like(f.scan_rad, np.radians(off_nadir_deg) - TRUTH[3])
    held = peers.Flight(**{**vars(f), "scan_rad": scan, "pitch_rad": 0 * scan})
    time_s = np.linspace(f.pos_time_s[0], f.pos_time_s[-1], 50)
    ground = peers.image_to_ground(held, time_s, np.zeros(50), height_m)
    np.testing.assert_allclose(geodetic_height(ground), height_m, rtol=0, atol=1e-8)


def test_no_ground_is_nan():
    f = flight(4, segments=2)
    time_s = np.array([f.pos_time_s[0] - 1e-6, f.pos_time_s[640] + 5.0, f.pos_time_s[-1] + 1e-6, f.pos_time_s[10]])
    ground = peers.image_to_ground(f, time_s, np.zeros(4), 10.0)
    np.testing.assert_array_equal(np.isnan(ground).all(-1), [True, True, True, False])
    up = peers.Flight(**{**vars(f), "scan_rad": f.scan_rad + np.pi})
    assert np.isnan(peers.image_to_ground(up, f.pos_time_s[:9].copy(), np.zeros(9), 10.0)).all()


@pytest.mark.parametrize("swing", [1, -1])
def test_ground_to_image_is_the_root_of_the_line_coordinate(swing):
    f = flight(5, swing)
    rng = np.random.default_rng(6)
    oracle, n = Oracle(f), 300
    window_s = f.pos_time_s[0] + 0.02, f.pos_time_s[0] + 3.18
    truth_s = rng.uniform(window_s[0] + 0.02, window_s[1] - 0.02, n)
    point = peers.image_to_ground(f, truth_s, rng.uniform(-1000, 1000, n), 10.0) + rng.normal(0, 1, (n, 3))
    time_s, sample_px = peers.ground_to_image(f, point, window_s)

    def miss_rad(t, p):
        _, y, z = oracle.camera(t, p)
        return np.arctan2(y, -z)

    expected_s = np.array([brentq(miss_rad, *window_s, args=(p,), xtol=1e-14) for p in point])
    error_s = np.abs(time_s - expected_s)
    assert np.quantile(error_s, 0.98) < 2e-12 and error_s.max() < 2e-8  # 1e-8 and 1.2e-4 px at the swing's 6000 px/s
    x, _, z = oracle.camera(expected_s, point).T
    np.testing.assert_allclose(sample_px, -FOCAL_PX * x / z, rtol=0, atol=1e-7)


def test_a_point_outside_the_window_is_nan():
    f = flight(7)
    t = f.pos_time_s[100:101].copy()
    point = peers.image_to_ground(f, t, np.zeros(1), 10.0)
    for window_s in ((t[0] + 0.1, t[0] + 1.0), (t[0] - 10.0, t[0] + 1.0)):
        assert np.isnan(peers.ground_to_image(f, point, window_s)).all()
    assert peers.ground_to_image(f, point, (t[0] - 0.1, t[0] + 0.1))[0] == pytest.approx(t[0], abs=1e-11)


def baked(seed):
    """65 points of each swing, at random times and samples, with pixel noise."""
    rng = np.random.default_rng(seed)
    columns = []
    for swing in (1, -1):
        f = flight(seed, swing)
        oracle = Oracle(f)
        time_s = np.sort(rng.uniform(f.pos_time_s[0], f.pos_time_s[-1], 65))
        point = peers.image_to_ground(f, time_s, rng.uniform(-1000, 1000, 65), 10.0)
        point += rng.normal(0, 1, (65, 3))
        platform = (oracle.slerp(time_s) * Rotation.from_matrix(FORWARD_LEFT_UP)).as_matrix()
        antenna = np.stack([np.interp(time_s, f.pos_time_s, f.position_m[:, k]) for k in range(3)], -1)
        angles = [np.interp(time_s, f.scan_time_s, f.scan_rad), np.interp(time_s, f.pitch_time_s, f.pitch_rad)]
        scan, ring = (np.stack([np.sin(a), np.cos(a)], -1) for a in angles)
        columns.append((platform, antenna, scan, ring, np.full(65, swing < 0, np.int32), point))
    arrays = [np.concatenate(c) for c in zip(*columns, strict=True)]
    sigma_px = rng.uniform(1.0, 3.0, (130, 2))
    pixel = project(TRUTH, *arrays) + sigma_px * rng.normal(size=(130, 2))
    return peers.Baked(*arrays, pixel, sigma_px, FOCAL_PX)


def project(unknowns, platform, antenna, scan, ring, right, point):
    """Equation (9) of the whiskbroom paper, pixels (n, 2)."""
    u_gps, left_pos, right_pos, u_sen, sen = unknowns.reshape(5, 3)
    p = np.einsum("nji,nj->ni", platform, point - antenna) - u_gps
    p = np.where(right[:, None] == 1, opk(right_pos).inv().apply(p), opk(left_pos).inv().apply(p))
    p = about("x", np.arctan2(*scan.T)).inv().apply(p)
    p = about("y", np.arctan2(*ring.T)).inv().apply(p)
    x, y, z = opk(sen).inv().apply(p - u_sen).T
    return np.stack([-FOCAL_PX * x / z, np.where(right == 1, -1, 1) * -FOCAL_PX * y / z], -1)


def whitening(b, mean):
    """Whitened residuals of observations and priors as a function of the whitened unknowns."""
    arrays = (b.ecef_from_platform, b.antenna_m, b.scan_sin_cos, b.pitch_sin_cos, b.right, b.point_m)

    def whitened(u):
        residual = (b.pixel_px - project(mean + SIGMA * u, *arrays)) / b.sigma_px
        return np.r_[residual.ravel(), u]

    return whitened


def test_gauss_newton_reaches_the_minimum_of_scipy_least_squares():
    b = baked(8)
    mean = TRUTH + 0.5 * SIGMA * np.random.default_rng(9).normal(size=15)
    whitened = whitening(b, mean)
    best = least_squares(whitened, np.zeros(15), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-13)
    value = peers.gauss_newton(b, mean, SIGMA, 8)
    np.testing.assert_allclose((value - mean) / SIGMA, best.x, rtol=0, atol=1e-6)
    # Each step must be a true Gauss-Newton step, or "the same number of steps" would compare unlike things.
    one = peers.gauss_newton(b, mean, SIGMA, 1)
    residual, jacobian = whitened(np.zeros(15)), best_jacobian(whitened)
    np.testing.assert_allclose((one - mean) / SIGMA, -np.linalg.lstsq(jacobian, residual)[0], rtol=0, atol=1e-6)


def best_jacobian(function):
    """Central differences at zero."""
    step = 1e-5
    return np.stack([(function(e) - function(-e)) / (2 * step) for e in step * np.eye(15)], -1)


def test_gauss_newton_of_lanes_is_that_of_each():
    alone = [baked(seed) for seed in (11, 12, 13)]
    alone[1].sigma_px[:] = np.nan
    lanes = peers.Baked(**{k: np.stack([vars(b)[k] for b in alone]) if k != "focal_px" else FOCAL_PX for k in vars(alone[0])})
    value = peers.gauss_newton(lanes, TRUTH, SIGMA, 5)
    np.testing.assert_array_equal(value, [peers.gauss_newton(b, TRUTH, SIGMA, 5) for b in alone])
    np.testing.assert_array_equal(np.isnan(value).all(-1), [False, True, False])


def test_a_prepared_call_keeps_what_it_points_to():
    run = peers.prepared_gauss_newton(baked(14), TRUTH, SIGMA, 5)
    _ = [np.full((130, 3), np.nan) for _ in range(100)]  # would be written over arrays that were freed
    np.testing.assert_array_equal(run(), peers.gauss_newton(baked(14), TRUTH, SIGMA, 5))


def test_scipy_calibration():
    b = baked(15)
    rng = np.random.default_rng(16)
    mean, u = TRUTH + 0.5 * SIGMA * rng.normal(size=15), rng.normal(size=15)
    whitened, peer = whitening(b, mean), ScipyCalibration(b, mean, SIGMA)
    np.testing.assert_allclose(peer.residual(u), whitened(u), rtol=0, atol=1e-8)
    differences = best_jacobian(lambda du: whitened(u + du))
    np.testing.assert_allclose(peer.jacobian(u), differences, rtol=0, atol=1e-9 * np.abs(differences).max())
    cxx = (peers.gauss_newton(b, mean, SIGMA, 8) - mean) / SIGMA
    np.testing.assert_allclose(peer.solve(), cxx, rtol=0, atol=1e-5)  # scipy stops at 1e-8 of the cost


def test_missing_headers_are_named(monkeypatch):
    monkeypatch.setattr(build.importlib.metadata, "distribution", distribution_that_is_not_installed)
    with pytest.raises(build.MissingPeer, match=r"headers of Eigen: pip install 'whiskjax\[bench\]'"):
        build.library("gauss_newton")


def distribution_that_is_not_installed(name):
    raise build.importlib.metadata.PackageNotFoundError(name)


def test_a_missing_compiler_is_named(monkeypatch):
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(build.MissingPeer, match="'no-such-compiler' is not on the PATH"):
        build.library("image_to_ground")


def test_arrays_that_cxx_would_misread_are_refused():
    f = flight(10)
    with pytest.raises(ValueError, match="contiguous float64"):
        peers.image_to_ground(f, np.linspace(900, 901, 10)[::2], np.zeros(5), 0.0)
