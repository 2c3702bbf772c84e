"""Residuals along the image or along time: the picture in which a delay, a drift or a distortion shows itself."""

from typing import Any, NamedTuple

import numpy as np

from ...rules import import_extra
from ..style import COLOUR, INK, MARKER, MUTED, NORMAL, Drawing, dress, new_figure, robust_limit, shortened
from .residuals import FEW, Residuals
from .vectors import choice

_PANELS = 6
_MOST_BINS, _FEWEST_POINTS = 14, 12
_BAND = "#E9E9E9"


class _Column(NamedTuple):
    """One column of panels: which observations, and over what."""

    title: str
    here: np.ndarray
    label: str
    along: np.ndarray


def _columns(residuals: Residuals) -> tuple[list[_Column], str]:
    """What the panels show, and how a caption says it."""
    everything = np.ones(len(residuals), dtype=bool)
    if residuals.time_s is not None and np.median(residuals.count) < FEW:
        return [_Column("all images", everything, "time (s)", residuals.time_s)], "over time"
    if residuals.is_line:
        chosen = residuals.worst_images(_PANELS)
        columns = [
            _Column(residuals.images[i].name, residuals.image == i, residuals.places[1], residuals.place[:, 1]) for i in chosen
        ]
        return columns, "along the lines of each image, in the order of scanning." + choice(residuals, chosen)
    pooled = len(residuals.images) > 1
    title = "all images" if pooled else residuals.images[0].name
    columns = [_Column(title, everything, name, residuals.place[:, k]) for k, name in enumerate(residuals.places)]
    return columns, "over column and row" + (", all images together" if pooled else "")


def draw_trends(residuals: Residuals) -> Drawing:
    """Residuals after: over time for single looks, along the lines of line cameras, over column and row of frames."""
    columns, over = _columns(residuals)
    figure = new_figure(5.0)
    panels = figure.subplots(2, len(columns), sharex="col", sharey="row", squeeze=False)
    beyond = 0
    for k, axis in enumerate(("x", "y")):
        shown = np.any([column.here for column in columns], axis=0)
        limit = robust_limit(residuals.after_px[shown, k])
        for j, column in enumerate(columns):
            axes = panels[k, j]
            outside = _panel(axes, residuals, column, k, limit)
            beyond += outside if column.here is not columns[0].here or j == 0 else 0
            axes.set_ylim(-limit, limit)
            if k == 0:
                axes.set_title(shortened(column.title, 90 // len(columns)))
            else:
                axes.set_xlabel(column.label)
            if j == 0:
                axes.set_ylabel(f"{axis} residual, {residuals.words[k]} (px)")
            axes.locator_params(axis="x", nbins=3 if len(columns) > 3 else 7)
            dress(axes, grid="none")
    _legend(figure, residuals.roles)
    caption = (
        f"Residuals after the calibration {over.rstrip('.')}. Grey band: one sigma of the measurements; black: means of "
        "neighbouring points with two standard errors. Where the means leave zero, the model lacks something."
    )
    if beyond:
        caption += f" Residuals beyond the axes are drawn at their edge ({beyond})."
    return Drawing("residual_trends", "Where residuals leave zero", caption, figure)


def _panel(axes: Any, residuals: Residuals, column: _Column, k: int, limit: float) -> int:
    """One panel; returns how many residuals lie beyond it."""
    after = residuals.after_px[:, k]
    sigma = float(np.median(residuals.sigma_px[column.here, k]))
    axes.axhspan(-min(sigma, limit), min(sigma, limit), color=_BAND, linewidth=0, zorder=0)
    axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1)
    crowded = column.here.sum() > 500
    for role in ("check", "control"):
        here = column.here & (residuals.is_control == (role == "control"))
        if not here.any():
            continue  # an empty line that is not clipped would count as a point at the corner of the figure
        axes.plot(
            column.along[here], np.clip(after[here], -limit, limit), MARKER[role], color=COLOUR[role], linestyle="none",
            markersize=2.0 if crowded else 3.6, alpha=0.25 if crowded else 0.85, markeredgewidth=0, clip_on=False, zorder=2,
        )  # fmt: skip
    finite = np.flatnonzero(column.here & np.isfinite(after) & (np.abs(after) <= limit))
    if len(finite) >= _FEWEST_POINTS:
        bins = min(_MOST_BINS, int(np.sqrt(len(finite))))
        order = finite[np.argsort(column.along[finite], kind="stable")]
        groups = np.array_split(order, bins)
        mean = [after[g].mean() for g in groups]
        error = [2 * after[g].std(ddof=1) / np.sqrt(len(g)) for g in groups]
        axes.errorbar(
            [column.along[g].mean() for g in groups], mean, yerr=error, color=INK, linewidth=1.1, elinewidth=0.9, capsize=1.5,
            zorder=3,
        )  # fmt: skip
    return int((~(np.abs(after[column.here]) <= limit)).sum())


def _legend(figure: Any, roles: tuple[str, ...]) -> None:
    """Roles and the mean, above the panels."""
    line = import_extra("matplotlib.lines", "plots").Line2D
    handles = [
        line([], [], marker=MARKER[role], color=COLOUR[role], linestyle="none", markersize=4.5, label=role) for role in roles
    ]
    handles.append(line([], [], color=INK, linewidth=1.1, label="mean ± 2 standard errors"))
    figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize=NORMAL, frameon=False, handletextpad=0.4)
