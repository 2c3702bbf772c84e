"""The location peers against a textbook filter: a benchmark against a wrong program would measure nothing."""

import importlib
import sys

import jax
import numpy as np
import pytest

from benchmarks.peers import MissingPeer, dynamax_location, filterpy_location, location, numpy_location, stonesoup_location
from benchmarks.peers.location import Recorded, Sigmas, Start

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
FOCAL_PX = 1e5
SIGMAS = Sigmas()
TARGET = np.radians(43.3), np.radians(84.2), 1551.0
GUESS = np.radians(43.303653), np.radians(84.195190), 1000.0
NO_ERROR = np.zeros(8)
ERROR_SIGMA = np.r_[10, 10, 20, np.radians([0.03, 0.03, 0.08, 0.01, 0.01])]


def rx(t):
    return np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])


def ry(t):
    return np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])


def rz(t):
    return np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])


def ecef(lat, lon, height):
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    across = (n + height) * np.cos(lat)
    return np.array([across * np.cos(lon), across * np.sin(lon), (n * (1 - E2) + height) * np.sin(lat)])


def ecef_from_ned(lat, lon):
    """Columns north, east, down."""
    return rz(lon) @ ry(-lat) @ np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])


def in_body(pose, point, shift, turn):
    """A point in axes x forward, y right, z down; the true platform stands `shift` (body axes) off the recorded one and is
    turned by `turn` about its axes."""
    lat, lon, height, roll, pitch, heading = pose
    ecef_from_body = ecef_from_ned(lat, lon) @ rz(heading) @ ry(pitch) @ rx(roll)
    offset = ecef_from_body.T @ (point - ecef(lat, lon, height)) - shift
    return (rx(turn[0]) @ ry(turn[1]) @ rz(turn[2])).T @ offset


def project(look, point, errors):
    """Pixel of an ECEF point where position, attitude, beta and alpha are off by `errors`; analytic, for complex steps."""
    *pose, beta, alpha = look
    u = (rx(beta + errors[6]) @ ry(alpha + errors[7])).T @ in_body(pose, point, errors[:3], errors[3:6])
    return FOCAL_PX * u[:2] / u[2]


def orbit(runs, looks, seed):
    """Level flight at 10 km on a circle around the target, 45 degrees off nadir on the right; 500 m between looks."""
    rng = np.random.default_rng(seed)
    lat, lon, height = TARGET
    radius = 10_000 - height
    meridian, normal = A * (1 - E2) / (1 - E2 * np.sin(lat) ** 2) ** 1.5, A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    truth = []
    for azimuth in np.radians(136.0) + 500 / radius * np.arange(looks):  # of the platform, seen from the target
        position = lat + radius * np.cos(azimuth) / meridian, lon + radius * np.sin(azimuth) / (normal * np.cos(lat)), 10_000.0
        pose = *position, 0.0, 0.0, (azimuth + 1.5 * np.pi) % (2 * np.pi) - np.pi
        x, y, z = in_body(pose, ecef(*TARGET), np.zeros(3), np.zeros(3))
        truth.append([*pose, np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z))])
    sigma = np.r_[10 / meridian, 10 / (normal * np.cos(lat)), 20, ERROR_SIGMA[3:]]
    recorded = np.array(truth) + sigma * rng.normal(size=(runs, looks, 8))
    return Recorded(*np.moveaxis(recorded, -1, 0), pixel_px=rng.normal(0, 2.0, (runs, looks, 2)))


def first_guess():
    turn = ecef_from_ned(*GUESS[:2])
    sigma_m = np.r_[np.radians(0.015) * A * np.r_[1, np.cos(GUESS[0])], 1500]
    return Start(ecef(*GUESS), turn @ np.diag(sigma_m**2) @ turn.T)


def by_complex_step(function, at):
    step = 1e-20
    return np.stack([function(at + 1j * step * e).imag / step for e in np.eye(len(at))], -1)


def textbook(recorded, start, full):
    """One run after the other, with matrices and derivatives that know nothing of the geometry."""
    *arrays, pixel_px = vars(recorded).values()
    results = []
    for looks, pixels in zip(np.stack(arrays, -1), pixel_px, strict=True):
        x, P = np.zeros(3), start.covariance_m2
        for look, pixel in zip(looks, pixels, strict=True):
            point = start.guess_ecef_m + x
            H = by_complex_step(lambda p, look=look: project(look, p, NO_ERROR), point)
            R = 4.0 * np.eye(2)
            if full:
                E = by_complex_step(lambda e, look=look, point=point: project(look, point, e), NO_ERROR)
                R = R + E @ np.diag(ERROR_SIGMA**2) @ E.T
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x = x + K @ (pixel - project(look, point, NO_ERROR))
            I_KH = np.eye(3) - K @ H
            P = I_KH @ P @ I_KH.T + K @ R @ K.T
        results.append((x, P))
    x, P = zip(*results, strict=True)
    return np.array(x), np.array(P)


def cxx(recorded, full, threads=1):
    return location.prepared(recorded, first_guess(), SIGMAS, full, threads)()


def dynamax(recorded, start, sigmas, full):
    function, numbers = dynamax_location.prepared(recorded, start, sigmas, full)
    return lambda: jax.jit(function)(numbers)


both = pytest.mark.parametrize("full", [False, True])


@both
def test_cxx_is_the_textbook_filter(full):
    recorded = orbit(5, 70, 1)
    x, P = cxx(recorded, full)
    expected_x, expected_P = textbook(recorded, first_guess(), full)
    np.testing.assert_allclose(x, expected_x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(P, expected_P, rtol=0, atol=1e-6)


@both
def test_large_attitude_and_a_gimbal_that_does_not_point_at_the_target(full):
    recorded, rng = orbit(5, 10, 2), np.random.default_rng(3)
    numbers = np.stack(list(vars(recorded).values())[:-1], -1)
    numbers[..., 3:] += rng.uniform(-0.3, 0.3, (5, 10, 5))
    pixels = [[project(look, ecef(*TARGET), NO_ERROR) for look in looks] for looks in numbers]
    tilted = Recorded(*np.moveaxis(numbers, -1, 0), pixel_px=np.array(pixels) + rng.normal(0, 2.0, (5, 10, 2)))
    assert np.abs(tilted.pixel_px).max() > 30_000
    for found, expected in zip(cxx(tilted, full), textbook(tilted, first_guess(), full), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@both
@pytest.mark.parametrize("threads", [2, 3, 8])
def test_threads_change_nothing(threads, full):
    recorded = orbit(7, 5, 4)
    for a, b in zip(cxx(recorded, full), cxx(recorded, full, threads), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_thousand_runs_are_as_good_as_the_scenario_says():
    recorded = orbit(1000, 40, 5)
    x, P = cxx(recorded, True)
    error = x + ecef(*GUESS) - ecef(*TARGET)
    assert 5.9 < np.linalg.norm(error, axis=-1).mean() < 7.0
    assert 2.65 < np.einsum("ni,nij,nj->n", error, np.linalg.inv(P), error).mean() < 3.45
    assert 5.9 < np.linalg.norm(cxx(recorded, False)[0] + ecef(*GUESS) - ecef(*TARGET), axis=-1).mean() < 7.0


@both
@pytest.mark.parametrize("prepared", [numpy_location.prepared, dynamax, filterpy_location.prepared, stonesoup_location.prepared])
def test_the_other_peers_are_the_same_filter(prepared, full):
    recorded = orbit(3, 40, 7)
    for found, expected in zip(prepared(recorded, first_guess(), SIGMAS, full)(), cxx(recorded, full), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("peer", "module"),
    [("dynamax", "dynamax.nonlinear_gaussian_ssm"), ("filterpy", "filterpy.kalman"), ("stonesoup", "stonesoup.base")],
)
def test_a_missing_package_is_named(peer, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, f"benchmarks.peers.{peer}_location")
    with pytest.raises(MissingPeer, match=r"is not installed: pip install 'whiskjax\[bench\]'"):
        importlib.import_module(f"benchmarks.peers.{peer}_location")
