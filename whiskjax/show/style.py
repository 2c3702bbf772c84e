"""How figures look: one palette, one set of sizes, and PNG without touching matplotlib's global state.

Names come from files and may hold any character: no text of a figure is read as mathematics.
"""

import dataclasses
import functools
import io
import re
import unicodedata
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ..rules import import_extra

# Okabe and Ito's palette: told apart with every common colour blindness. Roles differ in shape as well.
CONTROL, CHECK, INK, MUTED, GRID = "#0072B2", "#D55E00", "#222222", "#767676", "#DDDDDD"
MARKER = {"control": "o", "check": "^"}
COLOUR = {"control": CONTROL, "check": CHECK}
WIDTH_INCH, DPI = 9.6, 150
SMALL, NORMAL, TITLE = 8.0, 9.0, 10.5


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A figure: file stem, title, one sentence on what to see, and the matplotlib figure."""

    name: str
    title: str
    caption: str
    figure: Any

    def __post_init__(self):
        _make_plain(self.figure)

    @functools.cached_property
    def png(self) -> bytes:
        """The figure as PNG, drawn once; matplotlib's version is left out, so that the same figure is the same file."""
        buffer = io.BytesIO()
        import_extra("matplotlib.backends.backend_agg", "plots").FigureCanvasAgg(self.figure)
        with warnings.catch_warnings():
            # A character that no font here has is drawn as an empty box.
            warnings.filterwarnings("ignore", message="Glyph .* missing from font")
            self.figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
        return buffer.getvalue()

    def write(self, folder: Path) -> Path:
        """Write NAME.png into a folder."""
        path = folder / f"{self.name}.png"
        path.write_bytes(self.png)
        return path


def new_figure(height_inch: float, width_inch: float = WIDTH_INCH) -> Any:
    """An empty white figure, laid out without overlaps; made without pyplot, so no global list of figures grows."""
    figure = import_extra("matplotlib.figure", "plots").Figure(
        figsize=(width_inch, height_inch), dpi=DPI, layout="constrained", facecolor="white"
    )
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.06)
    return figure


def shortened(name: str, most: int = 30) -> str:
    """A name as a figure has room for it: of a long one the beginning and the end, which tells it from its neighbours."""
    width = [2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in name]
    if sum(width) <= most:
        return name
    count, room = (most - 1) // 2, most - 1
    while count > 0 and sum(width[:count]) + sum(width[-count:]) > room:
        count -= 1
    return f"{name[:count]}…{name[-count:] if count else ''}"


def _make_plain(figure: Any) -> None:
    """No text is mathematics; powers of ten on logarithmic axes, which matplotlib writes as such, become plain text."""
    text, axes, ticker = (import_extra(f"matplotlib.{name}", "plots") for name in ("text", "axes", "ticker"))
    for panel in figure.findobj(axes.Axes):
        for axis in (panel.xaxis, panel.yaxis):
            for ticks in (axis.major, axis.minor):
                if isinstance(ticks.formatter, ticker.LogFormatterMathtext):
                    ticks.formatter = _plain_powers(ticks.formatter, ticker)
    for found in figure.findobj(text.Text):
        found.set_parse_math(False)
        found.set_usetex(False)


_SUPERSCRIPTS = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")
_POWER = re.compile(r"\^\{([-−\d]+)\}")


def _plain_powers(formatter: Any, ticker: Any) -> Any:
    """A formatter whose 10^{-3} is 10⁻³."""

    def plain(value: float, position: int | None) -> str:
        inner = formatter(value, position).removeprefix("$\\mathdefault{").removesuffix("}$")
        return _POWER.sub(lambda power: power[1].translate(_SUPERSCRIPTS), inner.replace("\\times", "×"))

    made = ticker.FuncFormatter(plain)
    made.set_locs = formatter.set_locs  # which of the ticks between powers of ten have room for a label
    return made


def dress(axes: Any, *, grid: str = "both") -> None:
    """Quiet axes: thin grey grid behind the data, no box on top and right."""
    axes.set_facecolor("white")
    axes.set_axisbelow(True)
    if grid != "none":
        axes.grid(True, axis=grid, color=GRID, linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(MUTED)
    axes.tick_params(labelsize=SMALL, colors=INK, length=3)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_size(NORMAL)
    axes.title.set_size(NORMAL)


def round_number(x: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above x."""
    if not (np.isfinite(x) and x > 0):
        return 1.0
    power = 10.0 ** np.floor(np.log10(x))
    return float(max(k * power for k in (1, 2, 5) if k * power <= x * (1 + 1e-9)))


def robust_limit(values: np.ndarray) -> float:
    """Half the range of an axis that shows ordinary values, whatever a few blunders do: all of them, or six robust sigmas."""
    size = np.abs(values[np.isfinite(values)])
    if len(size) == 0 or size.max() == 0:
        return 1.0
    spread = 1.4826 * float(np.median(size))
    return 1.08 * float(size.max() if size.max() <= 8 * spread or spread == 0 else 6 * spread)
