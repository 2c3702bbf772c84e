"""Figures 6 to 10 and Table 2 of Liu et al. (2019) as drawings, and how the estimators compare."""

from typing import Any

import numpy as np

from ...show.style import CHECK, CONTROL, INK, MUTED, SMALL, Drawing, dress, new_figure
from .runs import (
    FIGURE_7_OFF_M,
    FIGURE_8A_HEIGHT_M,
    FIGURE_8B,
    FIGURE_9_HEIGHT_M,
    FIGURE_9_OFF_NADIR_DEG,
    FLOWN,
    Measured,
)
from .study import Trial

_THIRD, _FOURTH = "#009E73", "#CC79A7"
_CLOUD = 3000


def draw_charts(measured: Measured) -> list[Drawing]:
    """All of them, in the paper's order."""
    of = (_figure_6, _figure_7, _figure_8, _figure_9, _figure_10, _table_2, _estimators, _constant)
    return [draw(measured) for draw in of]


def _mean_track(trial: Trial) -> np.ndarray:
    return np.linalg.norm(trial.track_enu_m, axis=-1).mean(axis=0)


def _over_looks(axes: Any, track: np.ndarray, colour: str, label: str, style: str = "-", width: float = 1.5) -> None:
    axes.plot(np.arange(1, len(track) + 1), track, style, color=colour, linewidth=width, label=label)


def _figure_6(measured: Measured) -> Drawing:
    figure = new_figure(3.9)
    left, right = figure.subplots(1, 2)
    one = measured.trials["orbit 180"].track_enu_m[0]
    for k, (name, colour) in enumerate((("east", CONTROL), ("north", CHECK), ("up", _THIRD))):
        _over_looks(left, one[:, k], colour, name, width=1.1)
    left.axhline(0, color=MUTED, linewidth=0.8)
    left.set_ylim(-60, 60)
    left.set_ylabel("error of the estimate (m)")
    left.set_title("one run on the orbit")
    for name, colour in (("orbit 180", CONTROL), ("race 180", CHECK)):
        _over_looks(right, _mean_track(measured.trials[name]), colour, name.split()[0])
    right.plot([180], [2.86], "D", color=INK, markersize=5, label="paper, one draw (2.86 m)")
    right.axhline(10, color=MUTED, linewidth=0.8, linestyle="--")
    right.text(178, 10.5, "paper: below 10 m from look 40 on", ha="right", fontsize=SMALL, color=MUTED)
    right.set_yscale("log")
    right.set_ylabel("mean error in space (m)")
    right.set_title("mean over the runs")
    for axes in (left, right):
        axes.set_xlabel("looks")
        axes.legend(fontsize=SMALL, frameon=False, loc="upper right")
        dress(axes)
    return Drawing(
        "figure_6",
        "Figure 6. Convergence of the error over the looks",
        "The filter as printed converges like the root of the number of looks; an orbit, which sees the target from all sides, "
        "is better than a leg to and fro. The paper's 2.86 m is one draw of a distribution whose mean is 2.5 m.",
        figure,
    )


def _figure_7(measured: Measured) -> Drawing:
    figure = new_figure(3.6)
    axes = figure.subplots()
    shown = [off for off in FIGURE_7_OFF_M if off in (-2200, -1000, 0, 1000, 2000, 2200)]
    colours = (CONTROL, "#56B4E9", INK, "#E69F00", CHECK, _FOURTH)
    for off, colour in zip(shown, colours, strict=True):
        _over_looks(axes, _mean_track(measured.trials[f"guess {off:+d}"]), colour, f"{off:+d} m".replace("-", "−"))
    axes.axhline(10, color=MUTED, linewidth=0.8, linestyle="--")
    axes.set_yscale("log")
    axes.set_xlabel("looks")
    axes.set_ylabel("mean error in space (m)")
    axes.legend(title="first height off by", title_fontsize=SMALL, fontsize=SMALL, frameon=False, ncols=2)
    dress(axes)
    return Drawing(
        "figure_7",
        "Figure 7. A wrong first height",
        "However wrong the height of the first guess, the mean error is below 10 m (dashed) after 40 looks, as the paper says; a "
        "surface that is too high costs more than one that is too low.",
        figure,
    )


def _figure_8(measured: Measured) -> Drawing:
    figure = new_figure(3.4)
    left, right = figure.subplots(1, 2)
    heights = np.array(FIGURE_8A_HEIGHT_M)
    left.plot(heights / 1000, [measured.trials[f"height {h}"].mean_m for h in heights], "o-", color=CONTROL, markersize=4)
    left.axhline(10, color=MUTED, linewidth=0.8, linestyle="--")
    left.set_xlabel("height of the platform (km)")
    left.set_ylabel("mean error after 40 looks (m)")
    left.set_title("a. 45 deg off nadir")
    angles = list(FIGURE_8B)
    reached = [measured.trials[f"off-nadir {a}"].mean_m for a in angles]
    oracle = np.array(list(FIGURE_8B.values()))
    right.fill_between(angles, 0.88 * oracle, 1.12 * oracle, color=MUTED, alpha=0.2, linewidth=0, label="band")
    right.plot(angles, reached, "o-", color=CONTROL, markersize=4, label="here")
    right.axhline(20, color=MUTED, linewidth=0.8, linestyle="--")
    right.set_xlabel("off-nadir angle (deg)")
    right.set_ylabel("mean error after 40 looks (m)")
    right.set_yscale("log")
    right.set_yticks([5, 10, 20, 40], ["5", "10", "20", "40"])
    right.minorticks_off()
    right.set_title("b. 10 km")
    right.legend(fontsize=SMALL, frameon=False, loc="upper left")
    for axes in (left, right):
        dress(axes)
    return Drawing(
        "figure_8",
        "Figure 8. Height of the platform and off-nadir angle",
        "The error grows with the height and is least near 25 to 35 deg; dashed is what the paper claims (10 m over all "
        "heights, 20 m over all angles): it holds up to 13 km, and up to 65 deg.",
        figure,
    )


def _figure_9(measured: Measured) -> Drawing:
    figure = new_figure(3.4, 6.4)
    axes = figure.subplots()
    colours = (CONTROL, "#56B4E9", _THIRD, "#E69F00", CHECK)
    for height, colour in zip(FIGURE_9_HEIGHT_M, colours, strict=True):
        median = [float(np.median(measured.trials[f"grid {height} {a}"].distance_m)) for a in FIGURE_9_OFF_NADIR_DEG]
        axes.plot(FIGURE_9_OFF_NADIR_DEG, median, "o-", color=colour, markersize=4, label=f"{height / 1000:g} km")
    axes.axhline(20, color=MUTED, linewidth=0.8, linestyle="--")
    axes.set_yscale("log")
    axes.set_yticks([3, 5, 10, 20, 50], ["3", "5", "10", "20", "50"])
    axes.minorticks_off()
    axes.set_xlabel("off-nadir angle (deg)")
    axes.set_ylabel("median error after 40 looks (m)")
    axes.legend(title="platform at", title_fontsize=SMALL, fontsize=SMALL, frameon=False)
    dress(axes)
    return Drawing(
        "figure_9",
        "Figure 9. Height and off-nadir angle together",
        "At 75 deg the paper's 20 m (dashed) are kept by the two lowest platforms only: 40 looks 500 m apart span too small an "
        "angle. With looks 1 km apart, 10 km come to 20 m.",
        figure,
    )


def _figure_10(measured: Measured) -> Drawing:
    figure = new_figure(4.2)
    panels = figure.subplots(1, 2)
    titles = {"one look": ("a. one look onto the ellipsoid, height ±30 m", 130.0), "orbit": ("b. 40 looks", 15.0)}
    for axes, (name, (title, paper)) in zip(panels, titles.items(), strict=True):
        cloud = measured.clouds[name]
        cep = float(np.median(np.hypot(cloud[:, 0], cloud[:, 1])))
        axes.plot(cloud[:_CLOUD, 0], cloud[:_CLOUD, 1], ".", color=CONTROL, markersize=1.6, alpha=0.45)
        turn = np.linspace(0, 2 * np.pi, 200)
        axes.plot(cep * np.cos(turn), cep * np.sin(turn), color=CHECK, linewidth=1.6, label=f"CEP50 here, {cep:.3g} m")
        axes.plot(
            paper * np.cos(turn), paper * np.sin(turn), "--", color=INK, linewidth=1.2, label=f"CEP of the paper, {paper:g} m"
        )
        limit = 3.2 * max(cep, 0.6 * paper)
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal", xlabel="error east (m)", ylabel="error north (m)")
        axes.set_title(title)
        axes.legend(fontsize=SMALL, frameon=False, loc="upper left")
        dress(axes)
    return Drawing(
        "figure_10",
        "Figure 10. The ellipsoid model and the filter, 68.2 deg off nadir",
        f"Horizontal errors of {_CLOUD} runs. 40 looks agree with the paper; one look is better here than the paper says: its "
        "130 m would ask for a height known to 69 m instead of 30 m (1-sigma). The cloud of one look is long in the direction "
        "of the look.",
        figure,
    )


def _table_2(measured: Measured) -> Drawing:
    figure = new_figure(3.4, 6.4)
    axes = figure.subplots()
    for angle, colour in zip(FLOWN, (CONTROL, "#E69F00", CHECK), strict=True):
        track = np.median(np.linalg.norm(measured.trials[f"fly {angle:g}"].track_enu_m, axis=-1), axis=0)
        _over_looks(axes, track, colour, f"{angle:g} deg")
    axes.axhspan(30, 32.5, color=MUTED, alpha=0.4, linewidth=0)
    axes.text(1.5, 25, "Table 2: 30 and 32.5 m", fontsize=SMALL, color=INK)
    axes.set_yscale("log")
    axes.set_xlabel("looks")
    axes.set_ylabel("median error in space (m)")
    axes.legend(title="off nadir", title_fontsize=SMALL, fontsize=SMALL, frameon=False)
    dress(axes)
    return Drawing(
        "table_2",
        "Table 2. A straight flight at 9.8 km",
        "The two errors of the flight test fit looks at about 74 deg; at 78 deg, which the text names, 40 looks leave 50 m and "
        "more.",
        figure,
    )


def _estimators(measured: Measured) -> Drawing:
    figure = new_figure(3.6)
    left, right = figure.subplots(1, 2)
    names = ("as printed", "extended, full R", "iterated, full R", "batch, full R")
    colours = (CHECK, "#E69F00", CONTROL, _THIRD)
    figures = {f.what: f.reached for f in measured.figures if f.section == "estimators"}
    bound = figures["orbit, 40 looks, first guess from P0: Cramer-Rao bound"]
    for name, colour in zip(names, colours, strict=True):
        distance = np.sort(measured.trials[name].distance_m)
        left.plot(distance, np.arange(1, len(distance) + 1) / len(distance), color=colour, linewidth=1.5, label=name)
    left.axvline(bound, color=MUTED, linewidth=0.9, linestyle="--")
    left.text(bound * 1.1, 0.03, "bound (RMSE)", fontsize=SMALL, color=MUTED)
    left.set_xscale("log")
    left.set_xlabel("error in space after 40 looks (m)")
    left.set_ylabel("share of the runs (no unit)")
    left.legend(fontsize=SMALL, frameon=False, loc="center right")
    nees = [figures[f"{name}: NEES of 3 states"] for name in names]
    right.bar(range(4), nees, color=colours, width=0.6)
    right.axhspan(2.65, 3.45, color=MUTED, alpha=0.35, linewidth=0)
    right.set_yscale("log")
    right.set_xticks(range(4), [name.replace(", ", ",\n") for name in names])
    right.set_ylabel("mean NEES of 3 states (no unit)")
    for axes in (left, right):
        dress(axes)
    return Drawing(
        "estimators",
        "The estimators, first guess drawn from P0",
        "Left: carrying the errors of the records in R changes the usual error little, but relinearising takes the tail away. "
        "Right: the covariance of the printed filter is wrong beyond measure, that of the iterated filter and the batch is "
        "honest (grey band).",
        figure,
    )


def _constant(measured: Measured) -> Drawing:
    figure = new_figure(3.4)
    axes = figure.subplots()
    for name, colour in (("as printed", CHECK), ("considered (Schmidt)", "#E69F00"), ("estimated", CONTROL)):
        track = measured.trials[f"constant 180 {name}"].track_enu_m
        _over_looks(axes, np.sqrt((track**2).sum(axis=-1).mean(axis=0)), colour, name)
        reached = next(f.reached for f in measured.figures if f.what == f"180 looks, {name}: NEES")
        axes.text(
            182,
            np.sqrt((track[:, -1] ** 2).sum(axis=-1).mean()),
            f"NEES {reached:.2g}",
            fontsize=SMALL,
            color=colour,
            va="center",
        )
    axes.set_xlim(0, 215)
    axes.set_yscale("log")
    axes.set_ylim(7, 200)
    axes.set_yticks([10, 20, 50, 100], ["10", "20", "50", "100"])
    axes.minorticks_off()
    axes.set_xlabel("looks")
    axes.set_ylabel("RMSE in space (m)")
    axes.legend(fontsize=SMALL, frameon=False)
    dress(axes)
    return Drawing(
        "constant_errors",
        "Attitude and gimbal errors that stay the same in all looks",
        "Ignored, they leave a floor of which the covariance knows nothing; considered, the floor is known; estimated with the "
        "target, it goes on falling.",
        figure,
    )
