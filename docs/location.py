"""The page docs/location.md and its pictures, from the results of a run.

whiskjax reproduce location --out out/location
python docs/location.py out/location        writes docs/location.md, docs/location_estimators.png and docs/location_figure_6.png
"""

import json
import shutil
import sys
from pathlib import Path

from whiskbroom import markdown

from whiskjax.show.location.study_findings import findings
from whiskjax.show.location.study_tables import tables

DOCS = Path(__file__).parent
PICTURES = {
    "estimators": "Errors of 1000 runs whose first guess is drawn from P0, and the mean NEES: relinearising takes the tail away, "
    "and an R that carries the errors of the records makes the covariance honest (grey band).",
    "figure_6": "Convergence over the looks: one run, and the mean over all.",
}


def page(summary: dict) -> str:
    """The page as Markdown; text and figures are those of the report."""
    verdict, runs = summary["verdict"], summary["runs"]
    parts = [
        "# The target location of Liu et al. (2019)",
        "Written by `python docs/location.py` from the results of `whiskjax reproduce location`, which repeats Figures 6 to 10 "
        "and Table 2 of the paper beside a simulation, and compares estimators with the Cramer-Rao bound.",
        f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it ({runs['runs']} runs a figure, seed "
        f"{runs['seed']}). Outside: {'; '.join(verdict['outside']) or 'none'}.",
    ]
    for name, caption in PICTURES.items():
        parts += [f"![{name}](location_{name}.png)", f"*{caption}*"]
    for table in tables(summary):
        parts += [f"## {table.title}", markdown(table)]
    parts.append("## What the paper contradicts or leaves out")
    for finding in findings(summary):
        parts.append(f"### {finding.title}")
        parts += [f"*Paper:* {finding.paper}"] if finding.paper else []
        parts.append(f"*Here:* {finding.here}")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    results = Path(sys.argv[1])
    (DOCS / "location.md").write_text(page(json.loads((results / "results.json").read_text("utf-8"))), "utf-8")
    for name in PICTURES:
        shutil.copy(results / f"{name}.png", DOCS / f"location_{name}.png")
