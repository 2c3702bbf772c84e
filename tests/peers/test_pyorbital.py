"""pyorbital 1.13.0 (Apache-2.0): ground points of 40 AVHRR pixels (NOAA-19, 2012-12-12), two of them published in its tests.

Claim: our whiskbroom (a trajectory of 1 s, cubic between its positions, slerp between its attitudes; a mirror that turns by the
recorded angle) meets the ellipsoid within 5 cm of pyorbital's longitude and latitude, which come from its orbit, not a table.
"""

import functools
from pathlib import Path

import numpy as np

import whiskjax as wj
from tests import oracles
from tests.peers.figures import Figure, assert_inside
from tests.real.sets import Rows

PEER = "pyorbital"


@functools.cache
def away_m(folder: Path):
    """Distance of every pixel's ground point from pyorbital's."""
    orbit, pixels = (Rows(folder / f"pyorbital_avhrr_{name}.csv") for name in ("orbit", "pixels"))
    body = wj.Trajectory(
        orbit.numbers("time_s"),
        orbit.numbers("x_ecef_m", "y_ecef_m", "z_ecef_m"),
        orbit.numbers("qx", "qy", "qz", "qw"),
        max_gap_s=1.5,
        velocity_mps=orbit.numbers("vx_ecef_mps", "vy_ecef_mps", "vz_ecef_mps"),
    )
    mirror = wj.Turn("x", wj.Readings(pixels.numbers("mirror_angle_rad")), sign=-1)
    sensor = wj.Sensor({"body": body, "mirror": mirror, "optics": wj.Axes("x -y -z")}, wj.FrameCamera(1.0, (0.0, 0.0)))
    met = wj.image_to_ground(sensor, wj.Shot(time_s=pixels.numbers("time_s")), np.zeros((len(pixels), 2)), wj.HeightSurface(0.0))
    lon, lat = np.radians(pixels.numbers("lon_deg", "lat_deg")).T
    return np.linalg.norm(np.asarray(met.point_m) - oracles.ecef(lat, lon, 0.0), axis=1)


def figures(folder: Path) -> list[Figure]:
    """What is claimed."""
    away = away_m(folder)
    assert len(away) == 40
    source = "set before; a table of 1 s instead of the orbit"
    return [Figure("ground points of 40 AVHRR pixels, largest distance", away.max(), "m", 0.05, source)]


def test_figures(peer_values):
    assert_inside(figures(peer_values))
