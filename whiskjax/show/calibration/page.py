"""The report of a calibration: one HTML file that needs nothing else, for a desk or a phone, by day or by night."""

from collections.abc import Sequence
from pathlib import Path

from ...estimate.reason import probability
from ..page import render
from ..plain import Summary
from ..style import Drawing
from ..tables import fixed, short, weights
from .tables import blunders, correlations, detectable, largest, parameters, residuals, sizes


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded.

    **Arguments:**

    - `summary`: from `summarise`.
    - `drawings`: from `draw_all`, of the same calibration.
    """
    tables = {
        "parameters": parameters(summary),
        "residuals": residuals(summary),
        "sizes": sizes(summary),
        "correlations": correlations(summary),
        "largest": largest(summary),
        "blunders": blunders(summary),
        "weights": weights(summary),
        "detectable": detectable(summary),
    }
    unit = {p["name"]: p["unit"] for p in summary["parameters"]}
    values = {
        "s": summary,
        "tables": tables,
        "short": short,
        "fixed": fixed,
        "probability": probability,
        "directions": [
            ", ".join(f"{v:+.2g} {unit[name]} {name}" for name, v in move.items())
            for move in summary["determined"]["null_space_of_data"]
        ],
    }
    return render(Path(__file__).with_name("page.html.jinja"), values, drawings)
