"""The page docs/location.md and its pictures, from the results of a run.

whiskjax reproduce location --out out/location
python docs/location.py out/location        writes docs/location.md, docs/location_estimators.png and docs/location_figure_6.png
"""

import sys
from pathlib import Path

from study_page import pictures, sections, told, write

from whiskjax.papers.location.findings import findings
from whiskjax.papers.location.tables import tables

PICTURES = {
    "estimators": "Errors of 1000 runs whose first guess is drawn from P0, and the mean NEES: relinearising takes the tail away, "
    "and an R that carries the errors of the records makes the covariance honest (grey band).",
    "figure_6": "Convergence over the looks: one run, and the mean over all.",
}


def page(summary: dict) -> list[str]:
    """The page as Markdown, in parts; text and figures are those of the report."""
    verdict, runs = summary["verdict"], summary["runs"]
    return [
        "# The target location of Liu et al. (2019)",
        "Written by `python docs/location.py` from the results of `whiskjax reproduce location`, which repeats Figures 6 to 10 "
        "and Table 2 of the paper beside a simulation, and compares estimators with the Cramer-Rao bound.",
        f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it ({runs['runs']} runs a figure, seed "
        f"{runs['seed']}). Outside: {'; '.join(verdict['outside']) or 'none'}.",
        *pictures(PICTURES, "location"),
        *sections(tables(summary)),
        "## What the paper contradicts or leaves out",
        *told(findings(summary)),
    ]


if __name__ == "__main__":
    write(page, Path(sys.argv[1]), "location", {name: f"location_{name}" for name in PICTURES})
