"""The figures of a located target: where it is, how the estimate came to rest, and whether the looks agree."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from ...rules import import_extra
from ..scales import words_of
from ..style import CHECK, CONTROL, INK, MUTED, NORMAL, SMALL, Drawing, dress, new_figure
from .sighting import Sighting
from .summary import FIFTY, NINETY

_LIGHT, _DARK = "#CFE2F0", "#8FBCDD"
# Quantiles of a normal variable's size: 50 and 90 of 100.
_HALF, _MOST = 0.6745, 1.6449
# What a good look's NIS stays below 99 times in 100: chi-square with two degrees of freedom.
_NIS_99 = -2 * math.log(0.01)
# The first looks move the estimate by kilometres; panels are scaled to what comes after this share of the looks.
_SETTLING = 1 / 2


def draw_charts(sighting: Sighting) -> list[Drawing]:
    """Error ellipse, convergence and innovations: without an answer only these, of a batch no convergence, of one look none."""
    drawings = []
    if sighting.is_answered:
        drawings += [draw_ellipse(sighting), *([draw_convergence(sighting)] if sighting.is_filter else [])]
    return [*drawings, *([draw_innovations(sighting)] if len(sighting) > 1 else [])]


def draw_ellipse(sighting: Sighting) -> Drawing:
    """Horizontal covariance from above, with the directions to the platform, and the height beside it on the same scale."""
    covariance = np.asarray(sighting.location.covariance_enu_m2)
    extent = NINETY * np.sqrt(np.diag(covariance))
    truth = None if sighting.truth_m is None else sighting.enu(sighting.truth_m)
    reach = max(extent.max(), 0.0 if truth is None else float(np.abs(truth).max()))
    limit = 1.4 * (reach if reach > 0 else 1.0)
    figure = new_figure(6.4, 7.8)
    plan = figure.subplots()
    side = plan.inset_axes((1.14, 0.0, 0.16, 1.0), sharey=plan)
    _ellipses(plan, covariance[:2, :2])
    directions = _directions(plan, sighting, limit)
    plan.plot([0], [0], "o", color=CONTROL, markersize=5, zorder=4)
    sigma_up = math.sqrt(covariance[2, 2])
    for factor, colour in ((_MOST, _LIGHT), (_HALF, _DARK)):
        side.bar([0], [2 * factor * sigma_up], bottom=-factor * sigma_up, width=0.7, color=colour, zorder=1)
    side.plot([0], [0], "o", color=CONTROL, markersize=5, zorder=4)
    if truth is not None:
        plan.plot([truth[0]], [truth[1]], "^", color=CHECK, markersize=7, zorder=5)
        side.plot([0], [truth[2]], "^", color=CHECK, markersize=7, zorder=5)
    plan.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    plan.set_xlabel("east of the estimate (m)")
    plan.set_ylabel("north of the estimate (m)")
    side.set(xlim=(-0.8, 0.8), xticks=[])
    side.set_title("up (m)")
    for axes, grid in ((plan, "both"), (side, "y")):
        dress(axes, grid=grid)
    _legend(figure, truth is not None)
    horizontal = float(np.hypot(*truth[:2])) if truth is not None else 0.0
    known = f" The given position lies {horizontal:.3g} m off, and {abs(truth[2]):.3g} m in height." if truth is not None else ""
    caption = (
        f"Where {sighting.label} lies, seen from above, and in height: regions that hold it with 50 and 90 %.{known} "
        f"{directions} A position is known worst along the lines of sight."
    )
    return Drawing("error_ellipse", "Where the target lies", caption, figure)


def _ellipses(axes: Any, covariance: Float[np.ndarray, "2 2"]) -> None:
    """The ellipses of 90 and 50 % around the origin."""
    patches = import_extra("matplotlib.patches", "plots")
    variance, vectors = np.linalg.eigh(covariance)
    minor, major = np.sqrt(np.maximum(variance, 0.0))
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    for factor, colour in ((NINETY, _LIGHT), (FIFTY, _DARK)):
        size = 2 * factor * major, 2 * factor * minor
        axes.add_patch(patches.Ellipse((0, 0), *size, angle=angle, facecolor=colour, edgecolor=CONTROL, linewidth=0.8, zorder=1))


def _directions(axes: Any, sighting: Sighting, limit: float) -> str:
    """Arrows to the platform at the first and the last look that were used; returns them in words."""
    used = np.flatnonzero(sighting.state == "used")
    away = sighting.enu(sighting.platform_m[used[[0, -1]]])
    ground = np.hypot(away[:, 0], away[:, 1])
    # Each label stands on the side of its arrow that is away from the other one.
    side = 1.0 if away[0, 0] * away[1, 1] < away[0, 1] * away[1, 0] else -1.0
    words = []
    for k, (name, style) in enumerate((("first", "-"), ("last", "--"))):
        up_deg = math.degrees(math.atan2(away[k, 2], ground[k]))
        words.append(f"{np.linalg.norm(away[k]) / 1e3:.3g} km away, {up_deg:.0f} deg above the horizon, at the {name} look")
        if ground[k] < 1e-3 * abs(away[k, 2]):
            continue  # straight above: no direction in the plan
        x, y = away[k, :2] / ground[k]
        edge = limit / max(abs(x), abs(y))
        arrow = {"arrowstyle": "->", "color": INK, "linewidth": 0.9, "linestyle": style, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (0.94 * edge * x, 0.94 * edge * y), (0, 0), arrowprops=arrow, zorder=3)
        # A label is about 0.3 wide and 0.1 high, in units of the limit.
        aside = (side if k == 0 else -side) * (0.07 + 0.13 * abs(y)) * limit
        place = np.clip((0.82 * edge * x - aside * y, 0.82 * edge * y + aside * x), -0.82 * limit, 0.82 * limit)
        axes.text(*place, f"to the platform,\n{name} look", fontsize=SMALL, color=INK, ha="center", va="center", zorder=6)
    return f"The platform was {' and '.join(words)}."


def _legend(figure: Any, has_truth: bool) -> None:
    lines, patches = (import_extra(f"matplotlib.{name}", "plots") for name in ("lines", "patches"))
    handles = [
        patches.Patch(facecolor=_DARK, edgecolor=CONTROL, linewidth=0.8, label="50 %"),
        patches.Patch(facecolor=_LIGHT, edgecolor=CONTROL, linewidth=0.8, label="90 %"),
        lines.Line2D([], [], marker="o", color=CONTROL, linestyle="none", markersize=5, label="estimate"),
    ]
    if has_truth:
        handles.append(lines.Line2D([], [], marker="^", color=CHECK, linestyle="none", markersize=7, label="given position"))
    figure.legend(handles=handles, loc="outside upper left", ncols=4, fontsize=NORMAL, frameon=False, handletextpad=0.5)


def draw_convergence(sighting: Sighting) -> Drawing:
    """East, north and up of the estimate after each look, from the last one; and how sigma and error fall."""
    found = sighting.location.looks
    enu = sighting.enu(np.asarray(found.point_m))
    variance = np.diagonal(np.asarray(found.covariance_enu_m2), axis1=1, axis2=2)
    sigma = np.sqrt(variance)
    truth = None if sighting.truth_m is None else sighting.enu(sighting.truth_m)
    number = np.arange(len(sighting))
    figure = new_figure(5.6)
    panels = figure.subplots(2, 2, sharex=True)
    settled = min(math.ceil(_SETTLING * len(number)), len(number) - 1)
    beyond = 0
    for k, (axes, name) in enumerate(zip(panels.flat[:3], ("east", "north", "up"), strict=True)):
        limit = 1.1 * float((np.abs(enu[settled:, k]) + sigma[settled:, k]).max())
        limit = limit if math.isfinite(limit) and limit > 0 else 1.0
        axes.fill_between(number, enu[:, k] - sigma[:, k], enu[:, k] + sigma[:, k], color=_LIGHT, linewidth=0)
        axes.plot(number, enu[:, k], "o-", color=CONTROL, markersize=3 if len(number) <= 60 else 0, linewidth=1.2)
        if truth is not None:
            axes.axhline(truth[k], color=CHECK, linewidth=1.1)
        axes.set_ylim(-limit, limit)
        axes.set_ylabel(f"{name} (m)")
        beyond += int((np.abs(enu[:, k]) > limit).any())
        dress(axes)
    axes = panels[1, 1]
    axes.plot(number, np.sqrt(variance.sum(axis=1)), "-", color=CONTROL, linewidth=1.4, label="1-sigma in space")
    if truth is not None:
        error = np.linalg.norm(enu - truth, axis=1)
        axes.plot(number, error, "^-", color=CHECK, linewidth=1.1, markersize=3, label="error in space")
    axes.set_yscale("log")
    axes.set_ylabel("sigma, error (m)" if truth is not None else "sigma (m)")
    dress(axes)
    for axes in panels[1]:
        axes.set_xlabel("look")
        axes.xaxis.get_major_locator().set_params(integer=True)
    _convergence_legend(figure, truth is not None)
    caption = "The estimate after each look, from the last one, with one sigma." + (
        " Orange: the given position, and the distance from it." if truth is not None else ""
    )
    if beyond:
        caption += " The scale is that of the later looks; the first ones move the estimate beyond it."
    caption += " Where the estimate leaves its own band for good, an error is missing from the model. Looks are counted from 0."
    return Drawing("convergence", "How the estimate came to rest", caption, figure)


def _convergence_legend(figure: Any, has_truth: bool) -> None:
    lines, patches = (import_extra(f"matplotlib.{name}", "plots") for name in ("lines", "patches"))
    handles = [
        lines.Line2D([], [], color=CONTROL, linewidth=1.4, label="estimate; 1-sigma in space"),
        patches.Patch(facecolor=_LIGHT, label="± 1 sigma"),
    ]
    if has_truth:
        handles.append(lines.Line2D([], [], color=CHECK, linewidth=1.1, label="given position; error in space"))
    figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize=NORMAL, frameon=False)


def draw_innovations(sighting: Sighting) -> Drawing:
    """What every look says against what was predicted, in pixels, and the same as one number."""
    found = sighting.location.looks
    residual, covariance = np.asarray(found.innovation_px), np.asarray(found.innovation_covariance_px2)
    band = 2 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    nis = np.asarray(found.nis)
    number = np.arange(len(sighting))
    used = sighting.state == "used"
    gated = sighting.state == "gated"
    figure = new_figure(6.2)
    panels = figure.subplots(3, 1, sharex=True)
    beyond = 0
    for k, axis in enumerate("xy"):
        axes = panels[k]
        limit = _limit(residual[:, k], band[:, k], used)
        axes.fill_between(number, -band[:, k], band[:, k], color="#E9E9E9", linewidth=0, step="mid", zorder=0)
        axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1)
        beyond += _points(axes, number, residual[:, k], used, gated, -limit, limit)
        axes.set_ylim(-1.05 * limit, 1.05 * limit)
        axes.set_ylabel(f"{axis}, {words_of(sighting.flight.is_line)[k]} (px)")
        dress(axes, grid="y")
    axes = panels[2]
    bound = _NIS_99 if sighting.gate is None else -2 * math.log(sighting.gate)
    seen = nis[(used | gated) & np.isfinite(nis)]
    limit = max(1.15 * float(np.max(seen, initial=0.0)), 1.3 * bound)
    limit = min(limit, 4 * bound)
    axes.axhline(bound, color=INK, linewidth=0.9, linestyle="--", zorder=1)
    axes.axhline(2, color=MUTED, linewidth=0.8, zorder=1)
    beyond += _points(axes, number, nis, used, gated, 0.0, limit)
    axes.set_ylim(0, 1.05 * limit)
    axes.set_ylabel("NIS (no unit)")
    axes.set_xlabel("look")
    axes.set_xlim(-0.5, len(sighting) - 0.5)
    axes.xaxis.get_major_locator().set_params(integer=True)
    dress(axes, grid="y")
    _innovations_legend(figure, sighting, bool(gated.any()))
    words = "predicted before it" if sighting.is_filter else "projected from the solution"
    caption = (
        f"Each look: measured − {words}, with the band of two sigmas that it should stay in 19 times of 20; below, the two as "
        "one number, 2 on average where the covariance is right. Looks are counted from 0."
    )
    if beyond:
        caption += f" Values beyond the axes are drawn at their edge ({beyond})."
    return Drawing("innovations", "Whether the looks agree", caption, figure)


def _limit(residual: np.ndarray, band: np.ndarray, used: np.ndarray) -> float:
    """Half the range: all used looks, and the band once it has come down from the first guess."""
    late = np.arange(len(band)) >= min(math.ceil(_SETTLING * len(band)), len(band) - 1)
    values = np.concatenate([np.abs(residual[used & late]), band[late]])
    values = values[np.isfinite(values)]
    return 1.1 * float(values.max()) if len(values) and values.max() > 0 else 1.0


def _points(axes: Any, number: Any, value: Any, used: Any, gated: Any, low: float, high: float) -> int:
    """Used looks as dots, gated ones as crosses; returns how many lie beyond the axes."""
    for here, marker, colour, size in ((used, "o", CONTROL, 4.0), (gated, "X", CHECK, 6.5)):
        here = here & np.isfinite(value)
        if here.any():
            axes.plot(
                number[here], np.clip(value[here], low, high), marker, color=colour, linestyle="none", markersize=size,
                markeredgewidth=0, clip_on=False, zorder=3,
            )  # fmt: skip
    shown = (used | gated) & np.isfinite(value)
    return int(((value[shown] < low) | (value[shown] > high)).sum())


def _innovations_legend(figure: Any, sighting: Sighting, any_gated: bool) -> None:
    lines, patches = (import_extra(f"matplotlib.{name}", "plots") for name in ("lines", "patches"))
    limit = "99 of 100" if sighting.gate is None else f"the gate, {sighting.gate:g}"
    handles = [
        lines.Line2D([], [], marker="o", color=CONTROL, linestyle="none", markersize=4, label="used"),
        *([lines.Line2D([], [], marker="X", color=CHECK, linestyle="none", markersize=6.5, label="gated")] if any_gated else []),
        patches.Patch(facecolor="#E9E9E9", label="± 2 sigma"),
        lines.Line2D([], [], color=INK, linewidth=0.9, linestyle="--", label=f"NIS bound ({limit})"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=4, fontsize=NORMAL, frameon=False)
