"""The figures of an adjusted block: where points and rays disagree, what the detector still hides, how the trajectory moved."""

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ...estimate.errors import AXES
from ...rules import import_extra
from ..scales import places_of, words_of
from ..style import (
    CHECK,
    COLOUR,
    CONTROL,
    INK,
    MARKER,
    MUTED,
    NORMAL,
    SMALL,
    WIDTH_INCH,
    Drawing,
    dress,
    new_figure,
    robust_limit,
    round_number,
    shortened,
)
from .adjusted import Adjusted, Course
from .summary import ENU

_LIGHT, _BAND, _TIE = "#CFE2F0", "#E9E9E9", "#9A9A9A"
_ROLES = ("tie", "control", "check")
_OF_ROLE = {**COLOUR, "tie": _TIE}
_CELLS, _CROWDED, _FEW = 16, 300, 3
_ARROW_INCH = 0.3
_MOST_BINS, _FEWEST_POINTS = 32, 12
_COLUMNS = 6


def draw_charts(adjusted: Adjusted) -> list[Drawing]:
    """Residuals on the ground and along the detector, always; errors of points, corrections and sigmas where there are any."""
    known = np.isfinite(adjusted.error_enu_m).all(axis=1).any()
    course = adjusted.course
    return [
        draw_residual_vectors(adjusted),
        *([draw_point_errors(adjusted)] if known else []),
        draw_detector(adjusted),
        *([draw_corrections(adjusted, course)] if course is not None else []),
        *([draw_point_sigmas(adjusted)] if np.isfinite(adjusted.sigma_enu_m).any() else []),
    ]


def _plan(axes: Any, adjusted: Adjusted, *, labelled: bool = True) -> None:
    """A map in kilometres, the same extent in every panel."""
    plan = adjusted.plan_m[np.isfinite(adjusted.plan_m).all(axis=1)] / 1e3
    low, high = plan.min(axis=0), plan.max(axis=0)
    margin = 0.08 * max(float((high - low).max()), 1e-3)
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("east (km)")
    axes.set_ylabel("north (km)" if labelled else "")
    axes.tick_params(labelleft=labelled)
    axes.ticklabel_format(useOffset=False)
    axes.locator_params(nbins=6)
    dress(axes)


def _aspect(adjusted: Adjusted) -> float:
    """Height over width of the map, within what looks well."""
    plan = adjusted.plan_m[np.isfinite(adjusted.plan_m).all(axis=1)]
    width, height = np.maximum(np.ptp(plan, axis=0), 1e-3)
    margin = 0.16 * max(width, height)
    return float(np.clip((height + margin) / (width + margin), 0.25, 1.6))


def _arrows(axes: Any, place_km: np.ndarray, vector_m: np.ndarray, scale: float, colour: str, width: float = 0.014) -> None:
    """Arrows of `scale` metres an inch."""
    axes.quiver(
        *place_km.T, *vector_m.T, angles="uv", units="inches", scale_units="inches", scale=scale, width=width,
        headwidth=3.6, headlength=4.5, headaxislength=4, minlength=0, color=colour, zorder=3,
    )  # fmt: skip


def _scale(vector_m: np.ndarray) -> float:
    """Metres an inch: 19 of 20 arrows are at most the standard arrow."""
    length = np.hypot(*vector_m.T)
    length = length[np.isfinite(length)]
    return max(float(np.quantile(length, 0.95)) if len(length) else 1.0, 1e-12) / _ARROW_INCH


def _key(axes: Any, scale: float) -> str:
    """An arrow of known length above a panel; returns it in words."""
    length = round_number(1.5 * _ARROW_INCH * scale)
    text = f"{length:g} m" if length >= 0.1 else f"{1e3 * length:g} mm"
    quiver = axes.quiver(
        [0], [0], [0], [0], angles="uv", units="inches", scale_units="inches", scale=scale, width=0.018, color=INK, alpha=0
    )
    axes.quiverkey(quiver, 0.74, 1.03, length, text, labelpos="E", color=INK, labelcolor=INK, fontproperties={"size": NORMAL},
                   alpha=1.0)  # fmt: skip
    return text


def _in_cells(place: Float[np.ndarray, "n 2"], vector: Float[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Means over square cells; those at the edge that hold too few arrows to mean anything are left out."""
    low, side = place.min(axis=0), max(float(np.ptp(place, axis=0).max()), 1e-9) / _CELLS
    cell = np.minimum(((place - low) / side).astype(int), _CELLS - 1)
    _, index, count = np.unique(cell[:, 0] * _CELLS + cell[:, 1], return_inverse=True, return_counts=True)
    total = [np.stack([np.bincount(index, weights=c) for c in of.T], axis=-1) / count[:, None] for of in (place, vector)]
    enough = count >= max(_FEW, np.median(count) / 4)
    return total[0][enough], total[1][enough]


def draw_residual_vectors(adjusted: Adjusted) -> Drawing:
    """Residuals of each view as metres on the ground, in plan: single rays where there are few, means of cells of many."""
    rows = math.ceil(len(adjusted.views) / 3)
    columns = min(len(adjusted.views), 3)
    width = 7.2 if columns == 1 else WIDTH_INCH
    figure = new_figure(rows * (0.85 * width / columns * _aspect(adjusted) + 0.9), width)
    panels = figure.subplots(rows, columns, squeeze=False)
    vectors, place = adjusted.ground_m, adjusted.plan_m[adjusted.block.point] / 1e3
    fine = adjusted.adjustment.used & np.isfinite(vectors).all(axis=1) & np.isfinite(place).all(axis=1)
    shown, averaged = [], False
    for view, here in adjusted.views:
        chosen = fine & here
        if chosen.sum() > _CROWDED:
            shown.append((f"{shortened(view, 60 // columns)}: means of cells", *_in_cells(place[chosen], vectors[chosen])))
            averaged = True
        else:
            shown.append((shortened(view, 60 // columns), place[chosen], vectors[chosen]))
    scale = _scale(np.concatenate([vector for _, _, vector in shown]))
    for k, (axes, (title, where, vector)) in enumerate(zip(panels.flat, shown, strict=False)):
        _plan(axes, adjusted, labelled=k % columns == 0)
        axes.set_title(title, loc="left", fontsize=NORMAL)
        if len(where):
            _arrows(axes, where, vector, scale, INK)
        _key(axes, scale)
    for axes in panels.flat[len(shown) :]:
        axes.set_axis_off()
    size = " An arrow is the mean over a cell of the map." if averaged else ""
    caption = (
        "What each measured ray says at the height of its point, less the adjusted point, seen from above: residuals in metres "
        f"on the ground, of all roles.{size} A sound block leaves short arrows of no common direction; a pattern that follows a "
        "strip is a trajectory, one that follows the view is a detector."
    )
    return Drawing("residual_vectors", "Residual vectors over the block", caption, figure)


def draw_point_errors(adjusted: Adjusted) -> Drawing:
    """Adjusted less given coordinates of check and control points: in planimetry, and in height."""
    figure = new_figure(4.2 * _aspect(adjusted) + 1.2)
    panels = figure.subplots(1, 2)
    plan, error = adjusted.plan_m / 1e3, adjusted.error_enu_m
    known = np.isfinite(error).all(axis=1)
    check = known & (adjusted.block.role == "check")
    ties = (adjusted.block.role == "tie") & np.isfinite(plan).all(axis=1)
    for axes, title in zip(panels, ("in planimetry", "in height"), strict=True):
        flat = title == "in planimetry"
        vector = error[:, :2] if flat else np.stack([np.zeros(len(error)), error[:, 2]], axis=-1)
        scale = _scale(vector[check if check.any() else known])
        _plan(axes, adjusted, labelled=flat)
        axes.set_title(title, loc="left", fontsize=NORMAL)
        if ties.any():
            axes.plot(*plan[ties].T, ".", color=_TIE, markersize=3.0 if ties.sum() <= _CROWDED else 0.8, zorder=1)
        for role in ("control", "check"):
            chosen = known & (adjusted.block.role == role)
            if chosen.any():
                axes.plot(*plan[chosen].T, MARKER[role], color=COLOUR[role], markersize=4, linestyle="none", zorder=2)
                _arrows(axes, plan[chosen], vector[chosen], scale, COLOUR[role])
        _key(axes, scale)
    _role_legend(figure, [role for role in _ROLES if (adjusted.block.role == role).any()])
    caption = (
        "Adjusted − given coordinates of control and check points, seen from above; in height arrows point up where the adjusted "
        "point is too high. Control points hold the block, check points took part without their coordinates. Grey: tie points."
    )
    return Drawing("point_errors", "Errors of control and check points", caption, figure)


def _role_legend(figure: Any, roles: list[str]) -> None:
    line = import_extra("matplotlib.lines", "plots").Line2D
    handles = [
        line([], [], marker=MARKER.get(role, "o"), color=_OF_ROLE[role], linestyle="none", markersize=4.5, label=role)
        for role in roles
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=4, fontsize=NORMAL, frameon=False, handletextpad=0.4)


def draw_detector(adjusted: Adjusted) -> Drawing:
    """Residuals along the detector line of each view; of frame cameras over column and row."""
    place, residual = adjusted.place, adjusted.adjustment.residual_px
    everything = np.ones(len(residual), dtype=bool)
    if adjusted.flight.is_line:
        shown = [(shortened(view, 90 // _COLUMNS), here, "sample (px)", place[:, 0]) for view, here in adjusted.views[:_COLUMNS]]
    else:
        shown = [("all images", everything, name, place[:, k]) for k, name in enumerate(places_of(False))]
    figure = new_figure(5.2)
    panels = figure.subplots(2, len(shown), sharex="col", sharey="row", squeeze=False)
    used, beyond = adjusted.adjustment.used, 0
    for k, axis in enumerate("xy"):
        limit = robust_limit(residual[used, k])
        for j, (title, here, label, along) in enumerate(shown):
            axes = panels[k, j]
            beyond += _along(axes, adjusted, here & used, along, k, limit) if adjusted.flight.is_line or j == 0 else 0
            if not adjusted.flight.is_line and j > 0:
                _along(axes, adjusted, here & used, along, k, limit)
            axes.set_ylim(-limit, limit)
            axes.set_title(title if k == 0 else "", loc="left", fontsize=NORMAL)
            axes.set_xlabel(label if k == 1 else "")
            axes.set_ylabel(f"{axis} residual, {words_of(adjusted.flight.is_line)[k]} (px)" if j == 0 else "")
            axes.locator_params(axis="x", nbins=5)
            dress(axes, grid="none")
    line = import_extra("matplotlib.lines", "plots").Line2D
    handles = [
        line([], [], marker=MARKER.get(role, "o"), color=_OF_ROLE[role], linestyle="none", markersize=4.5, label=role)
        for role in adjusted.roles[::-1]
    ]
    handles.append(line([], [], color=INK, linewidth=1.1, label="mean ± 2 standard errors"))
    figure.legend(handles=handles, loc="outside upper left", ncols=4, fontsize=NORMAL, frameon=False, handletextpad=0.4)
    caption = (
        "Residuals after the adjustment along the detector. Black: means of neighbouring rays with two standard errors; where "
        "they leave zero, the detector's model lacks something."
    )
    if beyond:
        caption += f" Residuals beyond the axes are drawn at their edge ({beyond})."
    return Drawing("detector_residuals", "What the detector still hides", caption, figure)


def _along(
    axes: Any, adjusted: Adjusted, here: Bool[np.ndarray, " rays"], along: Float[np.ndarray, " rays"], k: int, limit: float
) -> int:
    """One panel; returns how many residuals lie beyond it."""
    after = adjusted.adjustment.residual_px[:, k]
    axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1)
    for role in _ROLES:
        chosen = here & (adjusted.role == role)
        if chosen.any():
            crowded = chosen.sum() > _CROWDED
            # Thousands of dots would be heavier than all else on the page: they are drawn as an image.
            axes.plot(
                along[chosen], np.clip(after[chosen], -limit, limit), MARKER.get(role, "o"), color=_OF_ROLE[role],
                linestyle="none", markersize=1.4 if crowded else 2.8, alpha=max(0.1, min(0.8, 400 / chosen.sum())),
                markeredgewidth=0, zorder=2, rasterized=True,
            )  # fmt: skip
    inside = np.flatnonzero(here & (np.abs(after) <= limit))
    if len(inside) >= _FEWEST_POINTS:
        order = inside[np.argsort(along[inside], kind="stable")]
        groups = np.array_split(order, min(_MOST_BINS, int(np.sqrt(len(inside)))))
        mean, error = [after[g].mean() for g in groups], [2 * after[g].std(ddof=1) / np.sqrt(len(g)) for g in groups]
        axes.errorbar(
            [along[g].mean() for g in groups], mean, yerr=error, color=INK, linewidth=1.1, elinewidth=0.9, capsize=1.5, zorder=3
        )
    return int((~(np.abs(after[here]) <= limit)).sum())


def draw_corrections(adjusted: Adjusted, course: Course) -> Drawing:
    """Corrections of the trajectory at stations with one sigma, strip by strip, and the sigma that POS was given."""
    errors = adjusted.adjustment.motions
    assert errors is not None  # there is a course
    rows = [k for k in range(6) if errors.sigma[k] > 0]
    segments = course.segments[:_COLUMNS]
    figure = new_figure(1.3 * len(rows) + 1.1)
    panels = figure.subplots(len(rows), len(segments), sharex="col", sharey="row", squeeze=False)
    first = 0
    for j, (name, count) in enumerate(segments):
        here = slice(first, first + count)
        first += count
        along = np.arange(count, dtype=float) if course.time_s is None else course.time_s[here] - course.time_s[here.start]
        for i, k in enumerate(rows):
            axes, factor = panels[i, j], 1e3 * math.degrees(1.0) if k < 3 else 1e2
            value, sigma = factor * course.value[here, k], factor * course.sigma[here, k]
            for side in (-1, 1):
                axes.axhline(side * factor * errors.sigma[k], color=CHECK, linewidth=0.8, linestyle="--", zorder=1)
            axes.fill_between(along, value - sigma, value + sigma, color=_LIGHT, linewidth=0, zorder=0)
            axes.plot(along, value, "-", color=CONTROL, linewidth=1.1, zorder=2)
            axes.axhline(0, color=MUTED, linewidth=0.6, zorder=1)
            axes.set_title(shortened(name, 90 // len(segments)) if i == 0 else "", loc="left", fontsize=NORMAL)
            axes.set_ylabel(f"{AXES[k]}\n({'mdeg' if k < 3 else 'cm'})" if j == 0 else "")
            last = "station" if course.time_s is None else f"s after {course.time_s[here.start]:g} s"
            axes.set_xlabel(last if i == len(rows) - 1 else "")
            axes.locator_params(nbins=4)
            dress(axes)
    lines, patches = (import_extra(f"matplotlib.{name}", "plots") for name in ("lines", "patches"))
    handles = [
        lines.Line2D([], [], color=CONTROL, linewidth=1.1, label="correction"),
        patches.Patch(facecolor=_LIGHT, label="± 1 sigma after"),
        lines.Line2D([], [], color=CHECK, linewidth=0.8, linestyle="--", label="± 1 sigma before"),
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize=NORMAL, frameon=False)
    more = f" The first {_COLUMNS} of {len(course.segments)} are shown." if len(course.segments) > _COLUMNS else ""
    caption = (
        f"What the adjustment added to the trajectory at the {len(course.value)} stations of the link {errors.link}, turns in "
        "thousandths of a degree and shifts in centimetres, about and along the axes of its frame. A band as wide as the "
        f"dashed lines says that rays know nothing that POS did not.{more}"
    )
    return Drawing("trajectory_corrections", "Corrections of the trajectory", caption, figure)


def draw_point_sigmas(adjusted: Adjusted) -> Drawing:
    """How well points are known along each axis, by role."""
    figure = new_figure(3.6)
    panels = figure.subplots(1, 3, sharey=True)
    sigma = 1e2 * adjusted.sigma_enu_m
    seen = np.isfinite(sigma).all(axis=1) & (sigma > 0).all(axis=1)
    low, high = sigma[seen].min(), sigma[seen].max()
    edges = np.geomspace(low / 1.05, high * 1.05, 41)
    for k, (axes, axis) in enumerate(zip(panels, ENU, strict=True)):
        for role in _ROLES:
            chosen = seen & (adjusted.block.role == role)
            if chosen.any():
                share = np.full(int(chosen.sum()), 100 / chosen.sum())
                filled = {"histtype": "stepfilled", "alpha": 0.35} if role == "tie" else {"histtype": "step", "linewidth": 1.4}
                axes.hist(sigma[chosen, k], edges, weights=share, color=_OF_ROLE[role], **filled)
        axes.set_xscale("log")
        axes.set_title(axis, loc="left", fontsize=NORMAL)
        axes.set_xlabel("1-sigma (cm)")
        axes.set_ylabel("share of its role (%)" if k == 0 else "")
        _plain_ticks(axes)
        dress(axes)
    line, patch = (import_extra(f"matplotlib.{name}", "plots") for name in ("lines", "patches"))
    handles = [
        patch.Patch(facecolor=_TIE, alpha=0.5, label=role)
        if role == "tie"
        else line.Line2D([], [], color=COLOUR[role], linewidth=1.4, label=role)
        for role in adjusted.roles
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize=NORMAL, frameon=False)
    caption = (
        "1-sigma of adjusted coordinates, as shares of the points of each role. Check points and ties are known by their rays "
        "alone, control points also by their coordinates."
    )
    return Drawing("point_sigmas", "How well points are known", caption, figure)


def _plain_ticks(axes: Any) -> None:
    """1, 2, 5, 10 on a logarithmic axis, as plain numbers."""
    ticker = import_extra("matplotlib.ticker", "plots")
    axes.xaxis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(ticker.FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(ticker.NullFormatter())
    axes.tick_params(labelsize=SMALL)
