"""The report of the study as one HTML file."""

from collections.abc import Sequence

from ..page import render
from ..plain import Summary
from ..style import Drawing
from .findings import agreement, findings
from .open_questions import NAMES, answers_table
from .tables import bands, in_order, swings


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded.

    **Arguments:**

    - `summary`: from `summarise`.
    - `drawings`: from `draw_charts`, of the same study.
    """
    values = {
        "s": summary,
        "bands": bands(summary),
        "tables": in_order(summary),
        "swings": swings(summary),
        "drawings": drawings,
        "agreement": agreement(summary),
        "findings": findings(summary),
        "answers": answers_table(summary["open_questions"]) if summary["open_questions"] else None,
        "is_answer": lambda drawing: drawing.name in NAMES,
    }
    return render("whiskbroom/page.html.jinja", values, drawings)
