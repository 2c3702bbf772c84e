"""`whiskjax reproduce three-line`: Wang et al. (2018) beside its simulation."""

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
_SHEETS = ("tables.csv", "table_3.csv", "limits.csv", "figures.csv")
_OURS = ("results.json", "report.html", *_SHEETS, *(f"figure_{number}.png" for number in range(6, 15)))


@answers_failures
def three_line(
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    seed: Annotated[int, typer.Option(min=0, help="Of the flights of the tables.")] = 0,
    seeds: Annotated[int, typer.Option(min=2, help="How many flights lever arm and boresight are judged by.")] = 16,
    ties: Annotated[
        int | None, typer.Option(min=100, help="Tie points of the tables; by default as many as the paper has.")
    ] = None,
) -> None:
    """The three-line camera over Songshan (Wang et al. 2018): Tables 1 to 6, Figures 6 to 14, and what the paper leaves out.

    Prints the paper's figures, those of two simulated flights (nominal and paper-like) and the bands in which they should lie.
    Ends in 0 only when every figure that has a band is inside.
    """
    refuse_place(out, _OURS)
    start_jax()
    from ..flights.songshan_paper import SECTIONS
    from .stages import Stages

    with Stages(*SECTIONS, _DRAW) as stages:
        from ..flights.songshan_paper import Sizes, measure
        from ..show.three_line.charts import draw_charts
        from ..show.three_line.tables import summarise

        full = Sizes()
        sizes = Sizes(ties, full.few_ties if ties is None else min(ties, full.few_ties), seeds, min(seeds, full.few_seeds))
        found = measure(sizes, seed, stages.enter)
        stages.enter(_DRAW)
        words = ["whiskjax", "reproduce", "three-line", "--out", str(out), "--seed", str(seed), "--seeds", str(seeds)]
        words += [] if ties is None else ["--ties", str(ties)]
        summary = summarise(found, sizes, seed, command_text(words))
        drawings = draw_charts(found)
        with result_folder(out, _OURS) as folder:
            _write(folder, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if summary["verdict"]["is_inside"] else NOT_SOUND)


def _write(folder: Path, summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..show.three_line.page import make_report
    from ..show.three_line.tables import write_tables

    write_tables(folder, summary)
    write_report(folder, summary, drawings, make_report(summary, drawings))


def _print(summary: "Summary", out: Path) -> None:
    from ..show.three_line.findings import findings
    from ..show.three_line.tables import tables

    verdict = summary["verdict"]
    print_study(tables(summary), findings(summary), [bands_sentence(verdict)], verdict["outside"], out, width=160)
