"""Figures 6 to 14 of Wang et al. (2018): residual vectors in plan and height, and the RMSE over the number of control points."""

from typing import Any

import numpy as np

from ...estimate.map_limits import PROFILE
from ...flights.songshan import FIELD_M
from ...show.style import CHECK, COLOUR, CONTROL, INK, MARKER, MUTED, SMALL, Drawing, dress, new_figure, round_number
from .printed import CONTROL_POINTS, PRINTED, STAGES, Row
from .runs import NOISES, SCALE, TERRAIN, Measured, Vectors

_LONGEST_M = 1_200.0  # on the map: the length of the longest vector
_TITLES = {
    "direct": "direct positioning",
    "adjusted": "block adjustment and calibration",
    "second direct": "second direct positioning",
    "third direct": "third direct positioning",
}
_CAPTIONS = {
    "direct": "Strips flown to and fro miss to opposite sides (boresight), and all points lie too low (scale of the detector).",
    "adjusted": "Nothing systematic is left. Control points, known to 2 mm, are held; check points show the errors.",
    "second direct": "Calibrated lines bring the height back, as far as their scale is right without w; boresight is missing.",
    "third direct": "With all calibrated numbers errors of POS are left: they change along the strips.",
}


def draw_charts(measured: Measured) -> list[Drawing]:
    """All of them, in the paper's order."""
    pairs = [(data, trial) for data in "AB" for trial in STAGES]
    return [*(_residuals(6 + k, *pair, measured) for k, pair in enumerate(pairs)), _figure_14(measured)]


def _residuals(number: int, data: str, trial: str, measured: Measured) -> Drawing:
    figure = new_figure(8.6)
    for row, noise in zip(figure.subplots(2, 2), NOISES, strict=True):
        _panels(row, measured.vectors[data, trial, noise], noise)
    return Drawing(
        f"figure_{number}",
        f"Figure {number}. Data set {data}: residuals after {_TITLES[trial]}",
        f"{_CAPTIONS[trial]} Above the nominal block, below the paper-like one; each panel has its own scale of vectors.",
        figure,
    )


def _panels(panels: Any, v: Vectors, noise: str) -> None:
    plan, height = panels
    longest = {plan: np.linalg.norm(v.error_m[:, :2], axis=1).max(), height: np.abs(v.error_m[:, 2]).max()}
    moves = {plan: v.error_m[:, :2], height: np.column_stack([np.zeros(len(v.error_m)), v.error_m[:, 2]])}
    for axes, what in ((plan, "plan"), (height, "height")):
        key = round_number(longest[axes])
        scale = _LONGEST_M / longest[axes]
        for role, some in (("control", ~v.is_check), ("check", v.is_check)):
            axes.quiver(
                *v.plan_m[some].T, *(scale * moves[axes][some]).T, angles="xy", scale_units="xy", scale=1, width=0.004,
                color=COLOUR[role],
            )  # fmt: skip
            axes.plot(*v.plan_m[some].T, MARKER[role], color=COLOUR[role], markersize=2.5, label=role)
        axes.quiver(-4900, 4900, scale * key, 0, angles="xy", scale_units="xy", scale=1, width=0.004, color=INK)
        axes.text(-4750 + scale * key, 4900, f"{key:g} m", va="center", fontsize=SMALL, color=INK)
        axes.set_xlim(-FIELD_M - 1200, FIELD_M + 1200)
        axes.set_ylim(-FIELD_M - 1200, FIELD_M + 1200)
        axes.set_aspect("equal")
        axes.set_xlabel("X, east (m)")
        axes.set_ylabel("Y, north (m)")
        axes.set_title(f"{noise}, {what}")
        dress(axes)
    plan.legend(fontsize=SMALL, frameon=False, loc="lower right", ncols=2)


def _figure_14(measured: Measured) -> Drawing:
    figure = new_figure(4.0)
    limit = PROFILE.limits[SCALE, TERRAIN]
    for k, (axes, name) in enumerate(zip(figure.subplots(1, 3), "XYZ", strict=True)):
        for table, data, colour, marker in ((5, "A", CONTROL, "D"), (6, "B", CHECK, "s")):
            rows = [Row(table, data, f"{n} control") for n in CONTROL_POINTS]
            lines = {"paper": [PRINTED[row][k][3] for row in rows]}
            lines |= {noise: [measured.rows[row, noise][k].rmse for row in rows] for noise in NOISES}
            for (who, rmse), style in zip(lines.items(), ("-", ":", "--"), strict=True):
                axes.plot(CONTROL_POINTS, rmse, style, marker=marker, markersize=4, color=colour, label=f"{data}, {who}")
        bound = limit.height_m if name == "Z" else limit.planimetry_m
        axes.axhline(bound, color=MUTED, linewidth=0.9)
        axes.text(11.2, bound, f"1:{SCALE}", fontsize=SMALL, color=MUTED, ha="right", va="top")
        axes.set_ylim(0, 0.8)
        axes.set_xticks(CONTROL_POINTS)
        axes.set_xlabel("control points (number)")
        axes.set_ylabel(f"RMSE along {name} (m)")
        dress(axes)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=SMALL, frameon=False)
    return Drawing(
        "figure_14",
        "Figure 14. Adjusted again with few control points",
        "With calibrated numbers a few control points do as well as many. Grey: the limit for 1:1000 on hilly ground, in "
        "planimetry for X and Y together. Nominal measurements stay far below it; those of the paper, and paper-like ones, "
        "miss it in height.",
        figure,
    )
