"""Tables of a calibration, for the terminal and for the report: the same words and the same digits in both."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

from ...estimate.number_checks import PRIOR_ONLY
from ...estimate.reason import probability
from ...estimate.selection import Comparison
from ..plain import Summary
from ..scales import UNITS, axes_in, axes_in_words, caption, one_keys, size_keys
from ..tables import DASH, Cell, Table, decimals_among, decimals_of, fixed, percent, short
from .residuals import FEW

IMAGES_SHOWN = 12

_UNCONTROLLED = 0.1


def parameters(summary: Summary) -> Table:
    """The unknowns: prior, value and sigma in their unit, and what the data had to say."""
    rows = []
    for p in summary["parameters"]:
        decimals = decimals_of(p["sigma"])
        prior = DASH if p["prior_sigma"] is None else f"{short(p['prior_mean'], 6)} ± {short(p['prior_sigma'])}"
        share, away = p["data_share"], p["from_prior_sigmas"]
        rows.append(
            (
                Cell(p["name"]),
                Cell(p["unit"]),
                Cell(prior),
                Cell(fixed(p["value"], decimals)),
                Cell("∞" if p["sigma"] is None else fixed(p["sigma"], decimals), p["sigma"] is None),
                Cell(percent(share), share is not None and share < PRIOR_ONLY),
                Cell(DASH if away is None else fixed(away, 1), away is not None and abs(away) > 3),
            )
        )
    return Table(
        "Unknowns",
        ("unknown", "unit", "prior", "value", "± sigma", "from data", "shift"),
        (False, False, True, True, True, True, True),
        tuple(rows),
        "From data: share of the prior variance that the data removed; near 0 % the prior alone says it. "
        "Shift: (value − prior mean) / prior sigma.",
    )


def _by_place(rows: Sequence[Summary]) -> dict[tuple[Any, str, str], dict[str, Summary]]:
    """Statistics by (image, role, axis), each with its stages."""
    out: dict[tuple[Any, str, str], dict[str, Summary]] = {}
    for row in rows:
        out.setdefault((row["image"], row["role"], row["axis"]), {})[row["stage"]] = row
    return out


def shown_images(summary: Summary, limit: int = IMAGES_SHOWN) -> list[str]:
    """The images a table has room for, in the flight's order: all, or those with the largest residuals after.

    None where there are many and most have too few points for statistics of their own.
    """
    count: dict[str, int] = {}
    square: dict[str, float] = {}
    for row in summary["residuals"]:
        if row["image"] is not None and row["stage"] == "after":
            name, rms = row["image"], math.inf if row["rms_px"] is None else row["rms_px"]
            count[name] = count.get(name, 0) + row["n"]
            square[name] = square.get(name, 0.0) + row["n"] * rms**2
    if len(count) <= limit:
        return list(count)
    if statistics.median(count.values()) < 2 * FEW:  # each point counts on both axes
        return []
    keep = set(sorted(count, key=lambda name: -square[name] / count[name])[:limit])
    return [name for name in count if name in keep]


def residuals(summary: Summary, limit: int = IMAGES_SHOWN) -> Table:
    """Residuals in pixels for each image: control and check, before and after."""
    chosen = shown_images(summary, limit)
    total = summary["counts"]["images"]
    rows, breaks = [], []
    stats = _by_place(summary["residuals"])
    order = [None, *chosen] if total > 1 else chosen
    # A hundredth of a pixel; more where the residuals after are smaller than that.
    after_rms = [row["rms_px"] or 0.0 for row in summary["residuals"] if row["stage"] == "after"]
    finest = 2 if max(after_rms) >= 0.1 else decimals_of(max(after_rms))
    for image in order:
        for (name, role, axis), by_stage in stats.items():
            if name != image:
                continue
            before, after = by_stage["before"], by_stage["after"]
            first = axis == "x"
            figures = [
                Cell(fixed(stage[key], 2 if stage is before else finest))
                for stage in (before, after)
                for key in ("mean_px", "std_px", "max_abs_px")
            ]
            place = Cell(("all" if image is None else image) if first else "")
            names = Cell(role if first else ""), Cell(str(after["n"]) if first else ""), Cell(after["axis_name"])
            rows.append((place, *names, *figures))
        breaks.append(len(rows) - 1)
    left = f" {len(chosen)} of {total} images shown, those with the largest residuals; all are in statistics.csv."
    if not chosen:
        left = f" The {total} images have few points each; their own statistics are in statistics.csv."
    return Table(
        "Residuals (px), measured − projected",
        ("image", "role", "n", "axis", "before: mean", "before: std", "before: max", "after: mean", "after: std", "after: max"),
        (False, False, True, False, True, True, True, True, True, True),
        tuple(rows),
        f"{axes_in_words(summary)} Max: largest absolute value; check points took no part in the estimation."
        f"{left if len(chosen) < total else ''}",
        tuple(breaks[:-1]),
    )


def sizes(summary: Summary, limit: int = IMAGES_SHOWN) -> Table:
    """How large the residuals after are in every unit, for the images that are shown."""
    (x, y), columns = axes_in(summary), size_keys(summary)
    found: dict[tuple[str | None, str], dict[str, Summary]] = {}
    for row in summary["residuals"]:
        if row["stage"] == "after":
            found.setdefault((row["image"], row["role"]), {})[row["axis"]] = row
    chosen = shown_images(summary, limit)
    places = [place for place in found if place[0] in chosen or (place[0] is None and summary["counts"]["images"] > 1)]
    units = [(axis, unit) for axis in "xy" for unit in UNITS]
    of_place = [{f"rms_{axis}_{unit}": found[place][axis][f"rms_{unit}"] for axis, unit in units} for place in places]
    decimals = {"rms_x_px": 2, "rms_y_px": 2} | {key: 1 + decimals_among(of_place, key) for key in columns}
    return Table(
        "How large residuals are (RMS after)",
        ("image", "role", "n", f"px: {x}", f"px: {y}", *columns.values()),
        (False, False, *[True] * (1 + len(decimals))),
        tuple(
            (
                *(Cell("all" if image is None else image), Cell(role), Cell(str(found[image, role]["x"]["n"]))),
                *(Cell(fixed(rms[key], d)) for key, d in decimals.items()),
            )
            for (image, role), rms in zip(places, of_place, strict=True)
        ),
        caption(summary),
    )


def correlations(summary: Summary, limit: int = 15) -> Table | None:
    """Pairs of unknowns that the data can hardly tell apart; None where there are none."""
    strong = summary["correlation"]["strong"]
    if not strong:
        return None
    more = f" The {limit} strongest of {len(strong)} are shown." if len(strong) > limit else ""
    return Table(
        "Correlations above 0.9",
        ("unknown", "with", "correlation"),
        (False, False, True),
        tuple(
            (Cell(s["first"]), Cell(s["second"]), Cell(fixed(s["correlation"], 3), abs(s["correlation"]) > 0.95))
            for s in strong[:limit]
        ),
        "Above 0.95 only a combination of the two is determined: do not read either value by itself." + more,
    )


def largest(summary: Summary) -> Table:
    """The longest residuals, where a blunder would show."""
    (x, y), columns, found = axes_in(summary), one_keys(summary), summary["largest_residuals"]
    decimals = {key: 1 + decimals_among(found, key) for key in columns}
    return Table(
        "Largest residuals after",
        ("image", "point", "role", f"px: {x}", f"px: {y}", "px: length", *columns.values(), "weight"),
        (False, False, False, *[True] * (4 + len(columns))),
        tuple(
            (
                Cell(row["image"]),
                Cell(row["point"]),
                Cell(row["role"]),
                *(Cell(fixed(row[key], 2)) for key in ("x_px", "y_px", "length_px")),
                *(Cell(fixed(row[key], decimals[key])) for key in columns),
                Cell(fixed(row["weight"], 2)),
            )
            for row in found
        ),
        "Weight: what a robust loss left of the observation; 1 without one.",
    )


def blunders(summary: Summary, limit: int = 20) -> Table | None:
    """Control observations that were left out; None where there are none."""
    found = summary["blunders"]
    if not found:
        return None
    more = f" The {limit} largest of {len(found)} are shown; all are in results.json." if len(found) > limit else ""
    (x, y), keys = axes_in(summary), (("x_px", 2), ("y_px", 2), ("normalised_x", 1), ("normalised_y", 1))
    return Table(
        "Left out as blunders",
        ("image", "point", f"px: {x}", f"px: {y}", f"sigmas: {x}", f"sigmas: {y}"),
        (False, False, True, True, True, True),
        tuple((Cell(row["image"]), Cell(row["point"]), *(Cell(fixed(row[k], d)) for k, d in keys)) for row in found[:limit]),
        f"Measured − predicted by all the others.{more}",
    )


def detectable(summary: Summary, limit: int = IMAGES_SHOWN) -> Table:
    """How well the control points control one another, for the images that are shown."""
    chosen, names = shown_images(summary, limit), dict(zip("xy", axes_in(summary), strict=True))
    return Table(
        "Reliability",
        (
            "image",
            "axis",
            "n",
            "redundancy: mean",
            "redundancy: min",
            "detectable error (px): median",
            "detectable error (px): max",
        ),
        (False, False, True, True, True, True, True),
        tuple(
            (
                Cell(row["image"]),
                Cell(names[row["axis"]]),
                Cell(str(row["n"])),
                Cell(fixed(row["redundancy_mean"], 2)),
                Cell(fixed(row["redundancy_min"], 2), (row["redundancy_min"] or 0.0) < _UNCONTROLLED),
                Cell(fixed(row["detectable_median_px"], 2)),
                Cell(fixed(row["detectable_max_px"], 2)),
            )
            for row in summary["detectable"]
            if row["image"] in chosen
        ),
        "Redundancy: the share of an error that shows in the measurement's own residual. Detectable: what a test at 0.1 % finds "
        "four times in five (Baarda 1968).",
    )


def models(comparison: Comparison) -> Table:
    """Candidate models side by side, and which one is recommended."""
    return Table(
        "Which model",
        ("model", "unknowns", "cost", "saved", "by chance", "AIC", "BIC", "check points: RMS (px)", "check points: log density"),
        (False, True, True, True, True, True, True, True, True),
        tuple(
            (
                Cell(c.name, c.name == comparison.recommended),
                Cell(str(c.unknowns)),
                Cell(fixed(c.cost, 1)),
                Cell(fixed(c.ratio, 1)),
                Cell(DASH if math.isnan(c.tail) else probability(c.tail)),
                Cell(fixed(c.aic, 1)),
                Cell(fixed(c.bic, 1)),
                Cell(DASH if math.isnan(c.check_rms_px) else fixed(c.check_rms_px, 2)),
                Cell(DASH if math.isnan(c.check_log_density) else fixed(c.check_log_density, 2)),
            )
            for c in comparison.candidates
        ),
        f"Recommended: {comparison.recommended}. {comparison.reason}. Cost: squared whitened residuals and priors; saved and "
        "by chance: likelihood ratio against the smallest model; AIC and BIC above the best.",
    )
