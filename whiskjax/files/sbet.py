"""SBET: the binary smoothed best estimate of trajectory that Applanix POSPac and others write.

A file is a sequence of records without a header, each 17 little-endian float64 (136 bytes): time (GPS seconds of the week),
latitude, longitude (rad), altitude (m, ellipsoidal), x, y, z velocity (m/s), roll, pitch, platform heading, wander angle (rad),
x, y, z body acceleration (m/s^2), x, y, z body angular rate (rad/s).

**Reference:** Applanix, POSPac quick start guide, table "Post-Processed Solution File". Heading is that of the wander angle
frame: true heading = platform heading - wander angle. The velocities also refer to that frame, but exporters differ in its axes
(north, west, up in Applanix' own documents, the vehicle's axes in others), so velocities are left out, never guessed.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..chain.samples import ecef_samples
from ..rules import FlightError

SUFFIXES = (".sbet", ".out")
_FIELDS = (
    *("time_s", "lat_rad", "lon_rad", "height_m", "vx_mps", "vy_mps", "vz_mps", "roll_rad", "pitch_rad", "heading_rad"),
    *("wander_rad", "ax_mps2", "ay_mps2", "az_mps2", "wx_radps", "wy_radps", "wz_radps"),
)
RECORD = np.dtype([(name, "<f8") for name in _FIELDS])
_LIMITS = {"lat_rad": np.pi / 2, "lon_rad": 2 * np.pi, "roll_rad": np.pi, "pitch_rad": np.pi / 2, "heading_rad": 4 * np.pi}
_USED = ("time_s", "lat_rad", "lon_rad", "height_m", "roll_rad", "pitch_rad", "heading_rad", "wander_rad")


class SbetSamples(NamedTuple):
    """Times in seconds (n,), ECEF positions (n, 3), quaternions ecef_from_body (n, 4)."""

    time_s: Float[np.ndarray, " n"]
    position_m: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]


def is_sbet(file: str) -> bool:
    """Whether a POS file is binary, by its suffix."""
    return file.lower().endswith(SUFFIXES)


def read_sbet(path: Path) -> SbetSamples:
    """Read an SBET file.

    **Raises:** `FlightError` naming the record (counted from 1) that is not finite, out of range or not later than the one
    before it, or where the size of the file is no multiple of 136 bytes.
    """
    if not path.is_file():
        raise FlightError(f"{path.name} does not exist, but [pos] file in flight.toml names it")
    size = path.stat().st_size
    if size == 0 or size % RECORD.itemsize:
        raise FlightError(f"{path.name}: {size} bytes are not whole SBET records of {RECORD.itemsize} bytes; is it a text file?")
    records = np.fromfile(path, dtype=RECORD)
    # A comparison with NaN is false.
    wrong = np.stack([~(np.abs(records[name]) <= _LIMITS.get(name, np.finfo(float).max)) for name in _USED], axis=-1)
    if wrong.any():
        i, k = (int(n) for n in np.argwhere(wrong)[0])
        value = records[_USED[k]][i]
        raise FlightError(
            f"{path.name}, record {i + 1}, {_USED[k]}: {value:.6g} is not possible; an SBET file holds radians in "
            "little-endian float64"
        )
    steps = np.diff(records["time_s"])
    if (steps <= 0).any():
        i = int(np.argmax(steps <= 0)) + 1
        raise FlightError(
            f"{path.name}, record {i + 1}, time_s: {records['time_s'][i]:.10g} is not later than {records['time_s'][i - 1]:.10g} "
            "before it; sort the records, and at the end of a GPS week add 604800 s"
        )
    heading = np.remainder(records["heading_rad"] - records["wander_rad"], 2 * np.pi)
    place = records["lat_rad"], records["lon_rad"], records["height_m"]
    position, quaternion, _ = ecef_samples(*place, records["roll_rad"], records["pitch_rad"], heading)
    return SbetSamples(np.array(records["time_s"]), position, quaternion)
