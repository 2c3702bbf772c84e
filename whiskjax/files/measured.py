"""points.csv and observations.csv: what was surveyed, and where it was seen."""

import numpy as np
from jaxtyping import Float

from ..estimate.block.block import ROLES
from ..flights.flight import Image, Measurements, Points
from ..rules import FlightError
from ..rules.spread import LEAST_SIGMA, MOST_SIGMA
from .images import LINES
from .names import listed, meant
from .navigation import position_columns, positions
from .source import IMAGES, Source
from .tables import Column, Table

POINTS, OBSERVATIONS = "points.csv", "observations.csv"
SIGMAS = ("sigma_e_m", "sigma_n_m", "sigma_u_m")


def points_of(source: Source) -> tuple[Points, Table]:
    """The points, and the table that they came from.

    **Raises:** `FlightError` for a point that is there twice, perhaps in another role, and for a control or check point without
    coordinates.
    """
    sheet = source.sheet(POINTS, "every flight")
    columns = [
        Column("point", text=True),
        *position_columns(sheet, source.toml.world.kind, blank=True),
        *(
            Column(
                name, required=False, low=0.0, high=MOST_SIGMA, hint="a sigma is not negative; 0 means that the point is exact"
            )
            for name in SIGMAS
        ),
        Column("role", choices=ROLES),
    ]
    table = sheet.parse(columns)
    seen: dict[str, int] = {}
    for row, name in enumerate(table["point"]):
        if name in seen:
            first, role = seen[name], table["role"][row]
            what = "role" if role != table["role"][first] else "point"
            found = (
                f"contradictory role: {table['role'][first]} in line {table.lines[first]}, {role} here; "
                if what == "role"
                else ""
            )
            table.fail(row, what, f"{found}point {name!r} is there twice, first in line {table.lines[first]}; keep one of them")
        seen[name] = row
    position = positions(table, source.toml.world.kind)
    for row in np.flatnonzero(np.isnan(position[:, 0])):
        if table["role"][row] != "tie":
            column = "lat_deg" if "lat_deg" in table else "x_m"
            table.fail(int(row), column, f"is blank, but a {table['role'][row]} point has coordinates; only ties may lack them")
    zero = np.zeros(len(table))
    sigma = np.stack([table[name] if name in table else zero for name in SIGMAS], axis=-1)
    return Points(table["point"], position, sigma, table["role"]), table


def measurements_of(source: Source, images: list[Image], points: Table) -> tuple[Measurements, Table]:
    """The measurements, and the table that they came from.

    **Raises:** `FlightError` for an image or point that does not exist, a measurement that is there twice, and a line outside the
    lines of its image.
    """
    columns = [
        *(Column(name, text=True) for name in ("image", "point")),
        *(Column(name) for name in ("line", "sample")),
        *(
            Column(name, positive=True, low=LEAST_SIGMA, high=MOST_SIGMA, hint="every measurement has a 1-sigma in pixels")
            for name in ("sigma_line_px", "sigma_sample_px")
        ),
    ]
    table = source.sheet(OBSERVATIONS, "every flight").parse(columns)
    if not len(table):
        raise FlightError(f"{OBSERVATIONS} has no observations: nothing can be estimated from it; add a line for each")
    index = {
        "image": _indices(table, "image", source.images["image"], IMAGES),
        "point": _indices(table, "point", points["point"], POINTS),
    }
    line, sample = (table[name] - source.first_centre for name in ("line", "sample"))
    _refuse_repeats(table)
    _check_lines(table, images, index["image"], line)
    found = Measurements(index["image"], index["point"], line, sample, table["sigma_line_px"], table["sigma_sample_px"])
    return found, table


def _indices(table: Table, column: str, names: list[str], file: str) -> np.ndarray:
    known = {name: i for i, name in enumerate(names)}
    for row, name in enumerate(table[column]):
        if name not in known:
            table.fail(row, column, f"no {column} named {name!r}{meant(name, names)}; {file} has {listed(names)}")
    return np.array([known[name] for name in table[column]])


def _refuse_repeats(table: Table) -> None:
    seen: dict[tuple, int] = {}
    for row, key in enumerate(zip(table["image"], table["point"], table["line"], table["sample"], strict=True)):
        if key in seen:
            table.fail(row, "point", f"the same measurement stands in line {table.lines[seen[key]]}; keep one of them")
        seen[key] = row


def _check_lines(table: Table, images: list[Image], image: np.ndarray, line: Float[np.ndarray, " n"]) -> None:
    for i in np.unique(image):
        lines = images[i].lines
        if lines is None:
            continue
        first, last = float(lines.line[0]), float(lines.line[-1])
        rows = np.flatnonzero(image == i)
        for row in rows[(line[rows] < first) | (line[rows] > last)]:
            shift = table["line"][row] - line[row]
            known = f"{first + shift:g} to {last + shift:g}"
            what = f"{table['line'][row]:g} lies outside the lines of image {images[i].name} in {LINES}, {known}"
            table.fail(int(row), "line", f"{what}; nothing is extrapolated")
