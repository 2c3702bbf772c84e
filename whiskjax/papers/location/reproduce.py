"""Liu et al. (2019), reproduced over many runs."""

from ..reproduction import DRAW, Enter, Reproduction
from .charts import draw_charts
from .page import page
from .runs import SECTIONS, Sizes, measure
from .tables import summarise, write_figures

STAGES = (*SECTIONS, DRAW)


def reproduce(runs: int, seed: int, command: str, enter: Enter) -> Reproduction:
    """Figures 6 to 10, Table 2, and what the paper leaves out.

    **Arguments:** `runs`: of each figure; Figure 10 has ten times as many; `command`: how it was made.
    """
    full = Sizes()
    share = runs / full.runs
    sizes = Sizes(runs, 10 * runs, max(20, round(share * full.calibrations)), max(5, round(share * full.offsets)))
    found = measure(sizes, seed, enter)
    enter(DRAW)
    summary = summarise(found, sizes, seed, command)
    return Reproduction(summary, draw_charts(found), page(summary), lambda folder: write_figures(folder / "figures.csv", summary))
