"""The page docs/three_line.md and its pictures, from the results of a run.

whiskjax reproduce three-line --out out/three_line
python docs/three_line.py out/three_line        writes docs/three_line.md, docs/three_line_figure_9.png and _figure_14.png
"""

import json
import shutil
import sys
from pathlib import Path

from whiskbroom import markdown

from whiskjax.show.three_line.findings import AGREEMENT, findings
from whiskjax.show.three_line.tables import tables

DOCS = Path(__file__).parent
PICTURES = {
    "figure_9": "Data set A after the third direct positioning: nominal above, paper-like below; plan and height.",
    "figure_14": "RMSE of check points over the number of control points, with the limits for 1:1000.",
}


def page(summary: dict) -> str:
    """The page as Markdown; text and figures are those of the report."""
    verdict, runs = summary["verdict"], summary["runs"]
    parts = [
        "# The three-line camera of Wang et al. (2018)",
        "Written by `python docs/three_line.py` from the results of `whiskjax reproduce three-line`, which repeats Tables 1 to 6 "
        "and Figures 6 to 14 of the paper beside a simulation, and measures what the paper leaves open.",
        f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it (tables: seed {runs['seed']}; beyond "
        f"them: {runs['few_ties']} ties, up to {runs['seeds']} seeds). Outside: {'; '.join(verdict['outside']) or 'none'}.",
    ]
    for name, caption in PICTURES.items():
        parts += [f"![{name}](three_line_{name}.png)", f"*{caption}*"]
    for table in tables(summary):
        parts += [f"## {table.title}", markdown(table)]
    parts += ["## What was tuned and what follows", *AGREEMENT, "## What the paper contradicts or leaves out"]
    for finding in findings(summary):
        parts.append(f"### {finding.title}")
        parts += [f"*Paper:* {finding.paper}"] if finding.paper else []
        parts.append(f"*Here:* {finding.here}")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    results = Path(sys.argv[1])
    (DOCS / "three_line.md").write_text(page(json.loads((results / "results.json").read_text("utf-8"))), "utf-8")
    for name in PICTURES:
        shutil.copy(results / f"{name}.png", DOCS / f"three_line_{name}.png")
