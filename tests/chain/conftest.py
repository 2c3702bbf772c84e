"""Instruments that the tests of imaging share; whatever they compile is compiled once a session."""

import dataclasses
import functools

import jax
import numpy as np
import pytest
from scipy.interpolate import interp1d
from scipy.spatial.transform import Slerp

import whiskjax as wj
from tests import oracles
from whiskjax.flights import haian


@dataclasses.dataclass(frozen=True)
class Swings:
    """Two swings of the haian whiskbroom over one place: everything recorded, as numpy arrays and as a sensor."""

    time_s: np.ndarray
    position_m: np.ndarray
    attitude: object  # scipy Rotation ecef_from_body, one for each time
    scan_rad: np.ndarray
    pitch_rad: np.ndarray
    start_s: tuple[float, float]
    truth: haian.Truth
    sensor: wj.Sensor

    @functools.cached_property
    def body(self):
        """Attitude and position at a time, by scipy."""
        return Slerp(self.time_s, self.attitude), interp1d(self.time_s, self.position_m, axis=0)


def fly(hz: float, wave: float = 1.0) -> Swings:
    """Left and right swing along the flight's own path and scan, waves `wave` times as high, POS and encoders at `hz`."""
    path = haian.Path.draw(jax.random.key(21))
    path = dataclasses.replace(path, wave_rad=wave * path.wave_rad)
    starts = (0.0, 3.5)
    ticks = np.arange(round(3.2 * hz) + 1) / hz - 0.1
    time = np.concatenate([start + ticks for start in starts])
    start = np.repeat(starts, len(ticks))
    lat, lon, height, roll, pitch, heading = path.navigation(time, start + 1.5)
    scan, mirror = path.scan(time, start, start == 0)
    attitude = oracles.ecef_from_ned(lat, lon) * oracles.body_in_ned(roll, pitch, heading)
    body = wj.Trajectory.from_geodetic(time, lat, lon, height, roll, pitch, heading, max_gap_s=1.5 / hz)
    encoders = (wj.Encoder(time, a, 1.5 / hz, name) for a, name in ((scan, "scan"), (mirror, "pitch")))
    sensor = haian.sensor(body, *encoders, haian.TABLE_4)
    return Swings(time, oracles.ecef(lat, lon, height), attitude, scan, mirror, starts, haian.TABLE_4, sensor)


@pytest.fixture(scope="session")
def swings():
    """POS at 200 Hz, as flown."""
    return fly(200.0)


@pytest.fixture(scope="session")
def rough_swings():
    """POS at 10 Hz only and five times the attitude motion: the kinks of linear interpolation are not small."""
    return fly(10.0, wave=5.0)
