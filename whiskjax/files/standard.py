"""A standard of accuracy that a block is held against: largest RMSE of check points, from a file of the user's own."""

import dataclasses
import math
from pathlib import Path

from ..estimate.map_limits import Standard
from ..rules import FlightError
from .names import listed, meant, shown
from .toml_file import read_toml


def read_standard(path: Path) -> Standard:
    """A standard from TOML: `name`, and `planimetry_m`, `height_m` or both.

    **Raises:** `FlightError` naming the file and the key.
    """
    data = read_toml(path, str(path))
    keys = [field.name for field in dataclasses.fields(Standard)]
    for key in data:
        if key not in keys:
            raise FlightError(f"{path}: {key}: no such key{meant(key, keys)}; expected here: {listed(keys)}")
    if not isinstance(data.get("name"), str):
        raise FlightError(f"{path}: name: a text is expected, which is what reports call the standard")
    limits = {key: value for key, value in data.items() if key != "name"}
    if not limits:
        raise FlightError(f"{path}: planimetry_m, height_m or both are expected: the largest RMSE of check points in metres")
    for key, value in limits.items():
        if type(value) not in (int, float) or not 0 < value < math.inf:
            raise FlightError(f"{path}: {key}: a positive number of metres is expected, not {shown(value)}")
    return Standard(data["name"], **{key: float(value) for key, value in limits.items()})
