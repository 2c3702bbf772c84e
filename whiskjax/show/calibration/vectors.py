"""Residual vectors in image coordinates, before and after: the picture in which a wrong model shows its shape."""

from typing import Any

import numpy as np

from ..style import (
    COLOUR,
    INK,
    MARKER,
    MUTED,
    NORMAL,
    SMALL,
    TITLE,
    Drawing,
    dress,
    new_figure,
    robust_limit,
    round_number,
    shortened,
)
from .residuals import FEW, STAGES, Residuals

_STRIPS, _FRAMES = 6, 3  # images that fit beside each other as tall strips, or below each other as frames
_CELLS = 14, 9
_CROWDED = 400
_ARROW_INCH = {"tall": 0.42, "wide": 0.5}


def draw_vectors(residuals: Residuals) -> Drawing:
    """Residual vectors for each image, or for all together where there are too many images or too few points in each."""
    extent = np.ptp(residuals.place, axis=0)
    if len(residuals) > 1 and (extent < 1.0).all():
        return _draw_scatter(residuals)
    if len(residuals.images) > _STRIPS and np.median(residuals.count) < FEW:
        chosen = []
    elif extent[1] > 2 * extent[0] and len(residuals.images) > 2:
        return _draw_tall(residuals, residuals.worst_images(_STRIPS))
    else:
        chosen = residuals.worst_images(_FRAMES)
    return _draw_wide(residuals, chosen)


def _limits(residuals: Residuals) -> tuple[tuple[float, float], tuple[float, float]]:
    """The frame of the images: their size where it is known, else where points were measured."""
    out = []
    for k, size in enumerate(("columns", "rows")):
        sizes = [getattr(image, size) for image in residuals.images]
        low, high = residuals.place[:, k].min(), residuals.place[:, k].max()
        margin = 0.06 * max(high - low, 1.0)
        if all(s is not None for s in sizes) and low > -1 and high < max(sizes) + 1:
            out.append((-0.5, max(sizes) - 0.5))
        else:
            out.append((low - margin, high + margin))
    return out[0], out[1]


def _arrows(axes: Any, place: np.ndarray, vector: np.ndarray, scale: float, colour: str, width: float = 0.014) -> None:
    """Arrows of `scale` pixels an inch; y points down as image lines do."""
    axes.quiver(
        *place.T, vector[:, 0], -vector[:, 1], angles="uv", units="inches", scale_units="inches", scale=scale,
        width=width, headwidth=3.6, headlength=4.5, headaxislength=4, minlength=0, color=colour, zorder=3,
    )  # fmt: skip


def _strip(axes: Any, stage: str, scale: float, arrow_inch: float, width_inch: float, roles: tuple[str, ...]) -> None:
    """A line above the panels: the stage, what the colours mean, and an arrow of known length in the panels' own scale."""
    axes.set_axis_off()
    axes.set_xlim(0, width_inch)
    axes.set_ylim(0, 1)
    axes.text(0.02, 0.5, stage, fontsize=TITLE, fontweight="bold", va="center", color=INK)
    x = 0.75
    for role in roles:
        axes.plot([x], [0.5], MARKER[role], color=COLOUR[role], markersize=4.5, linestyle="none")
        axes.text(x + 0.1, 0.5, role, fontsize=NORMAL, va="center", color=INK)
        x += 0.8
    length = round_number(1.5 * arrow_inch * scale)
    axes.quiver(
        [x], [0.5], [length], [0.0], angles="uv", units="inches", scale_units="inches", scale=scale, width=0.02, color=INK
    )
    axes.text(x + length / scale + 0.08, 0.5, f"{length:g} px", fontsize=NORMAL, va="center", color=INK)


def _scale(residuals: Residuals, stage: str, kind: str) -> float:
    """Pixels an inch: 19 of 20 arrows are at most the standard arrow."""
    length = np.hypot(*residuals.stage(stage).T)
    length = length[np.isfinite(length)]
    return max(float(np.quantile(length, 0.95)) if len(length) else 1.0, 1e-12) / _ARROW_INCH[kind]


def _panel(axes: Any, residuals: Residuals, here: np.ndarray, stage: str, scale: float) -> None:
    """An arrow for each observation."""
    for role in residuals.roles[::-1]:
        chosen = here & (residuals.is_control == (role == "control"))
        if not chosen.any():
            continue
        place, vector = residuals.place[chosen], residuals.arrows(stage)[chosen]
        axes.plot(*place.T, MARKER[role], color=COLOUR[role], markersize=2.6, linestyle="none", zorder=2)
        _arrows(axes, place, vector, scale, COLOUR[role])


def _frame(axes: Any, residuals: Residuals) -> None:
    limits = _limits(residuals)
    axes.set_xlim(*limits[0])
    axes.set_ylim(limits[1][1], limits[1][0])
    dress(axes, grid="none")


def choice(residuals: Residuals, chosen: list[int]) -> str:
    """The sentence that says which images are shown; empty where all are."""
    if len(chosen) == len(residuals.images):
        return ""
    return (
        f" Shown: {len(chosen)} of {len(residuals.images)} images, those with the largest residuals after "
        "(images with less than half the usual number of points left aside)."
    )


_CAPTION = (
    "Arrows are residuals (measured − projected) at the place of each point, x to the right and y down as in the image; before "
    "and after have their own scale, given by the black arrow. A sound result leaves short arrows of no common direction, "
    "control and check alike."
)


def _draw_tall(residuals: Residuals, chosen: list[int]) -> Drawing:
    """Images that are long strips: beside each other, before above after."""
    figure = new_figure(8.2)
    grid = figure.add_gridspec(4, len(chosen), height_ratios=[0.09, 1, 0.09, 1])
    for row, stage in enumerate(STAGES):
        scale = _scale(residuals, stage, "tall")
        _strip(figure.add_subplot(grid[2 * row, :]), stage, scale, _ARROW_INCH["tall"], 9.3, residuals.roles)
        for column, image in enumerate(chosen):
            axes = figure.add_subplot(grid[2 * row + 1, column])
            _frame(axes, residuals)
            _panel(axes, residuals, residuals.image == image, stage, scale)
            axes.set_title(shortened(residuals.images[image].name, 90 // len(chosen)))
            axes.set_xlabel(residuals.places[0])
            axes.locator_params(axis="x", nbins=3)
            if column == 0:
                axes.set_ylabel(residuals.places[1])
            else:
                axes.tick_params(labelleft=False)
            dress(axes, grid="none")
    return Drawing("residual_vectors", "Residual vectors", _CAPTION + choice(residuals, chosen), figure)


def _draw_wide(residuals: Residuals, chosen: list[int]) -> Drawing:
    """Frames: before left, after right; first all images in one frame where there are more than are shown."""
    pooled = len(chosen) < len(residuals.images)
    rows = [None] * pooled + list(chosen)
    limits = _limits(residuals)
    aspect = abs((limits[1][1] - limits[1][0]) / (limits[0][1] - limits[0][0]))
    height = min(max(4.1 * aspect, 1.6), 4.6)
    figure = new_figure(0.4 + len(rows) * (height + 0.65))
    grid = figure.add_gridspec(1 + len(rows), 2, height_ratios=[0.3] + [height + 0.55] * len(rows))
    everyone = np.ones(len(residuals), dtype=bool)
    shown = [(image, everyone if image is None else residuals.image == image) for image in rows]
    averaged = [bool(here.sum() > _CROWDED) for _, here in shown]
    for column, stage in enumerate(STAGES):
        scale = _scale(residuals, stage, "wide")
        _strip(
            figure.add_subplot(grid[0, column]), stage, scale, _ARROW_INCH["wide"], 4.6, () if all(averaged) else residuals.roles
        )
        for row, (image, here) in enumerate(shown):
            axes = figure.add_subplot(grid[1 + row, column])
            _frame(axes, residuals)
            title = f"all {len(residuals.images)} images" if image is None else shortened(residuals.images[image].name)
            if averaged[row]:
                _cells(axes, residuals, here, stage, scale)
                title += ": mean of each cell"
            else:
                _panel(axes, residuals, here, stage, scale)
            axes.set_title(title)
            axes.set_xlabel(residuals.places[0])
            axes.set_ylabel(residuals.places[1] if column == 0 else "")
            axes.tick_params(labelleft=column == 0)
            axes.locator_params(nbins=6)
            if 0.3 < aspect < 1.6:
                axes.set_aspect("equal")
            dress(axes, grid="none")
    caption = _CAPTION
    if pooled:
        caption += " The first row pools all images."
    if any(averaged):
        caption += " Where there are many points, black arrows are means over cells of the image."
    return Drawing("residual_vectors", "Residual vectors", caption + (choice(residuals, chosen) if chosen else ""), figure)


def _cells(axes: Any, residuals: Residuals, chosen: np.ndarray, stage: str, scale: float) -> None:
    """The mean arrow of each cell of the image that has three points or more."""
    place, vector = [], []
    limits = _limits(residuals)
    index = [
        np.clip(((residuals.place[:, k] - low) / (high - low) * n).astype(int), 0, n - 1)
        for k, ((low, high), n) in enumerate(zip(limits, _CELLS, strict=True))
    ]
    cell = index[0] * _CELLS[1] + index[1]
    for c in np.unique(cell[chosen]):
        here = chosen & (cell == c)
        if here.sum() >= 3:
            place.append(residuals.place[here].mean(axis=0))
            vector.append(residuals.arrows(stage)[here].mean(axis=0))
    if place:
        axes.plot(*np.array(place).T, ".", color=MUTED, markersize=2, linestyle="none")
        _arrows(axes, np.array(place), np.array(vector), scale, INK)


def _draw_scatter(residuals: Residuals) -> Drawing:
    """All points at one place of the image (a gimbal that tracks): residuals against each other."""
    figure = new_figure(4.6)
    for axes, stage in zip(figure.subplots(1, 2), STAGES, strict=True):
        value = residuals.stage(stage)
        limit = robust_limit(value)
        for role in ("check", "control"):
            here = residuals.is_control == (role == "control")
            if here.any():
                axes.plot(
                    *value[here].T, MARKER[role], color=COLOUR[role], markersize=4, alpha=0.7, linestyle="none", label=role,
                    markeredgewidth=0,
                )  # fmt: skip
        beyond = int((~(np.abs(value) <= limit)).any(axis=1).sum())
        axes.set_xlim(-limit, limit)
        axes.set_ylim(limit, -limit)
        axes.set_aspect("equal")
        axes.axhline(0, color=MUTED, linewidth=0.8)
        axes.axvline(0, color=MUTED, linewidth=0.8)
        axes.set_title(stage + (f" ({beyond} beyond the axes)" if beyond else ""))
        axes.set_xlabel(f"x residual, {residuals.words[0]} (px)")
        axes.set_ylabel(f"y residual, {residuals.words[1]} (px)")
        axes.legend(fontsize=SMALL, frameon=False, loc="upper right")
        dress(axes)
    caption = (
        "All points were measured at one place of the image, so residuals (measured − projected) are drawn against each other; "
        "a sound result is a round cloud about zero. Before and after have their own scale."
    )
    return Drawing("residual_vectors", "Residuals", caption, figure)
