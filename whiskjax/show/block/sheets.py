"""CSV files of an adjusted block, at full precision for other programs."""

import math
from pathlib import Path

import numpy as np

from ...estimate.errors import AXES
from ...files.navigation import position_texts
from ..plain import Summary, number
from ..scales import place_columns, scale_columns, scale_values
from ..sheets import write_csv
from .adjusted import Adjusted

NAMES = ("unknowns.csv", "adjusted_points.csv", "residuals.csv", "corrections.csv")


def write_sheets(folder: Path, adjusted: Adjusted, summary: Summary) -> None:
    """unknowns.csv, adjusted_points.csv, residuals.csv; corrections.csv where the trajectory was estimated."""
    _write_unknowns(folder / NAMES[0], summary)
    _write_points(folder / NAMES[1], adjusted)
    _write_residuals(folder / NAMES[2], adjusted)
    if adjusted.course is not None:
        _write_corrections(folder / NAMES[3], adjusted)


def _write_unknowns(path: Path, summary: Summary) -> None:
    keys = ("name", "unit", "prior_mean", "prior_sigma", "start", "value", "sigma", "data_share")
    write_csv(path, (*keys, "where"), ([*(p[key] for key in keys), " ".join(p["where"])] for p in summary["unknowns"]))


def _write_points(path: Path, adjusted: Adjusted) -> None:
    """One row a point, in the coordinates of points.csv; blank where nobody sees it."""
    block = adjusted.block
    rays = np.bincount(block.point[adjusted.adjustment.used], minlength=len(block.role))
    position = position_texts(adjusted.adjustment.point_m, adjusted.flight.world)
    header = ("point", "role", "rays", *position, *(f"{kind}_{axis}_m" for kind in ("sigma", "error") for axis in "enu"))
    figures = np.concatenate([adjusted.sigma_enu_m, adjusted.error_enu_m], axis=1)
    names = zip(block.points, block.role.tolist(), rays.tolist(), *position.values(), strict=True)
    write_csv(path, header, ([*name, *map(number, row)] for name, row in zip(names, figures, strict=True)))


def _write_residuals(path: Path, adjusted: Adjusted) -> None:
    """One row a ray; of a line camera x is along the detector line and y across it, and `line` and `y_lines` count lines."""
    block, is_line = adjusted.block, adjusted.flight.is_line
    time = block.key("time_s")
    header = ("image", "point", "role", "time_s", *place_columns(is_line), "x_px", "y_px", "sigma_x_px", "sigma_y_px", "used")
    header = (*header, *scale_columns(is_line, "{}_{}"))
    columns = np.concatenate([adjusted.place, adjusted.adjustment.residual_px, block.sigma_px], axis=1)
    scaled = scale_values(adjusted.scales, adjusted.adjustment.residual_px)
    rows = (
        [
            block.images[i],
            block.points[int(block.point[i])],
            str(adjusted.role[i]),
            None if time is None else number(time[i]),
            *map(number, columns[i]),
            "yes" if adjusted.adjustment.used[i] else "no",
            *map(number, scaled[i]),
        ]
        for i in range(len(block))
    )
    write_csv(path, header, rows)


def _write_corrections(path: Path, adjusted: Adjusted) -> None:
    """One row a station: turns in degrees, shifts in metres."""
    course = adjusted.course
    assert course is not None  # asked for by write_sheets
    factor = np.array([math.degrees(1.0)] * 3 + [1.0] * 3)
    value, sigma = course.value * factor, course.sigma * factor
    names = [f"{axis.replace(' ', '_')}_{'deg' if k < 3 else 'm'}" for k, axis in enumerate(AXES)]
    segment = [name for name, count in course.segments for _ in range(count)]
    rows = (
        [k, segment[k], None if course.time_s is None else number(course.time_s[k]), *map(number, (*value[k], *sigma[k]))]
        for k in range(len(value))
    )
    write_csv(path, ("station", "segment", "time_s", *names, *(f"sigma_{name}" for name in names)), rows)
