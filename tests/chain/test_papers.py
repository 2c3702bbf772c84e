"""The papers' own formulas as textbook numpy, against the chain."""

import csv
import os
import pathlib

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests import oracles
from whiskjax.flights import haian

PIXEL = 1e-6  # px: ECEF is rounded to 1e-9 m, seen from 3 km with a focal length of 1e4 px
RADIAN = 1e-12


def collinearity(flown, t, point, left):
    """Jin et al. (2024), equation (9): pixel (x, y) of a ground point; y with the sign of the swing."""
    truth = flown.truth
    forward_left_up = np.diag([1.0, -1.0, -1.0])
    attitude, position = flown.body
    m = attitude(t).as_matrix() @ forward_left_up
    r_pos = Rotation.from_euler("XYZ", truth.left_rad if left else truth.right_rad).as_matrix()
    r_sen = Rotation.from_euler("XYZ", truth.sensor_rad).as_matrix()
    theta, pitch = np.interp(t, flown.time_s, flown.scan_rad), np.interp(t, flown.time_s, flown.pitch_rad)
    s = oracles.about("x", theta).as_matrix() @ oracles.about("y", pitch).as_matrix()
    q = r_sen.T @ (s.T @ r_pos.T @ (m.T @ (point - position(t)) - truth.gps_arm_m) - truth.sensor_arm_m)
    f = haian.FOCAL_PX
    return np.array([-f * q[0] / q[2], (1 if left else -1) * -f * q[1] / q[2]])


@pytest.mark.parametrize("swing", [0, 1], ids=["left", "right"])
def test_000_equation_9_is_the_projection(swings, swing):
    rng = np.random.default_rng(31)
    t = swings.start_s[swing] + rng.uniform(0, 3, 12)
    # Points near the footprint: below the aircraft, up to 3.5 km to the side that the mirror looks at, +-100 m along the track.
    scan = np.interp(t, swings.time_s, swings.scan_rad)
    side = 3000 * np.tan(scan)
    lat, lon = haian.LAT_RAD, haian.LON_RAD
    along = np.array([np.cos(haian.HEADING_RAD), np.sin(haian.HEADING_RAD)])
    right = np.array([-along[1], along[0]])
    north, east = np.outer(along, rng.uniform(-100, 100, 12)) - np.outer(right, side)
    points = oracles.ecef(lat + north / 6.37e6, lon + east / (6.37e6 * np.cos(lat)), rng.uniform(8, 12, 12))
    expected = [collinearity(swings, time, point, swing == 0) for time, point in zip(t, points, strict=True)]
    got = wj.project(swings.sensor, wj.Shot(time_s=t, swing=swing), points).pixel_px
    assert np.abs(expected).max() < 20000  # the points are on the image or near it
    np.testing.assert_allclose(got, expected, rtol=0, atol=PIXEL)


# Wang et al. (2018): a three-line camera in one focal plane. u, v, w lead from the projection centre to the antenna.
FOCAL_PX, VIEWS_DEG = 26000.0, (27.0, 0.0, -14.0)
ARM_M, MISALIGNMENT = np.array([0.3, -0.2, 1.1]), np.radians([0.4, -0.3, 0.7])


def songshan(time, position, attitude):
    cameras = {
        name: wj.LineCamera(FOCAL_PX, 16378.0, offset_px=FOCAL_PX * np.tan(np.radians(view)), along="y")
        for name, view in zip(("forward", "nadir", "backward"), VIEWS_DEG, strict=True)
    }
    links = {
        "body": wj.Trajectory(time, position, attitude.as_quat(), max_gap_s=1.0),
        "flu": wj.Axes("x -y -z"),
        "camera_axes": wj.Mount(angles_rad=MISALIGNMENT),
        "centre": wj.Mount(lever_arm_m=ARM_M, lever_sign=-1),
    }
    return wj.Sensor(links, wj.By("view", cameras))


def test_001_equations_9_and_10_are_the_chain():
    """R_c^m = R_b^m R_c^b (10), X_S = X_A - R_c^m u (9), and back by (1): X_A = X_S + R_c^m u."""
    rng = np.random.default_rng(33)
    time = np.arange(5) * 0.5
    antenna = rng.normal([4000.0, -2000.0, 2450.0], 50.0, (5, 3))
    # A local world, x east, y north, z up: the attitude takes forward-right-down into it.
    flown = Rotation.from_euler("ZYX", [[1.0 + 0.01 * i, 0.02, -0.03] for i in range(5)])
    attitude = flown * Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    sensor = songshan(time, antenna, attitude)
    r_cm = flown.as_matrix()[2] @ Rotation.from_euler("XYZ", MISALIGNMENT).as_matrix()
    x_s = antenna[2] - r_cm @ ARM_M
    for view in range(3):
        sample = np.array([0.0, 10000.0, 32000.0])
        x, y = FOCAL_PX * np.tan(np.radians(VIEWS_DEG[view])), sample - 16378.0
        shot = wj.Shot(time_s=1.0, view=view)
        ray = wj.ray(sensor, shot, np.stack([sample, 0 * sample], -1))
        los = np.stack([np.full(3, x), y, np.full(3, -FOCAL_PX)], -1) @ r_cm.T
        np.testing.assert_allclose(ray.direction, los / np.linalg.norm(los, axis=-1, keepdims=True), rtol=0, atol=RADIAN)
        np.testing.assert_allclose(np.broadcast_to(ray.origin_m, (3, 3)), np.broadcast_to(x_s, (3, 3)), rtol=0, atol=1e-11)
        point = x_s + 2300 * los / FOCAL_PX
        pixel = wj.project(sensor, shot, point).pixel_px
        np.testing.assert_allclose(pixel, np.stack([sample, 0 * sample], -1), rtol=0, atol=PIXEL)
    np.testing.assert_allclose(np.asarray(ray.origin_m) + r_cm @ ARM_M, np.broadcast_to(antenna[2], (3, 3)), rtol=0, atol=1e-11)


def frame_turn(axis, angle):
    """The papers' rotation of the frame: the transpose of the active one."""
    return oracles.about(axis, angle).as_matrix().T


def test_003_pixels_are_those_of_the_chain():
    """(m, n) = f/a (u_x, u_y)/u_z, u = Ry(alpha) Rx(beta) Rx(roll) Ry(pitch) Rz(yaw) C_ne (target - platform)."""
    rng = np.random.default_rng(35)
    n = 6
    time = np.arange(n) * 3.0
    lat, lon, height = np.radians(43.25) + rng.uniform(-1e-3, 1e-3, n), np.radians(84.2), np.full(n, 10000.0)
    roll, pitch, yaw = rng.uniform(-0.1, 0.1, (3, n))
    alpha, beta = rng.uniform(-0.3, 0.3, n), rng.uniform(-0.9, -0.5, n)  # rolled towards the target on the right
    focal = 1e5
    links = {
        "body": wj.Trajectory.from_geodetic(time, lat, np.full(n, lon), height, roll, pitch, yaw, max_gap_s=5.0),
        "outer": wj.Turn("x", wj.Encoder(time, beta, 5.0)),
        "inner": wj.Turn("y", wj.Encoder(time, alpha, 5.0)),
        "camera_axes": wj.Axes("x -y -z"),
    }
    sensor = wj.Sensor(links, wj.FrameCamera(focal, (0.0, 0.0)))
    platform = oracles.ecef(lat, lon, height)
    for i in range(n):
        c_ne = oracles.ecef_from_ned(lat[i], lon).as_matrix().T
        r = (
            frame_turn("y", alpha[i])
            @ frame_turn("x", beta[i])
            @ frame_turn("x", roll[i])
            @ frame_turn("y", pitch[i])
            @ frame_turn("z", yaw[i])
            @ c_ne
        )
        # A target 12 km away, a degree beside the boresight.
        target = platform[i] + r.T @ (12000 * np.array([0.01, -0.02, 1.0]))
        u = r @ (target - platform[i])
        got = wj.project(sensor, wj.Shot(time_s=time[i]), target).pixel_px
        np.testing.assert_allclose(got, focal * u[:2] / u[2], rtol=0, atol=PIXEL)


# misb_uas: the README's verified formula, on the data where they are and on made-up angles everywhere.
MISB_AXES = "y -z -x"  # boresight forward: camera x to the right, camera y up, looking along -z


def misb(time, lat, lon, height, roll, pitch, heading, azimuth, elevation, gap):
    links = {
        "body": wj.Trajectory.from_geodetic(time, lat, lon, height, roll, pitch, heading, max_gap_s=gap),
        "azimuth": wj.Turn("z", wj.Encoder(time, azimuth, gap, wraps=False)),
        "elevation": wj.Turn("y", wj.Encoder(time, elevation, gap)),
        "camera_axes": wj.Axes(MISB_AXES),
    }
    return wj.Sensor(links, wj.FrameCamera(2000.0, (640.0, 360.0)))


def assert_misb(time, lat, lon, height, roll, pitch, heading, azimuth, elevation, gap):
    sensor = misb(time, lat, lon, height, roll, pitch, heading, azimuth, elevation, gap)
    ned = oracles.body_in_ned(roll, pitch, heading) * oracles.about("z", azimuth) * oracles.about("y", elevation)
    los = (oracles.ecef_from_ned(lat, lon) * ned).apply([1.0, 0, 0])
    ray = jax.jit(lambda s, t, p: wj.ray(s, wj.Shot(time_s=t), p))(sensor, time, np.full((len(time), 2), [640.0, 360.0]))
    np.testing.assert_allclose(ray.direction, los, rtol=0, atol=RADIAN)
    np.testing.assert_allclose(ray.origin_m, oracles.ecef(lat, lon, height), rtol=0, atol=4e-9)


def test_misb_line_of_sight():
    """LOS_ned = Rz(heading) Ry(pitch) Rx(roll) Rz(azimuth) Ry(elevation) [1, 0, 0]."""
    rng = np.random.default_rng(37)
    n = 10
    angles = rng.uniform([-0.5] * 2 + [0, 0, -1.5], [0.5] * 2 + [6.28, 6.28, 0], (n, 5)).T
    assert_misb(np.arange(n) * 1.0, *rng.uniform(-1, 1, (2, n)), rng.uniform(1000, 3000, n), *angles, 2.0)


DATA = pathlib.Path(os.environ.get("WHISKJAX_DATA", pathlib.Path(__file__).parents[3] / "shared" / "data"))


@pytest.mark.parametrize("name", ["cheyenne", "truck"])
def test_misb_line_of_sight_of_a_real_flight(name):
    file = DATA / "misb_uas" / f"{name}.csv"
    if not file.exists():
        pytest.skip(f"the real flights are not at {DATA}; set WHISKJAX_DATA")
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    time = (column["time_us"] - column["time_us"][0]) * 1e-6
    keep = np.r_[True, np.diff(time) > 0]
    deg = ("sensor_lat", "sensor_lon", "platform_roll", "platform_pitch", "platform_heading", "rel_az", "rel_el")
    lat, lon, *angles = (np.radians(column[key][keep]) for key in deg)
    assert_misb(time[keep], lat, lon, column["sensor_alt_msl"][keep], *angles, 60.0)
