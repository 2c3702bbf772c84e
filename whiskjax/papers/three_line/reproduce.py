"""Wang et al. (2018), reproduced on simulated blocks."""

from ..reproduction import DRAW, Enter, Reproduction
from .charts import draw_charts
from .page import page
from .runs import SECTIONS, Sizes, measure
from .tables import summarise, write_tables

STAGES = (*SECTIONS, DRAW)


def reproduce(ties: int | None, seeds: int, seed: int, command: str, enter: Enter) -> Reproduction:
    """Tables 1 to 6, Figures 6 to 14, and what is beyond them.

    **Arguments:** `ties`: tie points of the tables, or None for as many as the paper has; `command`: how it was made.
    """
    full = Sizes()
    sizes = Sizes(ties, full.few_ties if ties is None else min(ties, full.few_ties), seeds, min(seeds, full.few_seeds))
    found = measure(sizes, seed, enter)
    enter(DRAW)
    summary = summarise(found, sizes, seed, command)
    return Reproduction(summary, draw_charts(found), page(summary), lambda folder: write_tables(folder, summary))
