"""The report of a located target: one HTML file that needs nothing else."""

from collections.abc import Sequence
from pathlib import Path

from ..page import render
from ..plain import Summary
from ..style import Drawing
from .summary import place
from .tables import accuracy_table, largest, looks, parameters, position_table


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded.

    **Arguments:**

    - `summary`: from `summarise`.
    - `drawings`: from `draw_charts`, of the same target.
    """
    values = {
        "s": summary,
        "position": position_table(summary),
        "accuracy": accuracy_table(summary),
        "parameters": parameters(summary),
        "looks": looks(summary),
        "largest": largest(summary),
        "guess": place(summary["guess"]),
        "has_convergence": any(drawing.name == "convergence" for drawing in drawings),
    }
    return render(Path(__file__).with_name("page.html.jinja"), values, drawings)
