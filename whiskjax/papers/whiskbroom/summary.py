"""The study of Jin et al. (2024) as plain data: every figure that is printed, drawn or written comes from this one place.

As in a calibration's summary: dicts, lists, strings, booleans and floats; None where there is no figure; names end in their unit.
A figure over the seeds is the median with the 5 % and 95 % quantiles.
"""

from collections.abc import Mapping

import numpy as np

from ...estimate.many import Batch
from ...flights.haian import FOCAL_PX, HALF_LINE_PX, SCENES
from ...show.plain import Summary, versions
from .answers import Answers
from .printed import BANDS, TABLE_1, TABLE_4, TABLES, Column, Printed, is_absolute, tuned_by
from .study import SCANS_DEG, Study, correlation_by_scan, mean_x_gap

# What the data determine: combinations of unknowns, by their weights.
_COMBINATIONS: dict[str, Mapping[str, int]] = {
    "omega_pos_left + omega_sen": {"omega_pos_left": 1, "omega_sen": 1},
    "omega_pos_right + omega_sen": {"omega_pos_right": 1, "omega_sen": 1},
    "omega_pos left - right": {"omega_pos_left": 1, "omega_pos_right": -1},
    "phi_pos left - right": {"phi_pos_left": 1, "phi_pos_right": -1},
    "kappa_pos left - right": {"kappa_pos_left": 1, "kappa_pos_right": -1},
}
_FEW_SEEDS = 20  # for what hardly varies with the seed


def summarise(study: Study, answers: Answers | None = None, command: str = "") -> Summary:
    """Everything worth telling about the study.

    **Arguments:** `answers`: to what the paper leaves open; `command`: how it was made, for the reader who wants to repeat it.
    """
    figures = [row for table in TABLES for row in _figures(study, table)]
    data: Summary = {
        "title": "Jin et al. (2024) reproduced: a whiskbroom scanner that swings left and right",
        "command": command,
        "verdict": {},
        "units": {
            "residuals": "px, measured - projected; x along the detector (flight direction), y along the swing",
            "parameters": "each in its own unit",
            "over the seeds": "median, 5 % and 95 % quantile",
            "data_share": "1 - sigma^2 / prior_sigma^2: the part of the prior variance that the data removed",
        },
        "seeds": {
            "first": min(study.seeds),
            "count": len(study.seeds),
            "representative": study.seeds[study.representative],
        },
        "simulation": {
            "focal_px": FOCAL_PX,
            "half_line_px": HALF_LINE_PX,
            "noise_px": {name: {"x": scene[3], "y": scene[4]} for name, scene in SCENES.items()},
        },
        "parameters": {"1": _parameters(study, study.left, TABLE_1), "4": _parameters(study, study.both, TABLE_4)},
        "figures": figures,
        "focal_asked_px": _focal_asked(figures),
        "mean_x_by_half_px": [_by_half(study, name) for name in ("L1", "R1")],
        "mean_x_gap_px": [_gap(study, scan_first) for scan_first in (True, False)],
        "correlation_by_scan": {
            "scan_deg": list(SCANS_DEG),
            "seeds": len(study.seeds[:_FEW_SEEDS]),
            "pairs": [
                {"first": first, "second": second, "correlation": np.median(values, axis=0).tolist()}
                for (first, second), values in correlation_by_scan(study.seeds[:_FEW_SEEDS]).items()
            ],
        },
        "versions": versions("jax", "numpy"),
    }
    data["open_questions"] = [] if answers is None else [f.as_row() for f in answers.figures()]
    data["verdict"] = _verdict(figures, data["open_questions"])
    return data


def _over_seeds(values: np.ndarray) -> dict[str, float]:
    low, median, high = np.percentile(values, [5, 50, 95])
    return {"median": float(median), "low_5": float(low), "high_95": float(high)}


def _figures(study: Study, table: Printed) -> list[Summary]:
    """One row for each figure of a table of residuals."""
    rows = []
    for k, column in enumerate(table.columns):
        for statistic, printed in (("mean", table.mean_px), ("std", table.std_px)):
            found = study.statistic(column, statistic)
            rows += [
                _figure(study, table, column, statistic, axis, printed[2 * k + a], found[:, a]) for a, axis in enumerate("xy")
            ]
    return rows


def _figure(study: Study, table: Printed, column: Column, statistic: str, axis: str, paper: float, values: np.ndarray) -> Summary:
    absolute = is_absolute(column, statistic)
    paper, values = (abs(paper), np.abs(values)) if absolute else (paper, values)
    over = _over_seeds(values)
    band = BANDS.get((column, statistic, axis))
    inside = None if band is None else bool(band.low <= over["median"] <= band.high)
    return {
        "table": table.number,
        **column._asdict(),
        "statistic": statistic,
        "axis": axis,
        "is_absolute": absolute,
        "unit": "px",
        "paper": paper,
        **over,
        "representative": float(values[study.representative]),
        "paper_in_range": bool(over["low_5"] <= paper <= over["high_95"]),
        "band_low": None if band is None else band.low,
        "band_high": None if band is None else band.high,
        "is_inside": inside,
        "seeds_in_band": None if band is None else float(np.mean((band.low <= values) & (values <= band.high))),
        "tuned_by": list(tuned_by(column, statistic, axis)),
    }


def _parameters(study: Study, batch: Batch, paper: Mapping[str, float]) -> list[Summary]:
    """One row for each unknown, then for each combination of them that the data determine."""
    names = [x.name for x in batch.unknowns]
    single = {name: {name: 1} for name in names}
    joined = {name: weights for name, weights in _COMBINATIONS.items() if weights.keys() <= set(names)}
    prior = np.array([x.size for x in batch.unknowns])
    rows = []
    for name, weights in {**single, **joined}.items():
        w = np.array([weights.get(n, 0) for n in names], dtype=float)
        unit, factor = batch.unknowns[names.index(next(iter(weights)))].unit
        sigma = np.sqrt(np.einsum("i,nij,j->n", w, batch.estimate.covariance, w))
        values, k = batch.value @ w, study.representative
        rows.append(
            {
                "name": name,
                "is_combination": name in joined,
                "unit": unit,
                "paper": sum(paper[n] * f for n, f in weights.items()),
                "truth": sum(TABLE_4[n] * f for n, f in weights.items()),
                "representative": float(values[k] * factor),
                "sigma": float(sigma[k] * factor),
                **_over_seeds(values * factor),
                "data_share": float(np.median(1 - sigma**2 / np.sum((w * prior) ** 2))),
            }
        )
    return rows


def _focal_asked(figures: list[Summary]) -> list[Summary]:
    """The focal length with which the simulation's mean before would be the paper's: a mean is proportional to it."""
    rows = []
    for image in SCENES:
        for axis in "xy":
            key = (image, "none", "mean", axis)
            # Table 2 prints L1 with the wrong sign; Table 6 has it right and comes later.
            row = [f for f in figures if (f["image"], f["parameters"], f["statistic"], f["axis"]) == key][-1]
            asked = {name: FOCAL_PX * row["paper"] / row[name] for name in ("median", "low_5", "high_95")}
            low, high = sorted((asked["low_5"], asked["high_95"]))
            rows.append({"image": image, "axis": axis, "median": asked["median"], "low_5": low, "high_95": high})
    return rows


def _by_half(study: Study, image: str) -> Summary:
    """Mean x before of the points of the first and of the second half of the swing."""
    x = study.residual_px(Column(image, "none", "control"))[:, :, 0]
    half = x.shape[1] // 2
    return {"image": image, "first": _over_seeds(x[:, :half].mean(axis=1)), "second": _over_seeds(x[:, half:].mean(axis=1))}


def _gap(study: Study, scan_first: bool) -> Summary:
    order = "Rx(scan) Ry(pitch)" if scan_first else "Ry(pitch) Rx(scan)"
    seeds = study.seeds[:_FEW_SEEDS]
    return {"order": order, "seeds": len(seeds), **_over_seeds(mean_x_gap(seeds, scan_first))}


def _verdict(figures: list[Summary], answers: list[Summary]) -> Summary:
    # Table 2 repeats figures of Table 6: each counts once.
    banded = {label(f): f for f in figures if f["is_inside"] is not None}
    free = {label(f): f for f in figures if f["is_inside"] is None}
    outside = [name for name, f in banded.items() if not f["is_inside"]]
    asked = [row for row in answers if row["is_inside"] is not None]
    missed = [f"{row['section']}: {row['what']}" for row in asked if not row["is_inside"]]
    return {
        "is_inside": not outside and not missed,
        "word": "inside its bands" if not outside else "outside its bands",
        "open_asked": len(asked),
        "open_met": len(asked) - len(missed),
        "open_missed": missed,
        "bands": len(banded),
        "bands_inside": len(banded) - len(outside),
        "outside": outside,
        "without_band": len(free),
        "without_band_paper_in_range": sum(f["paper_in_range"] for f in free.values()),
        "without_band_outside": [name for name, f in free.items() if not f["paper_in_range"]],
    }


def label(figure: Summary) -> str:
    """A figure by its names: "L2 CR, mean y"; points that stood aside are called "check"."""
    stage = "before" if figure["parameters"] == "none" else figure["parameters"]
    points = " check" if figure["points"] == "check" else ""
    statistic = f"|{figure['statistic']}|" if figure["is_absolute"] else figure["statistic"]
    return f"{figure['image']}{points} {stage}, {statistic} {figure['axis']}"
