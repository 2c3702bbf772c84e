"""Tables of a located target, for the terminal and for the report, and the looks one by one as CSV."""

import math
from pathlib import Path

import numpy as np

from ...estimate.model_test import UNLIKELY
from ...estimate.reason import probability
from ..plain import Summary, number
from ..scales import axes_in, caption, one_keys, scale_columns, scale_values
from ..sheets import write_csv
from ..tables import Cell, Table, decimals_among, decimals_of, fixed, short
from .sighting import Sighting

_M_PER_DEG = 111_320.0
_NAMES = {
    "lat_deg": ("latitude", "deg"),
    "lon_deg": ("longitude", "deg"),
    "height_m": ("height", "m"),
    "x_m": ("x", "m"),
    "y_m": ("y", "m"),
    "z_m": ("z", "m"),
}


def all_tables(summary: Summary) -> list[Table]:
    """In the order in which they are read; those without rows are left out."""
    made = (position_table(summary), accuracy_table(summary), parameters(summary), looks(summary), largest(summary))
    return [table for table in made if table is not None]


def position_table(summary: Summary) -> Table | None:
    """Where the target is, how sure that is, and how far off a known position is; None without an answer."""
    found, truth = summary["position"], summary["truth"]
    if found is None:
        return None
    # Rows run like the coordinates, latitude first; sigmas and errors are in east, north, up.
    order = (1, 0, 2) if "lat_deg" in found else (0, 1, 2)
    rows = []
    for key, k in zip(found, order, strict=True):
        name, unit = _NAMES[key]
        sigma = summary["sigma_enu_m"][k]
        per_unit = 1.0
        if unit == "deg":
            per_unit = _M_PER_DEG * (math.cos(math.radians(found["lat_deg"])) if key == "lon_deg" else 1.0)
        decimals, metres = decimals_of(sigma / per_unit), decimals_of(sigma)
        cells = [Cell(name), Cell(unit), Cell(fixed(found[key], decimals)), Cell(("east", "north", "up")[k])]
        cells.append(Cell(fixed(sigma, metres)))
        if truth is not None:
            error = truth["error_enu_m"][k]
            off = truth["tail_probability"] <= UNLIKELY and abs(error) > 3 * sigma
            cells += [Cell(fixed(truth[key], decimals)), Cell(fixed(error, metres), off)]
        rows.append(tuple(cells))
    known = ("given", "error (m)") if truth is not None else ()
    caption = "Heights are above the ellipsoid. Sigma: 1-sigma along east, north, up, without knowing the other two."
    if "x_m" in found:
        caption = "Coordinates of the flight's local world. Sigma: 1-sigma along each, without knowing the other two."
    if truth is not None:
        several = f" Given: the mean of {truth['points']} points, which scatter by {short(truth['spread_m'], 3)} m (RMS)."
        caption += (
            f" Error: estimated − given, {short(truth['error_m'], 3)} m in space and {short(truth['error_horizontal_m'], 3)} m "
            f"horizontally; NEES {short(truth['nees'], 3)} of 3 expected (probability of more by chance: "
            f"{probability(truth['tail_probability'])}).{several if truth['points'] > 1 else ''}"
        )
    return Table(
        f"Position of {summary['label']}",
        ("coordinate", "unit", "value", "along", "± sigma (m)", *known),
        (False, False, True, False, True, *(True for _ in known)),
        tuple(rows),
        caption,
    )


def accuracy_table(summary: Summary) -> Table | None:
    """How far off the target may be; None without an answer."""
    found = summary["accuracy"]
    if found is None:
        return None
    words = {
        "cep50": ("CEP50", "50 of 100, horizontally"),
        "ce90": ("CE90", "90 of 100, horizontally"),
        "le90": ("LE90", "90 of 100, in height"),
        "se90": ("SE90", "90 of 100, in space"),
    }
    decimals, ellipse = decimals_of(found["cep50_m"]), found["ellipse_90"]
    rows = [(Cell(name), Cell(fixed(found[f"{key}_m"], decimals)), Cell(meaning)) for key, (name, meaning) in words.items()]
    axes = " × ".join(fixed(ellipse[key], decimals) for key in ("semi_major_m", "semi_minor_m"))
    rows.append((Cell("ellipse"), Cell(axes), Cell(f"90 of 100: half-axes; the long one at {ellipse['azimuth_deg']:.0f} deg")))
    return Table(
        "Accuracy",
        ("measure", "m", "errors within it"),
        (False, True, False),
        tuple(rows),
        "Exact quantiles of the covariance: to be believed as far as the looks agree with it. Azimuth clockwise from north.",
    )


def parameters(summary: Summary) -> Table | None:
    """Numbers of the instrument that were estimated with the target or considered; None where there are none."""
    if not summary["parameters"]:
        return None
    rows = []
    for p in summary["parameters"]:
        decimals = decimals_of(p["sigma"])
        prior = f"{short(p['prior_mean'], 6)} ± {short(p['prior_sigma'])}"
        names = (Cell(p["name"]), Cell(p["role"]), Cell(p["unit"]), Cell(prior))
        rows.append((*names, Cell(fixed(p["value"], decimals)), Cell(fixed(p["sigma"], decimals))))
    return Table(
        "Unknowns of the instrument",
        ("unknown", "role", "unit", "prior", "value", "± sigma"),
        (False, False, False, True, True, True),
        tuple(rows),
        "Considered: kept at the prior, whose sigma is part of the target's covariance.",
    )


def looks(summary: Summary) -> Table:
    """How many looks, from how far around, and whether they agree."""
    found, test = summary["looks"], summary["consistency"]
    odd = {"gated": found["gated"], "missed": found["missed"], "left out": found["left_out"]}
    rows = [(Cell("looks used"), Cell(f"{found['used']} of {found['looks']}"))]
    rows += [(Cell(f"looks {name}"), Cell(str(count), count > 0)) for name, count in odd.items()]
    if found["first_time_s"] is not None:
        rows.append((Cell("time (s)"), Cell(f"{fixed(found['first_time_s'], 3)} to {fixed(found['last_time_s'], 3)}")))
    rows += [
        (Cell("convergence angle (deg)"), Cell(short(found["convergence_deg"], 4))),
        (Cell("mean NIS (2 expected)"), Cell(fixed(test["mean_nis"], 2))),
        (Cell("sum of NIS, degrees of freedom"), Cell(f"{fixed(test['chi_square'], 1)}, {test['freedom']}")),
    ]
    chance = test["tail_probability"]
    if chance is not None:
        rows.append((Cell("probability of more by chance"), Cell(probability(chance), chance <= UNLIKELY)))
    return Table(
        "Looks and their test",
        ("", "figure"),
        (False, True),
        tuple(rows),
        "Convergence: the largest angle at the target between two lines of sight. NIS: innovation squared over its covariance.",
    )


def largest(summary: Summary) -> Table | None:
    """The looks that agree least; None where none was measured."""
    if not summary["largest_innovations"]:
        return None
    timed = summary["looks"]["first_time_s"] is not None
    found, (x, y), sizes = summary["largest_innovations"], axes_in(summary), one_keys(summary)
    decimals = {key: 1 + decimals_among(found, key) for key in sizes}
    return Table(
        "Largest innovations",
        ("look", "image", *(["time (s)"] * timed), f"px: {x}", f"px: {y}", *sizes.values(), "NIS", "state"),
        (True, False, *([True] * (timed + 3 + len(sizes))), False),
        tuple(
            (
                Cell(str(row["look"])),
                Cell(row["image"]),
                *([Cell(fixed(row["time_s"], 3))] if timed else []),
                Cell(fixed(row["x_px"], 1)),
                Cell(fixed(row["y_px"], 1)),
                *(Cell(fixed(row[key], decimals[key])) for key in sizes),
                Cell(fixed(row["nis"], 1)),
                Cell(row["state"], row["state"] != "used"),
            )
            for row in found
        ),
        f"Measured − predicted. {caption(summary)} Looks count from 0; all are in looks.csv.",
    )


def write_looks(path: Path, sighting: Sighting) -> None:
    """looks.csv: one row a look; the estimate after it, which is blank where there is no answer.

    Of a line camera x is along the detector line and y across it, in focal-plane pixels; `innovation_y_lines` counts lines.
    """
    found, time = sighting.location.looks, sighting.time_s
    coordinates = list(sighting.flight.world.position(sighting.guess.point_m))
    header = ("look", "image", "time_s", "state", "innovation_x_px", "innovation_y_px", "sigma_x_px", "sigma_y_px", "nis")
    header = (*header, *coordinates, "sigma_e_m", "sigma_n_m", "sigma_u_m")
    header = (*header, *scale_columns(sighting.flight.is_line, "innovation_{}_{}"))
    sigma_px = np.sqrt(np.diagonal(np.asarray(found.innovation_covariance_px2), axis1=1, axis2=2))
    sigma_m = np.sqrt(np.diagonal(np.asarray(found.covariance_enu_m2), axis1=1, axis2=2))
    point_m, innovation, nis = (np.asarray(v) for v in (found.point_m, found.innovation_px, found.nis))
    scaled = scale_values(sighting.scales, innovation)

    def row(i: int) -> list:
        estimate = [*sighting.flight.world.position(point_m[i]).values(), *sigma_m[i]] if sighting.is_answered else [math.nan] * 6
        figures = (*innovation[i], *sigma_px[i], nis[i], *estimate, *scaled[i])
        names = [i, sighting.images[i], None if time is None else number(time[i]), str(sighting.state[i])]
        return [*names, *(number(value) for value in figures)]

    write_csv(path, header, (row(i) for i in range(len(sighting))))
