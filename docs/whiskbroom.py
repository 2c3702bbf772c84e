"""The page docs/whiskbroom.md and its picture, from the results of a run.

whiskjax reproduce whiskbroom --out out/whiskbroom
python docs/whiskbroom.py out/whiskbroom        writes docs/whiskbroom.md and docs/whiskbroom.png
"""

import json
import shutil
import sys
from pathlib import Path

from whiskjax.show.tables import Table
from whiskjax.show.whiskbroom.findings import agreement, findings
from whiskjax.show.whiskbroom.open_questions import answers_table
from whiskjax.show.whiskbroom.tables import bands, swings

DOCS = Path(__file__).parent
BLUNDERS = (
    "*Prediction error with gross errors in the control points, over that of clean ones. One dot a seed. Scattered wrong "
    "points cost no more than knowing and leaving them out; so do clusters, but for a few flights where a cluster is off by a "
    "few sigmas only.*"
)


def markdown(table: Table) -> str:
    """A table with its caption below."""
    rule = ["---:" if number else "---" for number in table.is_number]
    rows = [[cell.text.replace("|", "\\|") for cell in row] for row in table.rows]
    heads = [heading.replace(": ", ", ") for heading in table.headings]
    lines = [f"| {' | '.join(row)} |" for row in (heads, rule, *rows)]
    return "\n".join((*lines, "", table.caption))


def page(summary: dict) -> str:
    """The page as Markdown; text and figures are those of the report."""
    seeds, verdict = summary["seeds"], summary["verdict"]
    first, last = seeds["first"], seeds["first"] + seeds["count"] - 1
    parts = [
        "# The whiskbroom scanner of Jin et al. (2024)",
        "Written by `python docs/whiskbroom.py` from the results of `whiskjax reproduce whiskbroom`, which prints Tables 1 to 7 "
        "and draws Figures 3 to 7 of the paper beside a simulation.",
        f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it (seeds {first} to {last}).",
        "![Figure 4](whiskbroom.png)",
        "*Image L2 with its own (left) parameters and with those of the right swing, control points along the swing: about 9 px "
        "apart in y. Line: one seed; band: 5 % to 95 % of all.*",
        markdown(bands(summary)),
        "## What was tuned and what follows",
        *agreement(summary),
        "## What the paper contradicts or leaves open",
    ]
    for i, finding in enumerate(findings(summary)):
        parts += [f"### {finding.title}", f"*Paper:* {finding.paper}", f"*Here:* {finding.here}"]
        parts += [markdown(swings(summary))] if i == 0 else []
    if summary["open_questions"]:
        answers = answers_table(summary["open_questions"])
        parts += [f"## {answers.title}", markdown(answers), "![Gross errors](whiskbroom_blunders.png)", BLUNDERS]
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    results = Path(sys.argv[1])
    (DOCS / "whiskbroom.md").write_text(page(json.loads((results / "results.json").read_text("utf-8"))), "utf-8")
    shutil.copy(results / "figure_4.png", DOCS / "whiskbroom.png")
    if (results / "open_blunders.png").exists():
        shutil.copy(results / "open_blunders.png", DOCS / "whiskbroom_blunders.png")
