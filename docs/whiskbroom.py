"""The page docs/whiskbroom.md and its picture, from the results of a run.

whiskjax reproduce whiskbroom --out out/whiskbroom
python docs/whiskbroom.py out/whiskbroom        writes docs/whiskbroom.md and docs/whiskbroom.png
"""

import sys
from pathlib import Path

from study_page import markdown, told, write

from whiskjax.papers.whiskbroom.answer_tables import answers_table
from whiskjax.papers.whiskbroom.findings import agreement, findings
from whiskjax.papers.whiskbroom.tables import bands, swings

BLUNDERS = (
    "*Prediction error with gross errors in the control points, over that of clean ones. One dot a seed. Scattered wrong "
    "points cost no more than knowing and leaving them out; so do clusters, but for a few flights where a cluster is off by a "
    "few sigmas only.*"
)


def page(summary: dict) -> list[str]:
    """The page as Markdown, in parts; text and figures are those of the report."""
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
    first_of_all, *others = findings(summary)
    parts += [*told([first_of_all]), markdown(swings(summary)), *told(others)]
    if summary["open_questions"]:
        answers = answers_table(summary["open_questions"])
        parts += [f"## {answers.title}", markdown(answers), "![Gross errors](whiskbroom_blunders.png)", BLUNDERS]
    return parts


if __name__ == "__main__":
    write(page, Path(sys.argv[1]), "whiskbroom", {"figure_4": "whiskbroom", "open_blunders": "whiskbroom_blunders"})
