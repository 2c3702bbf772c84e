"""The correlations of the unknowns as a heat map: which of them the data cannot tell apart."""

import numpy as np

from ..plain import Summary
from ..style import INK, NORMAL, SMALL, WIDTH_INCH, Drawing, new_figure, shortened

_WITH_VALUES = 32


def draw_correlations(summary: Summary) -> Drawing:
    """Lower triangle of the correlation matrix, with names and values."""
    names = [shortened(name) for name in summary["correlation"]["names"]]
    strong = summary["correlation"]["threshold"]
    k = len(names)
    rho = np.array([[np.nan if x is None else x for x in row] for row in summary["correlation"]["matrix"]]).reshape(k, k)
    shown = np.where(np.tri(k, k=-1, dtype=bool), rho, np.nan)[1:, :-1] if k > 1 else rho
    beside = k < 6  # a small map has no room for its colour bar in the empty corner
    room = 0.09 * max(len(name) for name in names)
    cell = min(0.6, (WIDTH_INCH - room - 0.3 - 0.9 * beside) / max(k - 1, 1))
    size = max(k - 1, 1) * cell
    turned = room > cell
    upright = room if turned else 0.25
    figure = new_figure(max(size + upright + 0.3, 1.6), max(size + room + 0.3 + 1.2 * beside, 3.0))
    axes = figure.subplots()
    colours = axes.imshow(shown, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_facecolor("white")
    rows, columns = (names[1:], names[:-1]) if k > 1 else (names, names)
    font = min(NORMAL, max(4.0, 19 * cell))
    axes.set_xticks(range(len(columns)), columns, rotation=90 if turned else 0, fontsize=max(font, 5.5))
    axes.set_yticks(range(len(rows)), rows, fontsize=max(font, 5.5))
    axes.tick_params(length=0, colors=INK)
    for side in axes.spines.values():
        side.set_visible(False)
    if k <= _WITH_VALUES:
        for i, j in zip(*np.nonzero(np.isfinite(shown)), strict=True):
            value = float(shown[i, j])
            axes.text(
                j, i, _two_digits(value), ha="center", va="center", fontsize=font if abs(value) > strong else 0.9 * font,
                color="white" if abs(value) > 0.65 else INK, fontweight="bold" if abs(value) > strong else "normal",
            )  # fmt: skip
    if beside:
        bar = figure.colorbar(colours, ax=axes, aspect=12, pad=0.04, ticks=[-1, 0, 1])
    else:
        corner = axes.inset_axes((0.6, 0.9, 0.36, 0.03))
        bar = figure.colorbar(colours, cax=corner, orientation="horizontal", ticks=[-1, 0, 1])
    bar.set_label("correlation (no unit)", fontsize=NORMAL)
    bar.ax.tick_params(labelsize=SMALL, colors=INK)
    bar.outline.set_visible(False)
    n = len(summary["correlation"]["strong"])
    caption = (
        "Correlation of each pair of unknowns after the calibration: dark red and dark blue pairs act alike on the image, and "
        f"only their combination is known. Bold: above {strong}, {n} pair{'' if n == 1 else 's'}. Values are cut, not rounded, "
        "after two decimals; all digits are in results.json."
    )
    if not np.isfinite(rho).all():
        caption += " Empty rows and columns belong to unknowns that nothing determines."
    return Drawing("correlations", "Correlations of the unknowns", caption, figure)


def _two_digits(value: float) -> str:
    """-0.998 as −.99: cut, so that only an exact 1 says 1."""
    cut = np.trunc(abs(value) * 100 + 1e-9) / 100
    text = f"{cut:.2f}"
    return ("−" if value < 0 and cut > 0 else "") + (text[1:] if cut < 1 else "1")
