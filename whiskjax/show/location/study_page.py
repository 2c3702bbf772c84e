"""The report of the study of Liu et al. (2019) as one HTML file."""

from collections.abc import Sequence

from ..page import render
from ..plain import Summary
from ..style import Drawing
from .study_findings import findings
from .study_tables import tables


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded."""
    values = {"s": summary, "tables": tables(summary), "drawings": drawings, "findings": findings(summary)}
    return render("location/study.html.jinja", values, drawings)
