"""A picture of imaging chains: one row an instrument, one box a link, from the Earth to the pixel."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..chain.by import By
from ..chain.correction import Correction
from ..chain.mounts import Axes, Mount
from ..chain.sensor import Sensor
from ..chain.trajectory import PosePerImage, Trajectory
from ..chain.turn import Turn
from ..rules import import_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe-Ito: told apart by the colour-blind too. Every box also says in words what it is.
_COLOURS = {
    "Trajectory": "#56B4E9",
    "PosePerImage": "#56B4E9",
    "Mount": "#E69F00",
    "Axes": "#DDDDDD",
    "Turn": "#009E73",
    "Correction": "#CC79A7",
    "camera": "#F0E442",
}


def _words(link: Any) -> tuple[str, str]:
    """Kind and detail of a link or camera."""
    if isinstance(link, By):
        kind, _ = _words(link.options[0])
        return kind, f"by {link.key}:\n" + ", ".join(link.names)
    match link:
        case Axes():
            return "Axes", link.axes
        case Turn():
            return "Turn", f"{'-' if link.sign < 0 else ''}{link.axis}"
        case Mount():
            parts = ["lever arm"] * (link.lever_arm_m is not None) + ["angles"] * (link.angles_rad is not None)
            return "Mount", " + ".join(parts)
        case Trajectory():
            return "Trajectory", "POS in time"
        case PosePerImage():
            return "PosePerImage", "one an image"
        case Correction():
            return "Correction", type(link.basis).__name__
        case _:
            return type(link).__name__, "focal by image" if getattr(link, "per_image", False) else ""


def draw_chains(sensors: Mapping[str, Sensor]) -> "Figure":
    """Draw sensors as rows of boxes.

    **Arguments:** sensors by title.

    **Returns:** a matplotlib figure; needs the extra `plots`.
    """
    figures, patches = import_extra("matplotlib.figure", "plots"), import_extra("matplotlib.patches", "plots")
    longest = max(len(s.names) for s in sensors.values()) + 1
    figure = figures.Figure(figsize=(1.62 * longest + 2.6, 0.95 * len(sensors) + 0.9), layout="constrained")
    axes = figure.add_subplot()
    for row, (title, sensor) in enumerate(sensors.items()):
        y = -1.25 * row
        axes.text(-0.25, y, title, ha="right", va="center", fontsize=10, fontweight="bold", parse_math=False)
        boxes = [(name, *_words(sensor[name])) for name in sensor.names] + [("pixel", *_words(sensor.camera))]
        for column, (frame, kind, detail) in enumerate(boxes):
            colour = _COLOURS.get(kind, _COLOURS["camera"])
            box = patches.FancyBboxPatch(
                (column * 1.3, y - 0.42),
                1.08,
                0.84,
                boxstyle="round,pad=0.02,rounding_size=0.08",
                fc=colour,
                ec="#333333",
                lw=0.8,
            )
            axes.add_patch(box)
            axes.text(column * 1.3 + 0.54, y + 0.26, kind, ha="center", va="center", fontsize=9, color="black")
            axes.text(
                column * 1.3 + 0.54, y - 0.03, detail, ha="center", va="center", fontsize=7, color="black", parse_math=False
            )
            axes.text(
                column * 1.3 + 0.54,
                y - 0.29,
                f"to {frame}",
                ha="center",
                va="center",
                fontsize=6.5,
                style="italic",
                color="black",
                parse_math=False,
            )
            if column:
                axes.annotate("", (column * 1.3, y), (column * 1.3 - 0.2, y), arrowprops={"arrowstyle": "->", "color": "#555555"})
    axes.set_xlim(-3.0, longest * 1.3)
    axes.set_ylim(-1.25 * (len(sensors) - 1) - 0.6, 0.75)
    axes.set_axis_off()
    axes.set_title("Earth  →  camera: every instrument is a list of the same links", fontsize=12, loc="left")
    return figure
