"""The page docs/three_line.md and its pictures, from the results of a run.

whiskjax reproduce three-line --out out/three_line
python docs/three_line.py out/three_line        writes docs/three_line.md, docs/three_line_figure_9.png and _figure_14.png
"""

import sys
from pathlib import Path

from study_page import pictures, sections, told, write

from whiskjax.papers.three_line.findings import AGREEMENT, findings
from whiskjax.papers.three_line.tables import tables

PICTURES = {
    "figure_9": "Data set A after the third direct positioning: nominal above, paper-like below; plan and height.",
    "figure_14": "RMSE of check points over the number of control points, with the limits for 1:1000.",
}


def page(summary: dict) -> list[str]:
    """The page as Markdown, in parts; text and figures are those of the report."""
    verdict, runs = summary["verdict"], summary["runs"]
    return [
        "# The three-line camera of Wang et al. (2018)",
        "Written by `python docs/three_line.py` from the results of `whiskjax reproduce three-line`, which repeats Tables 1 to 6 "
        "and Figures 6 to 14 of the paper beside a simulation, and measures what the paper leaves open.",
        f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it (tables: seed {runs['seed']}; beyond "
        f"them: {runs['few_ties']} ties, or all, and {runs['few_seeds']} to {runs['seeds']} seeds). Outside: "
        f"{'; '.join(verdict['outside']) or 'none'}.",
        *pictures(PICTURES, "three_line"),
        *sections(tables(summary)),
        "## What was tuned and what follows",
        *AGREEMENT,
        "## What the paper contradicts or leaves out",
        *told(findings(summary)),
    ]


if __name__ == "__main__":
    write(page, Path(sys.argv[1]), "three_line", {name: f"three_line_{name}" for name in PICTURES})
