"""`whiskjax reproduce location`: Liu et al. (2019) beside its simulation."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .print_study import bands_sentence, print_study
from .start import start_jax

if TYPE_CHECKING:
    from ..show.plain import Summary
    from ..show.style import Drawing

_DRAW = "draw and write"
_FIGURES = ("figure_6", "figure_7", "figure_8", "figure_9", "figure_10", "table_2", "estimators", "constant_errors")
_OURS = ("results.json", "report.html", "figures.csv", *(f"{name}.png" for name in _FIGURES))


@answers_failures
def location(
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    runs: Annotated[
        int, typer.Option(min=20, help="How many runs each figure is made of; Figure 10 has ten times as many.")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 1,
) -> None:
    """Target location from many oblique looks (Liu et al. 2019): Figures 6 to 10, Table 2, and what the paper leaves out.

    Prints the paper's figures, the simulation's and the bands in which they should lie, and the table of estimators with the
    Cramer-Rao bound. Ends in 0 only when every figure that has a band is inside.
    """
    refuse_place(out, _OURS)
    start_jax()
    from ..flights.tianshan_paper import SECTIONS
    from .stages import Stages

    with Stages(*SECTIONS, _DRAW) as stages:
        from ..flights.tianshan_paper import Sizes, measure
        from ..show.location.study_charts import draw_charts
        from ..show.location.study_tables import summarise

        full = Sizes()
        share = runs / full.runs
        sizes = Sizes(runs, 10 * runs, max(20, round(share * full.calibrations)), max(5, round(share * full.offsets)))
        found = measure(sizes, seed, stages.enter)
        stages.enter(_DRAW)
        words = ["whiskjax", "reproduce", "location", "--out", str(out), "--runs", str(runs), "--seed", str(seed)]
        summary = summarise(found, sizes, seed, command_text(words))
        drawings = draw_charts(found)
        with result_folder(out, _OURS) as folder:
            _write(folder, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if summary["verdict"]["is_inside"] else NOT_SOUND)


def _write(folder: Path, summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..show.location.study_page import make_report
    from ..show.location.study_tables import write_figures

    write_figures(folder / "figures.csv", summary)
    write_report(folder, summary, drawings, make_report(summary, drawings))


def _print(summary: "Summary", out: Path) -> None:
    from ..show.location.study_findings import findings
    from ..show.location.study_tables import tables

    verdict = summary["verdict"]
    print_study(tables(summary), findings(summary), [bands_sentence(verdict)], verdict["outside"], out)
