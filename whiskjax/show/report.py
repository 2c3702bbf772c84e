"""The report of a calibration: one HTML file that needs nothing else, for a desk or a phone, by day or by night."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..rules import import_extra
from .style import Drawing
from .summary import Summary, probability
from .tables import blunders, correlations, detectable, fixed, largest, parameters, residuals, short, weights


def make_report(summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded.

    **Arguments:**

    - `summary`: from `summarise`.
    - `drawings`: from `draw_all`, of the same calibration.
    """
    jinja2 = import_extra("jinja2", "app")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    tables = {
        "parameters": parameters(summary),
        "residuals": residuals(summary),
        "correlations": correlations(summary),
        "largest": largest(summary),
        "blunders": blunders(summary),
        "weights": weights(summary),
        "detectable": detectable(summary),
    }
    unit = {p["name"]: p["unit"] for p in summary["parameters"]}
    return environment.get_template("report.html.jinja").render(
        s=summary,
        tables=tables,
        figures={drawing.name: _embedded(drawing) for drawing in drawings},
        short=short,
        fixed=fixed,
        probability=probability,
        directions=[
            ", ".join(f"{v:+.2g} {unit[name]} {name}" for name, v in move.items())
            for move in summary["determined"]["null_space_of_data"]
        ],
    )


def _embedded(drawing: Drawing) -> dict[str, Any]:
    return {
        "title": drawing.title,
        "caption": drawing.caption,
        "data": base64.b64encode(drawing.png).decode("ascii"),
    }
