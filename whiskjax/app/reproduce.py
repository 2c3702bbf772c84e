"""`whiskjax reproduce`: a paper's tables and figures beside those of its simulation, over many seeds."""

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, whole_folder
from .start import start_jax

if TYPE_CHECKING:
    from ..flights.haian_study import Study
    from ..show.style import Drawing
    from ..show.summary import Summary

_DRAW = "draw and write"
_OURS = (
    "results.json",
    "report.html",
    "seeds.csv",
    *(f"table_{number}.csv" for number in range(1, 8)),
    *(f"figure_{number}.png" for number in range(3, 8)),
)

reproduce = typer.Typer(
    no_args_is_help=True, help="Repeat a paper: its tables and figures beside a simulation's, over many seeds."
)


@reproduce.callback()
def _group() -> None:
    """Keeps the paper's name a word of the command, now that there is only one."""


@reproduce.command()
@answers_failures
def whiskbroom(
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
    seeds: Annotated[int, typer.Option(min=1, help="How many simulated flights.")] = 100,
    first_seed: Annotated[int, typer.Option(min=0, help="The first of them.")] = 0,
) -> None:
    """The whiskbroom scanner with left and right swings (Jin et al. 2024): Tables 1 to 7 and Figures 3 to 7.

    Prints the tables with the paper's figures, the simulation's over the seeds, and the bands in which they should lie. Ends in 0
    only when every figure that has a band is inside.
    """
    refuse_place(out)
    start_jax()
    from .stages import Stages

    chosen = range(first_seed, first_seed + seeds)
    with Stages(*(_stage(unknowns, seed) for unknowns in (12, 15) for seed in chosen), _DRAW) as stages:
        from ..flights.haian_study import study
        from ..show.whiskbroom.charts import draw_charts
        from ..show.whiskbroom.summary import summarise

        found = study(chosen, lambda unknowns, seed: stages.enter(_stage(unknowns, seed)))
        stages.enter(_DRAW)
        summary = summarise(found, _command(out, seeds, first_seed))
        drawings = draw_charts(found)
        with whole_folder(out, _OURS) as folder:
            _write(folder, found, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if summary["verdict"]["is_inside"] else NOT_SOUND)


def _stage(unknowns: int, seed: int) -> str:
    return f"{unknowns} unknowns, seed {seed}"


def _command(out: Path, seeds: int, first_seed: int) -> str:
    words = ["whiskjax", "reproduce", "whiskbroom", "--out", str(out)]
    words += ["--seeds", str(seeds), "--first-seed", str(first_seed)]
    return shlex.join(words)


def _write(folder: Path, study: "Study", summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..show.whiskbroom.page import make_report
    from ..show.whiskbroom.tables import write_seeds, write_sheets

    text = json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    write_sheets(folder, summary)
    write_seeds(folder / "seeds.csv", study)
    for drawing in drawings:
        drawing.write(folder)
    (folder / "report.html").write_text(make_report(summary, drawings), encoding="utf-8")


def _print(summary: "Summary", out: Path) -> None:
    """Tables first, the verdict last: it is what stays in view."""
    from rich.console import Console
    from rich.text import Text

    from ..show.tables import for_terminal
    from ..show.whiskbroom.findings import findings
    from ..show.whiskbroom.tables import bands, in_order

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=120)
    for table in (*in_order(summary), bands(summary)):
        console.print(for_terminal(table))
        console.print()
    console.print(Text("What the paper contradicts or leaves open (in words in report.html):"))
    for finding in findings(summary):
        console.print(Text(f"  - {finding.title}"))
    verdict = summary["verdict"]
    console.print()
    style = "bold green" if verdict["is_inside"] else "bold red"
    console.print(Text(f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it.", style=style))
    for name in verdict["outside"]:
        console.print(Text(f"  - outside: {name}"))
    console.print(f"Written to {out}: report.html, results.json, tables and figures", soft_wrap=True, markup=False)
