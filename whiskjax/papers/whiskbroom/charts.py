"""Figures 3 to 7 of Jin et al. (2024): residuals of control points by their number, one seed as a line, all seeds as a band."""

from typing import Any

import numpy as np

from ...show.style import CHECK, CONTROL, MUTED, NORMAL, Drawing, dress, new_figure
from .printed import Column
from .study import Study

_CROSS = {"L2": (4, "CR", "CL"), "L3": (5, "CR", "CL"), "R2": (6, "CL", "CR"), "R3": (7, "CL", "CR")}
_SEEN = {
    "L2": "with its own parameters (CL) x and y lie around zero; with the right ones y is 9 px off and x runs through the image",
    "R2": "with its own parameters (CR) x and y lie around zero; with the left ones y is 9 px off and x runs through the image",
    "L3": "15 minutes later its own parameters (CL) still hold y to a pixel, but x has moved by 1.5 px (a drift that was tuned)",
    "R3": "15 minutes later x runs through the image even with its own parameters (CR): the boresight has turned (a drift "
    "that was tuned); by chance it has turned to where the left ones fit x better",
}
_SIDE = {"CL": "left", "CR": "right"}


def draw_charts(study: Study) -> list[Drawing]:
    """The five figures, in the paper's order."""
    return [_figure_3(study), *(_cross(study, image) for image in _CROSS)]


def _figure_3(study: Study) -> Drawing:
    figure = new_figure(4.4)
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    for j, (image, letter) in enumerate((("R2", "B"), ("L2", "C"))):
        column = Column(image, "A", "all")
        colour = CHECK if column.is_cross else CONTROL
        for k in range(2):
            _draw(panels[k, j], study, column, k, colour, "parameters from A")
        panels[0, j].set_title(f"image {letter} ({image}), a {'right' if image[0] == 'R' else 'left'} swing")
    _finish(panels)
    return Drawing(
        "figure_3",
        "Figure 3. Images B (R2) and C (L2) with the parameters from A",
        "Residuals of the right image B and the left image C with the 12 parameters estimated from the left image A. In y, C "
        f"lies around zero and B about 9 px below it: left parameters do not fit a right swing. {_reading(study)}",
        figure,
    )


def _cross(study: Study, image: str) -> Drawing:
    number, other, own = _CROSS[image]
    figure = new_figure(4.4)
    panels = figure.subplots(2, 1, sharex=True, squeeze=False)
    for k in range(2):
        for parameters, colour in ((other, CHECK), (own, CONTROL)):
            column = Column(image, parameters, "all")
            _draw(panels[k, 0], study, column, k, colour, f"with {parameters}, the {_SIDE[parameters]} parameters")
    panels[0, 0].set_title(f"image {image}, a {_SIDE[own]} swing")
    _finish(panels)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=2, fontsize=NORMAL, frameon=False, handletextpad=0.5)
    return Drawing(
        f"figure_{number}",
        f"Figure {number}. Image {image} with the left and with the right parameters",
        f"Image {image} after the calibration from L1 and R1: {_SEEN[image]}. {_reading(study)}",
        figure,
    )


def _reading(study: Study) -> str:
    lane = study.representative
    return (
        f"Line: seed {study.seeds[lane]}, whose statistics lie nearest to the medians; band: 5 % to 95 % of {len(study.seeds)} "
        "seeds. Points are numbered along the swing."
    )


def _draw(axes: Any, study: Study, column: Column, k: int, colour: str, label: str) -> None:
    residual = study.residual_px(column)[:, :, k]
    low, high = np.percentile(residual, [5, 95], axis=0)
    number = np.arange(1, residual.shape[1] + 1)
    axes.fill_between(number, low, high, color=colour, alpha=0.18, linewidth=0)
    marker = "^" if column.is_cross else "o"
    one = residual[study.representative]
    axes.plot(number, one, marker, color=colour, linestyle="-", linewidth=1.1, markersize=3.6, label=label)


def _finish(panels: Any) -> None:
    for (k, j), axes in np.ndenumerate(panels):
        axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1)
        if j == 0:
            axes.set_ylabel(f"residual {'xy'[k]} (px)")
        if k == 1:
            axes.set_xlabel("control point, numbered along the swing")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.margins(x=0.015)
        dress(axes)
