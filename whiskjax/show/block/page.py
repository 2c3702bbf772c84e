"""The report of an adjusted block: one HTML file that needs nothing else."""

from collections.abc import Sequence
from pathlib import Path

from ..page import render
from ..plain import Summary
from ..style import Drawing
from ..tables import short, weights
from .tables import corrections, counts, largest, left_out, point_sigmas, residuals, sizes, standard, statistics, unknowns


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded.

    **Arguments:** `drawings`: from `draw_charts`, of the same block.
    """
    made = (counts, statistics, standard, unknowns, corrections, weights, residuals, sizes, point_sigmas, left_out, largest)
    tables = {make.__name__: make(summary) for make in made}
    return render(Path(__file__).with_name("page.html.jinja"), {"s": summary, "tables": tables, "short": short}, drawings)
