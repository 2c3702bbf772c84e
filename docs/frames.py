"""The drawing of every frame for docs/conventions.md.

python docs/frames.py        writes docs/frames.png
"""

import pathlib

import numpy as np
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#777777"


def arrow(axes, start, stop, text, colour, offset=(0.0, 0.0)):
    """An axis with its name at the tip."""
    axes.annotate("", stop, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2})
    away = np.subtract(stop, start) / np.hypot(*np.subtract(stop, start))
    axes.text(*(np.add(stop, 0.14 * away) + offset), text, color=colour, ha="center", va="center", fontsize=9)


def turn(axes, centre, radius, first_deg, last_deg, text, at):
    """A curved arrow in the positive sense."""
    angle = np.radians(np.linspace(first_deg, last_deg, 40))
    x, y = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
    axes.plot(x[:-3], y[:-3], color=GREY, lw=1.2)
    axes.annotate("", (x[-1], y[-1]), (x[-4], y[-4]), arrowprops={"arrowstyle": "-|>", "color": GREY})
    axes.text(*at, text, color=GREY, ha="center", va="center", fontsize=8)


def out_of_page(axes, at, text, colour, into=False):
    """An axis that points at the reader (dot) or away (cross)."""
    axes.plot(*at, "o", ms=11, mfc="white", mec=colour, mew=1.6)
    axes.plot(*at, "x" if into else ".", ms=6, color=colour)
    axes.text(at[0] - 0.16, at[1] - 0.18, text, color=colour, ha="right", va="top", fontsize=9)


def world(axes):
    """ECEF and the local frames at a point."""
    angle = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(angle), 0.92 * np.sin(angle), color=GREY)
    axes.plot(np.cos(angle), 0.2 * np.sin(angle), color=GREY, lw=0.6, ls=":")
    arrow(axes, (0, 0), (0, 1.35), "z (pole)", BLUE)
    arrow(axes, (0, 0), (1.4, 0), "y (90° E)", BLUE, (0.1, 0))
    arrow(axes, (0, 0), (-0.55, -0.5), "x (0°)", BLUE)
    point, lat = np.array([np.cos(0.8), 0.92 * np.sin(0.8)]), np.radians(50)
    up, north = np.array([np.cos(lat), np.sin(lat)]), np.array([-np.sin(lat), np.cos(lat)])
    arrow(axes, point, point + 0.5 * up, "up", GREEN)
    arrow(axes, point, point + 0.5 * north, "north", ORANGE)
    arrow(axes, point, point - 0.4 * up, "down", ORANGE)
    out_of_page(axes, point, "", ORANGE, into=True)
    axes.text(point[0] + 0.2, point[1] - 0.08, "east", color=ORANGE, fontsize=9)
    axes.set_title("World: ECEF (blue); NED (orange), ENU (up) at a point")


def body(axes):
    """Body frame from above and from behind."""
    axes.fill(
        [0, 0.09, 0.09, 0.6, 0.6, 0.09, 0, -0.09, -0.6, -0.6, -0.09, -0.09],
        [0.75, 0.5, 0.25, 0.05, -0.1, 0, -0.6, 0, -0.1, 0.05, 0.25, 0.5],
        color="#DDDDDD",
    )
    arrow(axes, (0, 0), (0, 1.0), "x forward", BLUE)
    arrow(axes, (0, 0), (0.9, 0), "y right", BLUE, (0.12, -0.1))
    out_of_page(axes, (0, 0), "z down", BLUE, into=True)
    turn(axes, (0, 0), 0.85, 80, 30, "heading +", (0.98, 0.62))
    centre = (2.6, 0.2)
    axes.fill(centre[0] + np.array([-0.75, 0.75, 0.75, -0.75]), centre[1] + np.array([0.03, 0.03, -0.03, -0.03]), color="#DDDDDD")
    axes.plot(*centre, "o", ms=16, color="#CCCCCC")
    arrow(axes, centre, (centre[0] + 0.85, centre[1]), "y right", BLUE, (0.1, 0.1))
    arrow(axes, centre, (centre[0], centre[1] - 0.8), "z down", BLUE)
    out_of_page(axes, centre, "x forward", BLUE, into=True)
    turn(axes, centre, 0.6, -8, -75, "roll +\n(right wing down)", (centre[0] + 0.85, centre[1] - 0.62))
    axes.text(1.3, -1.05, "pitch +: nose up.  ned_from_body = Rz(heading) Ry(pitch) Rx(roll)", ha="center", fontsize=8)
    axes.set_title("Body: forward, right, down (from above; from behind)")


def camera(axes):
    """The photogrammetric camera frame from the side, and the image as seen from the projection centre's far side."""
    arrow(axes, (0, 0), (0, 0.9), "z (backward)", BLUE)
    arrow(axes, (0, 0), (0.9, 0), "x", BLUE)
    out_of_page(axes, (0, 0), "y", BLUE, into=True)
    axes.plot([-0.7, 0.7], [-0.6, -0.6], color="black", lw=2)
    axes.plot([0, 0.42], [0, -0.6], color=ORANGE)
    axes.plot([0.42, 0.84], [-0.6, -1.2], color=ORANGE, ls="--")
    axes.plot(0.42, -0.6, "o", color=ORANGE)
    axes.text(0.5, -0.52, "(x, y, -f)", color=ORANGE, fontsize=9)
    axes.text(0.9, -1.15, "q, to the ground", color=ORANGE, fontsize=9)
    axes.annotate("", (-0.55, -0.6), (-0.55, 0), arrowprops={"arrowstyle": "<->", "color": GREY})
    axes.text(-0.62, -0.3, "f", color=GREY, ha="right", fontsize=9)
    axes.text(0.1, -1.5, "x = -f q$_x$/q$_z$,  y = -f q$_y$/q$_z$,  q$_z$ < 0 in front", ha="center", fontsize=8)
    axes.set_title("Camera: looks along -z")


def pixels(axes):
    """Pixel coordinates of frame and line cameras."""
    axes.fill([0, 1.5, 1.5, 0], [0, 0, 1.0, 1.0], fc="#F4F4F4", ec="black")
    arrow(axes, (0, 1.0), (0.8, 1.0), "column", GREEN, (0.2, 0.1))
    arrow(axes, (0, 1.0), (0, 0.4), "row", GREEN, (-0.1, 0))
    arrow(axes, (0.8, 0.5), (1.25, 0.5), "x", BLUE)
    arrow(axes, (0.8, 0.5), (0.8, 0.85), "y", BLUE)
    axes.text(
        0.75,
        -0.18,
        "frame: column = c$_x$ + x,  row = c$_y$ - y\ncentre of the first pixel: (0, 0)",
        ha="center",
        va="top",
        fontsize=8,
    )
    axes.plot([2.3, 3.9], [0.5, 0.5], color="black", lw=3)
    arrow(axes, (2.3, 0.5), (3.0, 0.5), "sample", GREEN, (0, 0.14))
    axes.plot(3.4, 0.78, "o", color=ORANGE)
    axes.annotate("", (3.4, 0.78), (3.4, 0.52), arrowprops={"arrowstyle": "-|>", "color": ORANGE})
    axes.text(3.48, 0.68, "line offset", color=ORANGE, fontsize=9, va="center")
    axes.text(3.1, -0.18, "line: (sample, line offset);\nthe offset is 0 at the right time", ha="center", va="top", fontsize=8)
    axes.set_title("Pixels; residual = measured - projected")


if __name__ == "__main__":
    figure = Figure(figsize=(12, 7.5), layout="constrained")
    panels = {
        world: (-1.9, 2.1, -1.1, 1.6),
        body: (-1.2, 4.2, -1.3, 1.3),
        camera: (-1.5, 1.9, -1.7, 1.2),
        pixels: (-0.4, 4.4, -0.7, 1.3),
    }
    for axes, (draw, (left, right, low, high)) in zip(figure.subplots(2, 2).ravel(), panels.items(), strict=True):
        draw(axes)
        axes.set_xlim(left, right)
        axes.set_ylim(low, high)
        axes.set_aspect("equal")
        axes.set_axis_off()
    figure.savefig(pathlib.Path(__file__).with_suffix(".png"), dpi=110)
