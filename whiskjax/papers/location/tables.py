"""The study of Liu et al. (2019) as tables: paper, reached and band side by side."""

import math
from collections.abc import Sequence
from pathlib import Path

from ...show.plain import Summary, versions
from ...show.sheets import write_csv
from ...show.tables import Cell, Table, fixed
from ..figure import Figure, verdict_of
from .runs import Measured, Sizes

TITLE = "Liu et al. (2019) reproduced: a target located from many oblique looks"
_NOTES = {
    "Figure 6": "Orbit and race at 45 deg off nadir, first guess from the first look onto the ellipsoid at 1000 m.",
    "Figure 7": "The same orbit, with a surface that is too low or too high for the first guess.",
    "Figure 8": "40 looks: over the height of the platform at 45 deg, and over the off-nadir angle at 10 km.",
    "Figure 9": "Both together: at 75 deg the paper's 20 m ask for looks 1 km apart; at 500 m the angle between the rays is "
    "too small.",
    "Figure 10": "68.2 deg off nadir.",
    "Table 2": "A straight flight at 9.8 km, centred on broadside; the paper flew at 67 to 78 deg.",
    "estimators": "The first guess is drawn from P0 anew in every run, so that the covariance can be judged: NEES of 3 states "
    "is 3 where it is honest.",
    "constant errors": "Attitude and gimbal errors that stay the same in all looks of a run, the others by a tenth; 20 km leg "
    "to and fro.",
    "refraction": "Looks through a layered standard atmosphere, located without it; nothing else is wrong.",
    "calibration handed on": "The boresight is calibrated on 6 surveyed points first, and used in 600 flights with 40 looks "
    "each.",
    "time offset": "POS stamped later than camera and gimbal by a time that is known to 50 ms only; 80 looks to and fro.",
}  # fmt: skip


def summarise(measured: Measured, sizes: Sizes, seed: int, command: str) -> Summary:
    """Everything that is printed or written, as plain data; names end in their unit."""
    return {
        "title": TITLE,
        "command": command,
        "verdict": verdict_of(measured.figures, _said),
        "runs": sizes._asdict() | {"seed": seed},
        "figures": [f.as_row() for f in measured.figures],
        "versions": versions("jax", "numpy"),
    }


def tables(summary: Summary) -> tuple[Table, ...]:
    """One table a section, in the order of the paper."""
    sections = dict.fromkeys(f["section"] for f in summary["figures"])
    return tuple(_table(section, [f for f in summary["figures"] if f["section"] == section]) for section in sections)


def _table(section: str, figures: Sequence[Summary]) -> Table:
    rows = []
    for f in figures:
        verdict = "" if f["is_inside"] is None else "inside" if f["is_inside"] else "OUTSIDE"
        cells = (f["what"], _unit(f["unit"]), f["paper"], _band(f["low"], f["high"]), _reached(f["reached"], f["unit"]))
        rows.append((*map(Cell, cells), Cell(verdict, verdict == "OUTSIDE")))
    heads = ("figure", "unit", "paper", "band", "here", "")
    title = section if section[0].isupper() else f"Beyond the paper: {section}"
    return Table(title, heads, (False, False, True, True, True, False), tuple(rows), _NOTES[section])


def _said(f: Figure) -> str:
    reached = f"{_reached(f.reached, f.unit)} {_unit(f.unit)}".rstrip()
    return f"{f.section}, {f.what}: {reached}, band {_band(f.low, f.high)}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _reached(value: float | None, unit: str) -> str:
    if value is None or not math.isfinite(value):
        return fixed(None, 0)
    if abs(value) >= 1e5:
        return f"{value:.2g}"
    return fixed(value, 0 if abs(value) >= 1000 else 1 if abs(value) >= 20 or unit == "%" else 2)


def _band(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{low:.4g} to {high:.4g}"
    return "" if low is None and high is None else f"≤ {high:g}" if low is None else f"≥ {low:g}"


def write_figures(path: Path, summary: Summary) -> None:
    """figures.csv: one row a figure, with all digits."""
    rows = summary["figures"]
    write_csv(path, tuple(rows[0]), (tuple(row.values()) for row in rows))
