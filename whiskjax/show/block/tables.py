"""Tables of an adjusted block, for the terminal and for the report."""

from ...estimate.number_checks import PRIOR_ONLY
from ..plain import Summary
from ..scales import axes_in, axes_in_words, caption, one_keys, size_keys
from ..tables import Cell, Table, decimals_among, decimals_of, fixed, percent, short, weights

_LEFT_OUT_SHOWN = 20


def all_tables(summary: Summary) -> list[Table]:
    """In the order in which they are read; those without rows are left out."""
    made = (
        counts(summary),
        statistics(summary),
        standard(summary),
        unknowns(summary),
        corrections(summary),
        weights(summary),
        residuals(summary),
        sizes(summary),
        point_sigmas(summary),
        left_out(summary),
        largest(summary),
    )
    return [table for table in made if table is not None]


def counts(summary: Summary) -> Table:
    """Points and rays by role."""
    found = summary["counts"]
    roles = [role for role in found["rays"] if role == "all" or found["points"][role]]
    return Table(
        "The block",
        ("role", "points", "rays"),
        (False, True, True),
        tuple((Cell(role), Cell(str(found["points"][role])), Cell(str(found["rays"][role]))) for role in roles),
        f"In {found['images']} images"
        + (f" of {len(found['strips'])} strips: {', '.join(found['strips'])}." if found["strips"] else ".")
        + " Rays of check points take part; their coordinates do not.",
    )


def statistics(summary: Summary) -> Table | None:
    """Max, min, mean and RMSE of coordinates by axis; None without points that have any."""
    found = summary["statistics"]
    if not found:
        return None
    decimals = 4 if min(row["rmse_m"] or 0.0 for row in found) < 0.005 else 3
    rows = tuple(
        (
            Cell(row["what"] if row["axis"] == "east" else ""),
            Cell(str(row["n"]) if row["axis"] == "east" else ""),
            Cell(row["axis"]),
            *(Cell(fixed(row[key], decimals)) for key in ("max_m", "min_m", "mean_m", "rmse_m")),
        )
        for row in found
    )
    direct = " Direct: single strips intersected with the sensor before and after the adjustment." if summary["direct"] else ""
    return Table(
        "Errors of coordinates (m)",
        ("points", "n", "axis", "max", "min", "mean", "RMSE"),
        (False, True, False, True, True, True, True),
        rows,
        f"Found − given.{direct} Control points took part in the adjustment.",
        tuple(range(2, len(rows) - 1, 3)),
    )


def standard(summary: Summary) -> Table | None:
    """The check points against the limits of a standard; None where none was asked for."""
    found = summary["standard"]
    if found is None:
        return None
    words = {True: "met", False: "not met", None: "no check points"}
    return Table(
        f"Against {found['name']}",
        ("RMSE of check points", "limit (m)", "found (m)", ""),
        (False, True, True, False),
        tuple(
            (
                Cell(row["what"]),
                Cell(short(row["limit_m"])),
                Cell(fixed(row["rmse_m"], 3)),
                Cell(words[row["passes"]], not row["passes"]),
            )
            for row in found["limits"]
        ),
        "Planimetry: east and north together.",
    )


def unknowns(summary: Summary) -> Table | None:
    """Start, value, sigma and what the data had to say; None where only the trajectory was estimated."""
    if not summary["unknowns"]:
        return None
    rows = []
    for p in summary["unknowns"]:
        decimals = decimals_of(p["sigma"])
        prior = "–" if p["prior_sigma"] is None else f"{short(p['prior_mean'], 6)} ± {short(p['prior_sigma'])}"
        share = p["data_share"]
        rows.append(
            (
                *(Cell(p["name"]), Cell(p["unit"]), Cell(prior), Cell(short(p["start"], 6))),
                *(Cell(fixed(p["value"], decimals)), Cell(fixed(p["sigma"], decimals))),
                Cell(percent(share), share is not None and share < PRIOR_ONLY),
            )
        )
    return Table(
        "Unknowns",
        ("unknown", "unit", "prior", "start", "value", "± sigma", "from data"),
        (False, False, True, True, True, True, True),
        tuple(rows),
        "From data: share of the prior variance that the data removed; near 0 % the prior alone says it.",
    )


def corrections(summary: Summary) -> Table | None:
    """What was added to the trajectory; None where it was kept."""
    found = summary["corrections"]
    if found is None:
        return None
    rows = []
    for row in found["axes"]:
        decimals = decimals_of(row["median_sigma"])
        told = row["correlation_s"]  # of several statements all
        time = "–" if told is None else " and ".join(map(short, told if isinstance(told, list) else [told]))
        figures = (Cell(fixed(row[key], decimals)) for key in ("rms", "max_abs", "median_sigma"))
        rows.append((Cell(row["axis"]), Cell(row["unit"]), Cell(short(row["prior_sigma"])), Cell(time), *figures))
    observed = "prior sigma: of POS" if found["observed"] else "prior sigma: how far the start may be off; nothing was observed"
    return Table(
        "Corrections of the trajectory",
        ("axis", "unit", "prior sigma", "memory (s)", "RMS", "max", "median sigma"),
        (False, False, True, True, True, True, True),
        tuple(rows),
        f"At {found['stations']} stations of the link {found['link']}; {observed}; memory: correlation time. All are in "
        "corrections.csv.",
    )


def residuals(summary: Summary) -> Table:
    """Residuals in pixels by view and role."""
    found, (x, y) = summary["residuals"], axes_in(summary)
    rows = tuple(
        (
            Cell(row["view"] or "all"),
            Cell(row["role"]),
            Cell(str(row["rays"])),
            *(Cell(fixed(row[key], 2)) for key in ("rms_x_px", "rms_y_px", "max_abs_x_px", "max_abs_y_px", "rms_in_sigmas")),
        )
        for row in found
    )
    names = [row["view"] for row in found]
    return Table(
        "Residuals (px), measured − projected",
        ("view", "role", "rays", f"RMS: {x}", f"RMS: {y}", f"max: {x}", f"max: {y}", "in sigmas: RMS"),
        (False, False, True, True, True, True, True, True),
        rows,
        f"{axes_in_words(summary)} A point takes three of its rays' residuals, so that even right sigmas give less than 1.",
        tuple(i for i in range(len(names) - 1) if names[i] != names[i + 1]),
    )


def sizes(summary: Summary) -> Table:
    """How large residuals are in every unit, by view and role."""
    found, (x, y), columns = summary["residuals"], axes_in(summary), size_keys(summary)
    decimals = {"rms_x_px": 2, "rms_y_px": 2} | {key: 1 + decimals_among(found, key) for key in columns}
    return Table(
        "How large residuals are (RMS)",
        ("view", "role", "rays", f"px: {x}", f"px: {y}", *columns.values()),
        (False, False, *[True] * (1 + len(decimals))),
        tuple(
            (
                *(Cell(row["view"] or "all"), Cell(row["role"]), Cell(str(row["rays"]))),
                *(Cell(fixed(row[key], d)) for key, d in decimals.items()),
            )
            for row in found
        ),
        f"{caption(summary)} Image by image: results.json.",
    )


def point_sigmas(summary: Summary) -> Table | None:
    """How well points are known; None where nothing is."""
    found = {(row["role"], row["axis"]): row for row in summary["point_sigmas"]}
    if not found:
        return None
    rows = []
    for role in dict.fromkeys(role for role, _ in found):
        of = [found[role, axis] for axis in ("east", "north", "up")]
        figures = (Cell(fixed(row[key], 3)) for key in ("median_m", "max_m") for row in of)
        rows.append((Cell(role), Cell(str(of[0]["n"])), *figures))
    return Table(
        "1-sigma of adjusted points (m)",
        ("role", "n", *(f"{which}: {axis}" for which in ("median", "largest") for axis in ("east", "north", "up"))),
        (False, *[True] * 7),
        tuple(rows),
        "From the given sigmas of rays, POS and control, and the correlations between points and trajectory.",
    )


def _rays(title: str, summary: Summary, rows: list[Summary], said: str) -> Table | None:
    if not rows:
        return None
    (x, y), sizes = axes_in(summary), one_keys(summary)
    decimals = {"x_px": 2, "y_px": 2} | {key: 1 + decimals_among(rows, key) for key in sizes}
    decimals |= {"normalised_x": 1, "normalised_y": 1}
    return Table(
        title,
        (
            *("image", "point", "role", f"px: {x}", f"px: {y}"),
            *sizes.values(),
            *(f"sigmas: {x}", f"sigmas: {y}"),
        ),
        (False, False, False, *[True] * len(decimals)),
        tuple(
            (Cell(row["image"]), Cell(row["point"]), Cell(row["role"]), *(Cell(fixed(row[k], d)) for k, d in decimals.items()))
            for row in rows
        ),
        f"{said} {caption(summary)}",
    )


def left_out(summary: Summary) -> Table | None:
    """Rays that were left out; None where there are none."""
    found = summary["left_out"]
    more = f" The {_LEFT_OUT_SHOWN} largest of {len(found)} are shown; all are in residuals.csv."
    return _rays(
        "Rays left out as wrong",
        summary,
        found[:_LEFT_OUT_SHOWN],
        f"A dash: the point has no other rays.{more if len(found) > _LEFT_OUT_SHOWN else ''}",
    )


def largest(summary: Summary) -> Table | None:
    """The rays that agree least."""
    said = "Where a wrong point would show. All are in residuals.csv."
    return _rays("Largest residuals", summary, summary["largest_residuals"], said)
