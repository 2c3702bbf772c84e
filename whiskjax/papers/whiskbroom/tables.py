"""The paper's tables with the simulation beside them: for the terminal, the report and CSV files."""

from collections.abc import Callable
from pathlib import Path

from ...show.plain import Summary
from ...show.sheets import write_csv
from ...show.tables import Cell, Table, fixed, percent
from .printed import TABLES, Column, Printed
from .study import Study
from .summary import label

_LETTER = {"A": {"L1": "A (L1)", "R2": "B (R2)", "L2": "C (L2)"}}
_SHORT = {"focal length": "f", "image noise": "noise", "drift": "drift"}
_PARAMETER_TITLES = {
    1: "Table 1. Parameters from the left image A (L1): 12 unknowns",
    4: "Table 4. Parameters from L1 and R1: 15 unknowns",
}
_AGREEMENT = (
    "Agreement: T rests on what was tuned to the paper; it follows; or the paper's figure differs from 5 to 95 % of the seeds."
)
_DECIMALS = {"m": 3, "deg": 4}
_FIGURE_KEYS = (
    "table", "image", "parameters", "points", "statistic", "axis", "is_absolute", "unit", "paper", "median", "low_5", "high_95",
    "representative", "paper_in_range", "band_low", "band_high", "is_inside", "seeds_in_band",
)  # fmt: skip
_PARAMETER_KEYS = (
    "name", "is_combination", "unit", "paper", "truth", "representative", "sigma", "median", "low_5", "high_95", "data_share",
)  # fmt: skip


def in_order(summary: Summary) -> list[Table]:
    """Tables 1 to 7 in the paper's form; Table 7 is one table for each image."""
    drawn = [(printed.number, residuals(summary, printed)) for printed in TABLES]
    drawn += [(number, parameters(summary, number)) for number in _PARAMETER_TITLES]
    return [table for _, table in sorted(drawn, key=lambda pair: pair[0])]


def parameters(summary: Summary, number: int) -> Table:
    """Table 1 or 4: the paper's estimate, the simulation's truth, one seed and all seeds, and what the data had to say."""
    rows, breaks = [], []
    for p in summary["parameters"][str(number)]:
        if p["is_combination"] and not breaks:
            breaks = [len(rows) - 1]
        decimals = _DECIMALS[p["unit"]]
        rows.append(
            (
                Cell(f"{p['name'].replace('-', '−')} ({p['unit']})"),
                *(Cell(fixed(p[key], decimals)) for key in ("paper", "truth", "representative", "sigma", "median")),
                Cell(_range(p["low_5"], p["high_95"], decimals)),
                Cell(percent(p["data_share"]), p["data_share"] < 0.5),
            )
        )
    k = summary["seeds"]["representative"]
    return Table(
        _PARAMETER_TITLES[number],
        (
            *("parameter", "paper", "truth here"),
            *(f"seed {k}: value", f"seed {k}: ± sigma", "seeds: median", "seeds: 5 to 95 %", "from data"),
        ),
        (False, True, True, True, True, True, True, True),
        tuple(rows),
        "The truth of the simulation is the paper's Table 4. From data: share of the prior variance that the data removed; where "
        "it is small (coloured) the estimate is the prior's and no figure to compare. Below the line: combinations that the data "
        "determine.",
        tuple(breaks),
    )


def residuals(summary: Summary, printed: Printed) -> Table:
    """A table of residuals in the paper's form, with what was measured, the band and the verdict under each printed figure."""
    rows: list[tuple[Cell, ...]] = []
    breaks = []
    for statistic, name in (("mean", "mean"), ("std", "std")):
        shown = [_of(summary, printed, column, statistic, axis) for column in printed.columns for axis in "xy"]
        lines: list[tuple[str, Callable[[Summary], Cell]]] = [
            ("paper", lambda f: Cell(fixed(f["paper"], 2))),
            ("here, median", lambda f: Cell(fixed(f["median"], 2))),
            ("5 to 95 %", lambda f: Cell(_range(f["low_5"], f["high_95"]))),
        ]
        if any(f["is_inside"] is not None for f in shown):
            lines += [
                ("band", lambda f: Cell("" if f["band_low"] is None else _range(f["band_low"], f["band_high"]))),
                ("verdict", _verdict),
            ]
        lines.append(("agreement", _agreement))
        for i, (what, cell) in enumerate(lines):
            rows.append((Cell(name if i == 0 else ""), Cell(what), *(cell(f) for f in shown)))
        breaks.append(len(rows) - 1)
    heads = [f"{_heading(column)}: {axis}" for column in printed.columns for axis in "xy"]
    folded = (
        " Means of check points are absolute values, as the band is." if any(c.points == "check" for c in printed.columns) else ""
    )
    return Table(
        f"Table {printed.number}. {printed.title} (px)",
        ("", "", *heads),
        (False, False, *(True for _ in heads)),
        tuple(rows),
        f"Mean and standard deviation (std); x along the detector, y along the swing. {_AGREEMENT}{folded}",
        tuple(breaks[:-1]),
    )


def bands(summary: Summary) -> Table:
    """Every figure that has a band, once."""
    rows, seen = [], set()
    for f in reversed(summary["figures"]):  # Table 6 before Table 2, which repeats it with a wrong sign
        if f["is_inside"] is None or label(f) in seen:
            continue
        seen.add(label(f))
        low, high = f["low_5"], f["high_95"]
        rows.append(
            (
                Cell(f"{f['table']}"),
                Cell(label(f)),
                Cell(fixed(f["paper"], 2)),
                Cell(fixed(f["median"], 2)),
                Cell(_range(low, high)),
                Cell(_range(f["band_low"], f["band_high"])),
                _verdict(f),
                Cell(percent(f["seeds_in_band"])),
                _agreement(f),
            )
        )
    return Table(
        "Figures with a band (px)",
        ("table", "figure", "paper", "here: median", "here: 5 to 95 %", "band", "verdict", "in band", "agreement"),
        (True, False, True, True, True, True, False, True, False),
        tuple(reversed(rows)),
        f"Inside: the median over the seeds lies in the band. In band: share of the seeds. {_AGREEMENT}",
    )


def swings(summary: Summary) -> Table:
    """How the data alone tell pairs of parameters apart when the points reach further to the sides."""
    found = summary["correlation_by_scan"]
    return Table(
        "Correlation against the swing, without priors",
        ("parameter", "with", *(f"points to: ±{scan}°" for scan in found["scan_deg"])),
        (False, False, *(True for _ in found["scan_deg"])),
        tuple((Cell(p["first"]), Cell(p["second"]), *(Cell(fixed(c, 5)) for c in p["correlation"])) for p in found["pairs"]),
        "12 unknowns from one left image with a regular grid of points, from the derivatives at the truth; median over the first "
        f"{found['seeds']} seeds.",
    )


def write_sheets(folder: Path, summary: Summary) -> None:
    """table_1.csv to table_7.csv: one row a figure, with all digits."""
    for number in _PARAMETER_TITLES:
        rows = ([p[key] for key in _PARAMETER_KEYS] for p in summary["parameters"][str(number)])
        write_csv(folder / f"table_{number}.csv", _PARAMETER_KEYS, rows)
    for number in sorted({printed.number for printed in TABLES}):
        chosen = [f for f in summary["figures"] if f["table"] == number]
        rows = ([*(f[key] for key in _FIGURE_KEYS), " and ".join(f["tuned_by"])] for f in chosen)
        write_csv(folder / f"table_{number}.csv", (*_FIGURE_KEYS, "tuned_by"), rows)


def write_seeds(path: Path, study: Study) -> None:
    """seeds.csv: every figure of Tables 2 to 7 for every seed, signed, with all digits."""
    columns = dict.fromkeys(column for printed in TABLES for column in printed.columns)
    rows = (
        [seed, *column, statistic, axis, float(values[i, a])]
        for column in columns
        for statistic in ("mean", "std")
        for values in [study.statistic(column, statistic)]
        for i, seed in enumerate(study.seeds)
        for a, axis in enumerate("xy")
    )
    write_csv(path, ("seed", *Column._fields, "statistic", "axis", "value_px"), rows)


def _of(summary: Summary, printed: Printed, column: Column, statistic: str, axis: str) -> Summary:
    wanted = {"table": printed.number, **column._asdict(), "statistic": statistic, "axis": axis}
    (row,) = (f for f in summary["figures"] if wanted.items() <= f.items())
    return row


def _heading(column: Column) -> str:
    if column.parameters == "A" and column.image != "L1":
        return f"image {_LETTER['A'][column.image]}"
    if column.parameters in ("none", "A"):
        return "before" if column.parameters == "none" else "after"
    return column.parameters if column.points == "all" else f"after, {column.points}"


def _range(low: float, high: float, decimals: int | None = None) -> str:
    """Two ends; a decimal less where they are long."""
    if decimals is None:
        decimals = 1 if max(abs(low), abs(high)) >= 20 else 2
    return f"{fixed(low, decimals)}…{fixed(high, decimals)}"


def _verdict(figure: Summary) -> Cell:
    if figure["is_inside"] is None:
        return Cell("")
    return Cell("inside" if figure["is_inside"] else "OUTSIDE", not figure["is_inside"])


def _agreement(figure: Summary) -> Cell:
    if not figure["paper_in_range"]:
        return Cell("differs")
    return Cell("T " + "+".join(_SHORT[t] for t in figure["tuned_by"]) if figure["tuned_by"] else "follows")
