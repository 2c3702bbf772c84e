"""The report of Wang et al. (2018) as one HTML file."""

from collections.abc import Sequence

from ..page import render
from ..plain import Summary
from ..style import Drawing
from .findings import AGREEMENT, findings
from .tables import tables


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded."""
    values = {
        "s": summary,
        "tables": tables(summary),
        "drawings": drawings,
        "findings": findings(summary),
        "agreement": AGREEMENT,
    }
    return render("three_line/page.html.jinja", values, drawings)
