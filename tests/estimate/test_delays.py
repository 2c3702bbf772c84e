"""A delay of noisy POS: by splines its cost is smooth, so that both verbs find it in few steps and it can be differentiated."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, RotationSpline

import whiskjax as wj

DELAY_S, BORESIGHT_RAD = 0.012, np.radians([0.3, -0.2, 0.5])
FOCAL_PX, CENTRE_PX, NOISE_PX = 3000.0, (2000.0, 1500.0), 0.3
STEP_S, STOP_S = 0.02, 20.0
UNKNOWNS = [
    wj.Unknown("delay", "body.delay_s", scale=0.01),
    *(wj.Unknown(f"angle {i}", f"camera_mount.angles_rad[{i}]", scale=0.01) for i in range(3)),
]


def flown(t):
    """Position and attitude of the platform, swinging by some degrees in some seconds."""
    t = np.asarray(t)
    position = np.stack([60 * t, 3 * np.sin(0.7 * t), 1000 + 2 * np.cos(0.5 * t)], axis=-1)
    roll, pitch, yaw = 2 * np.sin(np.pi * t), 1.5 * np.cos(2.2 * t), 3 * np.sin(1.3 * t)
    return position, Rotation.from_euler("ZYX", np.radians(np.stack([yaw, pitch, roll], axis=-1)))


def recorded(seed):
    """POS at 50 Hz with white errors of 0.002 deg and 5 mm, stamped late by the delay."""
    rng, t = np.random.default_rng(seed), np.arange(0, STOP_S, STEP_S)
    position, attitude = flown(t - DELAY_S)
    jitter = Rotation.from_rotvec(np.radians(0.002) * rng.standard_normal(position.shape))
    return t, position + 0.005 * rng.standard_normal(position.shape), (attitude * jitter).as_quat()


def sensor(seed, interpolation):
    body = wj.Trajectory(*recorded(seed), max_gap_s=0.1, interpolation=interpolation, delay_s=0.0)
    return wj.Sensor({"body": body, "camera_mount": wj.Mount(angles_rad=(0.0, 0.0, 0.0))}, wj.FrameCamera(FOCAL_PX, CENTRE_PX))


def imaged(position, attitude, ground, boresight_rad):
    """The collinearity equations, by scipy's rotations."""
    q = Rotation.from_euler("XYZ", boresight_rad).inv().apply(attitude.inv().apply(ground - position))
    return np.stack([CENTRE_PX[0] - FOCAL_PX * q[:, 0] / q[:, 2], CENTRE_PX[1] + FOCAL_PX * q[:, 1] / q[:, 2]], axis=-1)


def measured(seed, images=24, points=60):
    """Times, points and pixels of every ray, and the ground."""
    rng = np.random.default_rng(100 + seed)
    at = np.sort(rng.uniform(1, STOP_S - 1, images))
    ground = np.column_stack([rng.uniform(0, 1200, points), rng.uniform(-400, 400, points), rng.uniform(0, 80, points)])
    image, point = (a.ravel() for a in np.meshgrid(np.arange(images), np.arange(points), indexing="ij"))
    pixel = imaged(*flown(at[image]), ground[point], BORESIGHT_RAD)
    seen = ((pixel > 0) & (pixel < 2 * np.array(CENTRE_PX))).all(axis=1)
    pixel = pixel[seen] + NOISE_PX * rng.standard_normal((int(seen.sum()), 2))
    return at[image][seen], point[seen], pixel, ground


def observed(seed, rays=128):
    time_s, point, pixel, ground = measured(seed)
    keep = np.linspace(0, len(point) - 1, rays).astype(int)
    control = np.ones(rays, dtype=bool)
    return wj.Observations(wj.Shot(time_s=time_s[keep]), ground[point[keep]], pixel[keep], np.full((rays, 2), NOISE_PX), control)


@pytest.mark.parametrize("seed", range(4))
def test_calibrate_finds_a_delay_of_noisy_pos(seed):
    """In at most ten steps, at the minimum that scipy finds over its own splines."""
    seen = observed(seed)
    found = wj.calibrate(sensor(seed, "cubic"), seen, UNKNOWNS)
    t, position, quaternion = recorded(seed)
    positions, attitudes = CubicSpline(t, position), RotationSpline(t, Rotation.from_quat(quaternion))
    time_s = np.asarray(seen.shot.time_s)

    def residual(u):
        delay, boresight = 0.01 * u[0], 0.01 * u[1:]
        there = imaged(positions(time_s + delay), attitudes(time_s + delay), seen.point_m, boresight)
        return ((seen.pixel_px - there) / NOISE_PX).ravel()

    best = least_squares(residual, np.zeros(4), xtol=1e-12, ftol=1e-14).x * 0.01
    assert found.steps <= 10
    assert np.abs((found.value - best) / found.posterior.sigma).max() < 1e-3
    assert not any("kink" in said for said in found.warnings)


def test_the_delay_by_a_control_point_does_not_depend_on_the_step_of_the_difference():
    camera, seen = sensor(0, "cubic"), observed(0)

    def delay_s(shift_m):
        point = np.array(seen.point_m)
        point[17, 0] += shift_m
        moved = wj.Observations(seen.shot, point, seen.pixel_px, seen.sigma_px, seen.is_control)
        return wj.calibrate(camera, moved, UNKNOWNS).value[0]

    slopes = [(delay_s(h) - delay_s(-h)) / (2 * h) for h in (0.003, 0.03, 0.3)]
    np.testing.assert_allclose(slopes, slopes[0], rtol=2e-3)


def test_adjust_finds_a_delay_of_noisy_pos():
    for seed in range(4):
        time_s, point, pixel, ground = measured(seed, points=40)
        role = np.where(np.arange(40) < 8, "control", "tie")
        block = wj.Block(
            shot=wj.Shot(time_s=time_s),
            pixel_px=pixel,
            sigma_px=np.full(pixel.shape, NOISE_PX),
            point=point,
            position_m=np.where((role == "control")[:, None], ground, np.nan),
            covariance_m2=np.broadcast_to(4e-4 * np.eye(3), (40, 3, 3)),
            role=role,
        )
        found = wj.adjust(sensor(seed, "cubic"), block, UNKNOWNS)
        assert found.steps <= 10
        assert abs(found.value[0] - DELAY_S) < 1e-3  # noise of POS is in no sigma here: no test against the predicted one


def test_a_linear_record_is_said_to_kink_the_cost():
    found = wj.calibrate(sensor(0, "linear"), observed(0), UNKNOWNS)
    assert any("delay: body is interpolated linearly" in said and 'interpolation = "cubic"' in said for said in found.warnings)
