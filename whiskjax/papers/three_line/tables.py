"""Wang et al. (2018) as tables: paper, nominal, paper-like and band side by side."""

import math
from pathlib import Path

import numpy as np

from ...estimate.map_limits import PROFILE
from ...show.plain import Summary, versions
from ...show.sheets import write_csv
from ...show.tables import Cell, Table, fixed
from ..figure import Figure
from .printed import PRINTED, TABLE_3, band
from .runs import NOISES, SCALE, TERRAIN, Measured, Sizes, limited
from .study import MOUNTS, TRUE_MOUNTS

TITLE = "Wang et al. (2018) reproduced: block adjustment of a three-line camera"
_STATISTICS = ("largest", "smallest", "mean", "rmse")
_TITLES = {
    1: "Table 1. Data set A: direct positioning, adjustment and calibration",
    2: "Table 2. Data set B: the same",
    4: "Table 4. Direct positioning with the mean of A's and B's numbers",
    5: "Table 5. Data set A adjusted again with few control points",
    6: "Table 6. Data set B adjusted again with few control points",
}
_NOTES = {
    1: "Metres; errors are found − given. Direct positioning: every point and strip; adjusted: check points. Second: calibrated "
    "detector lines, lever arm and boresight zero, POS as recorded; third: all calibrated numbers. p-like: paper-like. Other: "
    "an independent implementation, nominal. The band is of the nominal RMSE.",
    2: "As Table 1.",
    4: "Lever arm, boresight and detector lines: the mean of what A and B gave.",
    5: "The mean numbers of Table 4 are held; POS corrections and points are adjusted. Control points are spread over the field, "
    "the others become tie points; the check points took no part in the calibration either.",
    6: "As Table 5.",
}
_BEYOND = {
    "lever arm and boresight": "Blocks with fewer ties, 4 s orientation images. Of n seeds the RMS itself is known to 1/√(2n) "
    "only. u and w are told from boresight and lens scale by the relief alone, which magnifies what is in no sigma: vibration, "
    "POS errors between orientation images, the wave of the detector. Where the truth has none of them (matching) it is near 1; "
    "sigmas from the data (reweigh) are larger.",
    "spline": "Data set B, full size. 0.35 s was chosen after 1, 0.5, 0.35 and 0.25 s had been tried on the first of these "
    "flights. The camera's attitude is the exterior orientation, which images see; the body's holds a "
    "constant besides that only POS tells from the boresight, and no choice of basis can make smaller.",
    "wrong ties": "Data set A; one ray of 5 % of the tie points moves by up to ±20 px in sample and line (uniform: one move in a "
    "hundred is below 2 px both ways). A point counts as found when it lost a ray.",
    "honest covariance": "Data set A. Matching: cubic detector lines, POS errors of orientation images; rough: as flown, with "
    "vibration, what POS errors do between orientation images, and the wave of the detector.",
    "weights": "Data set A, matching truth. Sigmas given 3 times too large (ties, POS) or too small (points).",
    "two-step": "Data set B. Distances are the largest of the six mounts', in predicted sigmas of the joint solution.",
}  # fmt: skip


def summarise(measured: Measured, sizes: Sizes, seed: int, command: str) -> Summary:
    """Everything that is printed or written, as plain data; names end in their unit."""
    rows = [row for trial in PRINTED for row in _rows(measured, trial)]
    figures = [f.as_row() for f in measured.figures]
    banded = [*(r["is_inside"] for r in rows), *(f["is_inside"] for f in figures)]
    outside = [_said_row(r) for r in rows if r["is_inside"] is False]
    outside += [_said(f) for f in measured.figures if f.has_band and not f.is_inside]
    return {
        "title": TITLE,
        "command": command,
        "verdict": {
            "is_inside": not outside,
            "word": "as the bands ask" if not outside else "not in every band",
            "bands": sum(b is not None for b in banded),
            "bands_inside": sum(b is True for b in banded),
            "outside": outside,
        },
        "runs": sizes._asdict() | {"seed": seed},
        "rows": rows,
        "mounts": _mounts(measured),
        "limits": _limits(measured),
        "figures": figures,
        "versions": versions("jax", "numpy"),
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _rows(measured: Measured, row) -> list[Summary]:
    """One for each axis."""
    out = []
    for axis, printed in enumerate(PRINTED[row]):
        found = {noise: measured.rows[row, noise][axis] for noise in NOISES}
        asked, rmse = band(row, axis), found["nominal"].rmse
        inside = None if asked.low is None or asked.high is None else bool(asked.low <= rmse <= asked.high)
        out.append(
            row._asdict()
            | {"axis": "XYZ"[axis], "count": found["nominal"].count}
            | {f"paper_{name}_m": value for name, value in zip(_STATISTICS, printed, strict=True)}
            | {f"{_key(noise)}_{name}_m": _finite(getattr(found[noise], name)) for noise in NOISES for name in _STATISTICS}
            | {f"{name}_m": value for name, value in asked._asdict().items()}
            | {"is_inside": inside}
        )
    return out


def _key(noise: str) -> str:
    return noise.replace("-", "_")


def _mounts(measured: Measured) -> list[Summary]:
    factor = np.r_[np.ones(3), np.full(3, math.degrees(1.0))]
    out = []
    for i, name in enumerate(MOUNTS):
        unit, scale = ("m", "deg")[i > 2], float(factor[i])
        entry: Summary = {"name": name, "unit": unit, "true": float(TRUE_MOUNTS[i]) * scale}
        for data, values in TABLE_3.items():
            entry[f"paper_{data}"] = values[i]
            for noise in NOISES:
                found = measured.mounts[data, noise]
                entry[f"{_key(noise)}_{data}"] = float(found.value[i]) * scale
                entry[f"{_key(noise)}_{data}_sigma"] = float(found.sigma[i]) * scale
        out.append(entry)
    return out


def _limits(measured: Measured) -> list[Summary]:
    """Tables 5 and 6 with the most control points against the limits of the scale."""
    limit, out = PROFILE.limits[SCALE, TERRAIN], []
    for row in PRINTED:
        if row.table in (5, 6) and row.trial == "11 control":
            for who in ("paper", *NOISES):
                axes = [p[3] for p in PRINTED[row]] if who == "paper" else [s.rmse for s in measured.rows[row, who]]
                found = limited((axes[0], axes[1], axes[2]))
                fits = found.fits
                out.append(
                    {"data": row.data, "who": who, **found._asdict(), "planimetry_fits": fits[0], "height_fits": fits[1]}
                    | {"planimetry_limit_m": limit.planimetry_m, "height_limit_m": limit.height_m}
                )
    return out


def tables(summary: Summary) -> tuple[Table, ...]:
    """Tables 1 to 6 in order, the limits, and what is beyond the paper."""
    found = [_table(number, summary) for number in (1, 2)] + [_table_3(summary)]
    found += [_table(number, summary) for number in (4, 5, 6)] + [_limit_table(summary)]
    return (*found, *(_beyond(section, summary) for section in _BEYOND))


def _table(number: int, summary: Summary) -> Table:
    rows, breaks, last = [], [], None
    for r in (r for r in summary["rows"] if r["table"] == number):
        first = (r["data"], r["trial"]) != last
        if first and rows:
            breaks.append(len(rows) - 1)
        last = (r["data"], r["trial"])
        trial = r["trial"] if number != 4 else f"data set {r['data']}"
        verdict = "" if r["is_inside"] is None else "inside" if r["is_inside"] else "OUTSIDE"
        figures = [fixed(r[f"{who}_{name}_m"], 3) for who in _WHO for name in _STATISTICS]
        asked = _range(r["low_m"], r["high_m"])
        cells = (trial if first else "", r["axis"], *figures, fixed(r["independent_m"], 3), asked)
        rows.append((*map(Cell, cells), Cell(verdict, verdict == "OUTSIDE")))
    heads = [f"{who}: {name}" for who in _WHO.values() for name in ("max", "min", "mean", "RMSE")]
    return Table(
        _TITLES[number],
        ("", "", *heads, "other: RMSE", "band", ""),
        (False, False, *(True,) * 14, False),
        tuple(rows),
        _NOTES[number],
        tuple(breaks),
    )


_WHO = {"paper": "paper", "nominal": "nominal", "paper_like": "p-like"}  # in as little room as it takes


def _table_3(summary: Summary) -> Table:
    rows, breaks = [], []
    for m in summary["mounts"]:
        digits = 3 if m["unit"] == "m" else 4
        for data in TABLE_3:
            cells = [m["name"] if data == "A" else "", m["unit"] if data == "A" else "", data, fixed(m[f"paper_{data}"], digits)]
            cells.append(fixed(m["true"], digits))
            for noise in NOISES:
                value, sigma = m[f"{_key(noise)}_{data}"], m[f"{_key(noise)}_{data}_sigma"]
                cells += [fixed(value, digits), fixed(sigma, digits), fixed((value - m["true"]) / sigma, 1)]
            rows.append(tuple(map(Cell, cells)))
        breaks.append(len(rows) - 1)
    heads = [f"{noise}: {what}" for noise in NOISES for what in ("value", "± sigma", "off (sigmas)")]
    return Table(
        "Table 3. Lever arm and boresight",
        ("", "", "data", "paper", "true", *heads),
        (False, False, False, *(True,) * 8),
        tuple(rows),
        "True: the mean of the paper's A and B. Sigma: predicted by the adjustment. Off: (value − true) / sigma of this one "
        "seed.",
        tuple(breaks[:-1]),
    )


def _limit_table(summary: Summary) -> Table:
    rows = []
    for r in summary["limits"]:
        cells = [Cell(r["data"]), Cell(r["who"])]
        for what in ("planimetry", "height"):
            fits = r[f"{what}_fits"]
            cells += [
                Cell(fixed(r[f"{what}_m"], 3)),
                Cell(fixed(r[f"{what}_limit_m"], 2)),
                Cell("meets" if fits else "misses", not fits),
            ]
        rows.append(tuple(cells))
    return Table(
        f"Against the limits for 1:{SCALE}, {TERRAIN} ground (11 control points)",
        ("data", "", "planimetry: RMSE (m)", "planimetry: limit (m)", "", "height: RMSE (m)", "height: limit (m)", ""),
        (False, False, True, True, False, True, True, False),
        tuple(rows),
        f"{PROFILE.name}. Planimetry: root of the sum of the squares of X and Y.",
    )


def _beyond(section: str, summary: Summary) -> Table:
    rows = []
    for f in (f for f in summary["figures"] if f["section"] == section):
        verdict = "" if f["is_inside"] is None else "inside" if f["is_inside"] else "OUTSIDE"
        cells = (f["what"], _unit(f["unit"]), _range(f["low"], f["high"]), _reached(f["reached"], f["unit"]))
        rows.append((*map(Cell, cells), Cell(verdict, verdict == "OUTSIDE")))
    heads = ("figure", "unit", "band", "here", "")
    return Table(f"Beyond the tables: {section}", heads, (False, False, True, True, False), tuple(rows), _BEYOND[section])


def _said_row(r: Summary) -> str:
    rmse, asked = fixed(r["nominal_rmse_m"], 3), _range(r["low_m"], r["high_m"])
    return f"Table {r['table']}, {r['trial']}, {r['axis']}: RMSE {rmse} m, band {asked}"


def _said(f: Figure) -> str:
    reached = f"{_reached(f.reached, f.unit)} {_unit(f.unit)}".rstrip()
    return f"{f.section}, {f.what}: {reached}, band {_range(f.low, f.high)}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _reached(value: float | None, unit: str) -> str:
    if value is None or not math.isfinite(value):
        return fixed(None, 0)
    if value != 0 and abs(value) < 1e-4:
        return f"{value:.1e}".replace("-", "−")
    if unit == "1" and value == round(value):
        return fixed(value, 0)
    return fixed(value, {"m": 3, "deg": 5, "%": 2, "s": 0}.get(unit, 3))


def _range(low: float | None, high: float | None) -> str:
    if low is not None and high is not None and low > 0:
        return f"{low:g} to {high:g}"
    return "" if low is None and high is None else f"≥ {low:g}" if high is None else f"≤ {high:g}"


def write_tables(folder: Path, summary: Summary) -> None:
    """tables.csv, table_3.csv, limits.csv and figures.csv: one row a figure or axis, with all digits."""
    for name, key in (("tables", "rows"), ("table_3", "mounts"), ("limits", "limits"), ("figures", "figures")):
        rows = summary[key]
        write_csv(folder / f"{name}.csv", tuple(rows[0]), (tuple(row.values()) for row in rows))
