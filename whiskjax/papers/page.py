"""A reproduced paper as people see it: the same page for every paper, and the same words in the terminal."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..show.page import render
from ..show.plain import Summary
from ..show.style import Drawing
from ..show.tables import Table
from .finding import Finding


class Paper(NamedTuple):
    """What a summary of a reproduction has to tell.

    - `about`: what the paper does, and what the simulation had to supply; `made_of`: seeds and runs, in sentences.
    - `tables`: in the order of the paper; `drawn`: which of its figures the drawings repeat.
    - `agreement`: what was tuned, and what follows; `findings`: what the paper contradicts or leaves out.
    - `beyond`: a table of what was asked beyond the paper, with the names of its drawings.
    """

    about: str
    made_of: Sequence[str]
    tables: Sequence[Table]
    drawn: str
    findings: Sequence[Finding]
    agreement: Sequence[str] = ()
    beyond: Table | None = None
    drawn_beyond: Sequence[str] = ()


def sentences(verdict: Summary) -> list[str]:
    """How many figures are inside of their bands, in the paper's tables and beyond them."""
    said = [f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it."]
    if verdict.get("open_asked"):
        asked = verdict["open_asked"]
        said.append(f"{verdict['open_met']} of {asked} figures with a band are inside it among the open questions.")
    return said


def outside(verdict: Summary) -> list[str]:
    """The figures that are not, by name."""
    return [*verdict["outside"], *verdict.get("open_missed", ())]


def make_report(paper: Paper, summary: Summary, drawings: Sequence[Drawing]) -> str:
    """The report as HTML; every figure in it comes from the summary, images are embedded."""
    values = {"s": summary, "paper": paper, "drawings": drawings, "outside": outside(summary["verdict"])}
    return render(Path(__file__).with_name("page.html.jinja"), values, drawings)
