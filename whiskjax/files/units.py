"""Degrees in files, radians inside: field names, values, and the places of unknowns."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..rules import FlightError

_FILE_FIELD = re.compile(r"_deg(?=(\[[^\]]*\])?$)")
_INNER_FIELD = re.compile(r"_rad(?=(\[[^\]]*\])?$)")
# Fields that count pixels from the first one; they follow its convention, as sizes and offsets do not.
_PIXEL_PLACES = re.compile(r"\.(principal_point_px|principal_sample_px)(\[|$)")


def inner_place(where: str) -> str:
    """`platform.left.angles_deg[0]` as the sensor knows it: `platform.left.angles_rad[0]`.

    **Raises:** `FlightError` where the file names radians.
    """
    if _INNER_FIELD.search(where):
        raise FlightError(f"angles are in degrees in files; write {file_place(where)}")
    return _FILE_FIELD.sub("_rad", where.strip())


def file_place(where: str) -> str:
    """`platform.left.angles_rad[0]` as files know it: `platform.left.angles_deg[0]`."""
    return _INNER_FIELD.sub("_deg", where)


def file_words(message: str) -> str:
    """A message about fields of the sensor, in the words of files."""
    return re.sub(r"_rad\b", "_deg", message)


def is_angle(where: str) -> bool:
    """Whether a place inside a sensor holds radians."""
    return _INNER_FIELD.search(where) is not None


def is_pixel_place(where: str) -> bool:
    """Whether a place holds a pixel coordinate, which follows the numbering of pixels."""
    return _PIXEL_PLACES.search(where) is not None


def degrees(value_rad: float) -> float:
    """Degrees for a file: the shortest number whose radians are exactly this value, where there is one near."""
    near = math.degrees(value_rad)
    if near == 0 or not math.isfinite(near):
        return near
    for digits in range(1, 18):
        short = float(f"{near:.{digits}g}")
        if math.radians(short) == value_rad:
            return short
    beside = (math.nextafter(near, math.inf), math.nextafter(near, -math.inf))
    return next((n for n in beside if math.radians(n) == value_rad), near)


def floats(value: Any) -> Any:
    """An array of any shape as nested lists of floats, a scalar as a float."""
    return np.asarray(value, dtype=np.float64).tolist()


def degree_lists(value_rad: Any) -> Any:
    """The same in degrees."""
    nested = floats(value_rad)
    return _map(degrees, nested)


def radian_array(value_deg: Sequence[Any]) -> np.ndarray:
    """Lists of degrees as an array of radians."""
    return np.radians(np.asarray(value_deg, dtype=np.float64))


def _map(function: Any, nested: Any) -> Any:
    return [_map(function, item) for item in nested] if isinstance(nested, list) else function(nested)
