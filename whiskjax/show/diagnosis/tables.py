"""Tables of a diagnosis, for the terminal and for the report, and as CSV."""

from pathlib import Path

from ...doctor.diagnosis import NOISE
from ..plain import Summary
from ..sheets import write_csv
from ..tables import Cell, Table, fixed, short

_COLUMNS = (
    "place", "name", "median_residual_before_px", "median_residual_after_px", "factor", "chi_square", "degrees_of_freedom",
    "cost", "value", "value_sigma", "unit", "change",
)  # fmt: skip

_HEADINGS = ("place", "what", "median px: before", "median px: after", "times: noise", "chi-: square", "value")


def findings(summary: Summary) -> Table | None:
    """What was found, the best first; None where nothing could be tried."""
    rows = summary["findings"]
    if not rows:
        return None
    last = [i for i, row in enumerate(rows) if i + 1 < len(rows) and rows[i + 1]["place"] != row["place"]]
    return Table(
        "What explains the data",
        _HEADINGS,
        (True, False, True, True, True, True, True),
        tuple(
            (
                Cell(str(row["place"])),
                Cell(row["name"]),
                Cell(short(row["median_residual_before_px"])),
                Cell(short(row["median_residual_after_px"])),
                Cell(short(row["factor"], 3), row["factor"] is None or row["factor"] > NOISE),
                Cell(short(row["chi_square"], 5)),
                Cell("" if row["value"] is None else f"{_value(row)} {row['unit']}"),
            )
            for row in rows
        ),
        "Each line is the flight with one thing changed: residuals at its start values and after a robust fit of its unknowns. "
        "What shares a place the data do not tell apart.",
        tuple(last),
    )


def _value(row: Summary) -> str:
    sigma = row["value_sigma"]
    return short(row["value"], 6) + ("" if sigma is None else f" ± {short(sigma, 2)}")


def changes(summary: Summary) -> Table | None:
    """What to change for those in the first place; None where the flight is best as given."""
    rows = [row for row in summary["findings"] if row["place"] == 1]
    if not rows or any(row["name"] == "as given" for row in rows):
        return None
    return Table(
        "What to change",
        ("what", "why", "change"),
        (False, False, False),
        tuple((Cell(row["name"]), Cell(row["sentence"]), Cell(row["change"])) for row in rows),
        "One of these, not all of them.",
    )


def write_findings(path: Path, summary: Summary) -> None:
    """findings.csv: one row a finding, with what to change."""
    write_csv(path, _COLUMNS, ([row[key] for key in _COLUMNS] for row in summary["findings"]))


def head(summary: Summary) -> list[str]:
    """What was looked at, in words."""
    counts = summary["counts"]
    return [
        f"{counts['measurements']} measurements of points with coordinates; {counts['tried']} changes tried one by one"
        + (f", {fixed(counts['refused'], 0)} of them impossible here" if counts["refused"] else "")
    ]
