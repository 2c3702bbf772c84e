"""The report of a diagnosis: one HTML file that needs nothing else."""

from pathlib import Path

from ..page import render
from ..plain import Summary
from .tables import changes, findings, head


def make_report(summary: Summary) -> str:
    """The report as HTML; every figure in it comes from the summary."""
    values = {"s": summary, "findings": findings(summary), "changes": changes(summary), "head": head(summary)}
    return render(Path(__file__).with_name("page.html.jinja"), values, ())
