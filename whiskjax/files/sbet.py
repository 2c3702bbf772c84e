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

from ..chain.places import HEIGHT_LIMITS_M
from ..chain.samples import ecef_samples
from ..rules import FlightError

SUFFIXES = (".sbet", ".out")
_FIELDS = (
    *("time_s", "lat_rad", "lon_rad", "height_m", "vx_mps", "vy_mps", "vz_mps", "roll_rad", "pitch_rad", "heading_rad"),
    *("wander_rad", "ax_mps2", "ay_mps2", "az_mps2", "wx_radps", "wy_radps", "wz_radps"),
)
RECORD = np.dtype([(name, "<f8") for name in _FIELDS])
# Smallest and largest of the fields that are used: angles within a turn (the heading is that of a frame that wanders by another).
_FINITE, _TURN = np.finfo(np.float64).max, 2 * np.pi
_LIMITS = {
    "time_s": (-_FINITE, _FINITE),
    "lat_rad": (-np.pi / 2, np.pi / 2),
    "lon_rad": (-_TURN, _TURN),
    "height_m": HEIGHT_LIMITS_M,
    "roll_rad": (-_TURN, _TURN),
    "pitch_rad": (-_TURN, _TURN),
    "heading_rad": (-2 * _TURN, 2 * _TURN),
    "wander_rad": (-_TURN, _TURN),
}


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
    records = np.memmap(path, dtype=RECORD, mode="r")  # only the fields that are used are copied
    found = {name: np.array(records[name]) for name in _LIMITS}
    _refuse_impossible(path.name, found)
    time = found["time_s"]
    repeats = np.diff(time) <= 0
    if repeats.any():
        i = int(np.argmax(repeats)) + 1
        raise FlightError(
            f"{path.name}, record {i + 1}, time_s: {time[i]:.10g} is not later than {time[i - 1]:.10g} "
            "before it; sort the records, and at the end of a GPS week add 604800 s"
        )
    heading = np.remainder(found["heading_rad"] - found["wander_rad"], _TURN)
    place = found["lat_rad"], found["lon_rad"], found["height_m"]
    position, quaternion, _ = ecef_samples(*place, found["roll_rad"], found["pitch_rad"], heading)
    return SbetSamples(time, position, quaternion)


def _refuse_impossible(file: str, found: dict[str, np.ndarray]) -> None:
    """**Raises:** `FlightError` naming the first record with a value beyond its limits, and the first such field in it."""
    first: dict[str, int] = {}
    for name, (low, high) in _LIMITS.items():
        # A comparison with NaN is false.
        wrong = ~((found[name] >= low) & (found[name] <= high))
        if wrong.any():
            first[name] = int(np.argmax(wrong))
    if first:
        name = min(first, key=first.__getitem__)
        i = first[name]
        raise FlightError(
            f"{file}, record {i + 1}, {name}: {found[name][i]:.6g} is not possible; an SBET file holds radians and metres in "
            "little-endian float64"
        )
