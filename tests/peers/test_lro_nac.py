"""usgscsm's "tough" LRO NAC (ba32d13b, tests/data/toughLroNacLineScan.json, public domain / CC0): there and back on the Moon.

Claim: pixels of a line camera of somebody else, over 173 positions and 1773 attitudes of real jitter on time tables of their own,
come back from a sphere within the 2e-3 px that usgscsm asks of itself. There is no ground truth.
"""

import functools
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from tests.peers.figures import Figure, assert_inside
from tests.peers.source import json_of
from tests.peers.strangers import CubicLine, Sphere
from tests.real.sets import Rows

PEER = "usgscsm, LRO NAC"
LINES, SAMPLES = np.linspace(0.5, 8191.5, 41), np.linspace(0.5, 2531.5, 52)


@functools.cache
def round_trip(folder: Path):
    """Differences in lines and samples, (lines, samples) each, and heights of the ground points above the Moon's radius."""
    given = json_of(folder, "lro_nac.json")
    orbit, attitude = (Rows(folder / f"lro_nac_{name}.csv") for name in ("positions", "attitude"))
    time, turned = orbit.numbers("time_s"), attitude.numbers("time_s")
    # Two time tables: one link that carries, and one behind it that turns.
    upright, nowhere = np.tile([0.0, 0.0, 0.0, 1.0], (len(time), 1)), np.zeros((len(turned), 3))
    velocity = orbit.numbers("vx_body_mps", "vy_body_mps", "vz_body_mps")
    place = orbit.numbers("x_body_m", "y_body_m", "z_body_m")
    links = {
        "orbit": wj.Trajectory(time, place, upright, max_gap_s=4.0, velocity_mps=velocity),
        "attitude": wj.Trajectory(turned, nowhere, attitude.numbers("qx", "qy", "qz", "qw"), max_gap_s=0.3),
        "optics": wj.Axes("-x y -z"),
    }
    camera = CubicLine(
        given["focal_length_mm"], given["k"], 142.857, given["detector_center_sample"], sample_step=float(given["summing"])
    )
    sensor = wj.Sensor(links, camera)
    ((line, first, rate),) = given["line_scan_rate"]
    end = np.array([line, given["image_lines"] - 0.5])
    lines = wj.LineTimes(end, first + rate * (end - line))
    sample, number = np.meshgrid(SAMPLES, LINES)
    pixel = np.stack([sample, np.zeros_like(sample)], axis=-1)
    moon = Sphere(given["body_radius_m"] + given["test_height_m"])
    point = wj.image_to_ground(sensor, wj.Shot(time_s=lines.time_at(jnp.asarray(number))), pixel, moon).point_m
    back = wj.ground_to_image(sensor, wj.Shot(), point, lines.window_s)
    height = np.linalg.norm(np.asarray(point), axis=-1) - given["body_radius_m"]
    return np.asarray(lines.line_at(back.time_s)) - number, np.asarray(back.pixel_px[..., 0]) - sample, height


def figures(folder: Path) -> list[Figure]:
    """What is claimed."""
    in_lines, in_samples, _ = round_trip(folder)
    what = f"{in_lines.size} pixels -> sphere -> pixels"
    return [
        Figure(f"{what}, lines", np.abs(in_lines).max(), "lines", 2e-3, "usgscsm asks it of itself"),
        Figure(f"{what}, samples", np.abs(in_samples).max(), "px", 2e-3, "usgscsm asks it of itself"),
    ]


def test_figures(peer_values):
    assert_inside(figures(peer_values))


def test_there_and_back_is_exact_to_rounding(peer_values):
    """Our own bar: 1e-9 m of coordinates are 2e-9 px of 0.5 m; and the points lie on the sphere."""
    in_lines, in_samples, height = round_trip(peer_values)
    assert max(np.abs(in_lines).max(), np.abs(in_samples).max()) < 5e-9
    np.testing.assert_allclose(height, 2307.5, rtol=0, atol=2e-9)
