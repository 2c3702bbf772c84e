"""Motion that no platform can fly, told in the words of the file that recorded it: line or record, columns, values."""

import contextlib
import math
from collections.abc import Iterator, Mapping

from ..chain.possible import ImpossibleMotion
from ..earth.world import CARTESIAN, GEODETIC
from ..rules import FlightError
from .navigation import ATTITUDE, VELOCITIES
from .tables import Table

_METRES_A_DEGREE = 1.1e5


@contextlib.contextmanager
def in_words_of_table(table: Table, angles: str) -> Iterator[None]:
    """**Raises:** `FlightError` with the line, the columns that stand out and their cells, for an `ImpossibleMotion` inside."""
    try:
        yield
    except ImpossibleMotion as error:
        row, there = error.sample, table.cells(error.sample)
        beside = row - 1 if row else 1
        names = {
            "position": next(names for names in (GEODETIC, CARTESIAN) if names[0] in there),
            "attitude": ATTITUDE[angles],
            "velocity": next((names for names in VELOCITIES if names[0] in there), ()),
        }[error.what]
        if error.what == "velocity":
            culprits = names
        else:
            culprits = _that_change(names, there, table.cells(beside))
        sentence = error.sentence(lambda i: f"line {table.lines[i]}")
        told = ", ".join(there[name] for name in culprits)
        table.fail(row, ", ".join(culprits), f"{told}: {sentence}")


@contextlib.contextmanager
def in_words_of_sbet(file: str) -> Iterator[None]:
    """**Raises:** `FlightError` with the number of the record, for an `ImpossibleMotion` inside."""
    try:
        yield
    except ImpossibleMotion as error:
        sentence = error.sentence(lambda i: f"record {i + 1}")
        raise FlightError(f"{file}, record {error.sample + 1}, {error.what}: {sentence}") from error


def _that_change(names: tuple[str, ...], here: Mapping[str, str], beside: Mapping[str, str]) -> list[str]:
    """The columns by whose cells two lines differ most: all that do by a tenth of it."""
    change = {}
    for name in names:
        difference = float(here[name]) - float(beside[name])
        if name in ("lat_deg", "lon_deg"):
            difference *= _METRES_A_DEGREE * (math.cos(math.radians(float(beside["lat_deg"]))) if name == "lon_deg" else 1)
        elif name.endswith("_deg"):
            difference = math.remainder(difference, 360)
        change[name] = abs(difference)
    return [name for name in names if change[name] >= 0.1 * max(change.values())]
