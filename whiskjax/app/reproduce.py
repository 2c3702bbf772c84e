"""`whiskjax reproduce`: a paper's tables and figures beside those of its simulation."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..papers import location as location_paper
from ..papers import three_line as three_line_paper
from ..papers import whiskbroom as whiskbroom_paper
from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .start import start_jax

if TYPE_CHECKING:
    from ..papers.reproduction import Enter, Reproduction

reproduce = typer.Typer(
    no_args_is_help=True, help="Repeat a paper: its tables and figures beside a simulation's, over many seeds."
)
Out = Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")]


@reproduce.command()
@answers_failures
def whiskbroom(
    out: Out,
    seeds: Annotated[int, typer.Option(min=1, help="How many simulated flights.")] = 100,
    first_seed: Annotated[int, typer.Option(min=0, help="The first of them.")] = 0,
    open_questions: Annotated[
        bool,
        typer.Option(help="Also what the paper leaves open: weights, drift, blunders, which model, POS errors (minutes)."),
    ] = True,
) -> None:
    """The whiskbroom scanner with left and right swings (Jin et al. 2024): Tables 1 to 7 and Figures 3 to 7.

    Prints the tables with the paper's figures, the simulation's over the seeds, and the bands in which they should lie; then what
    the paper leaves open, each figure beside its band. Ends in 0 only when every figure that has a band or a bound is inside.
    """
    refuse_place(out, whiskbroom_paper.FILES)
    start_jax()
    from ..papers.whiskbroom.reproduce import reproduce, stages

    chosen = range(first_seed, first_seed + seeds)
    words = ["whiskbroom", "--out", str(out), "--seeds", str(seeds), "--first-seed", str(first_seed)]
    words += [] if open_questions else ["--no-open-questions"]
    make = lambda command, enter: reproduce(chosen, open_questions, command, enter)
    _run(out, whiskbroom_paper.FILES, words, stages(chosen, open_questions), make)


@reproduce.command("three-line")
@answers_failures
def three_line(
    out: Out,
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
    refuse_place(out, three_line_paper.FILES)
    start_jax()
    from ..papers.three_line.reproduce import STAGES, reproduce

    words = ["three-line", "--out", str(out), "--seed", str(seed), "--seeds", str(seeds)]
    words += [] if ties is None else ["--ties", str(ties)]
    make = lambda command, enter: reproduce(ties, seeds, seed, command, enter)
    _run(out, three_line_paper.FILES, words, STAGES, make, width=160)


@reproduce.command()
@answers_failures
def location(
    out: Out,
    runs: Annotated[
        int, typer.Option(min=20, help="How many runs each figure is made of; Figure 10 has ten times as many.")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 1,
) -> None:
    """Target location from many oblique looks (Liu et al. 2019): Figures 6 to 10, Table 2, and what the paper leaves out.

    Prints the paper's figures, the simulation's and the bands in which they should lie, and the table of estimators with the
    Cramer-Rao bound. Ends in 0 only when every figure that has a band is inside.
    """
    refuse_place(out, location_paper.FILES)
    start_jax()
    from ..papers.location.reproduce import STAGES, reproduce

    words = ["location", "--out", str(out), "--runs", str(runs), "--seed", str(seed)]
    _run(out, location_paper.FILES, words, STAGES, lambda command, enter: reproduce(runs, seed, command, enter))


def _run(
    out: Path,
    files: tuple[str, ...],
    words: Sequence[str],
    stages: Sequence[str],
    make: "Callable[[str, Enter], Reproduction]",
    width: int = 120,
) -> None:
    """Measure, write, print; **raises** the exit code."""
    from ..papers.page import make_report
    from .stages import Stages

    with Stages(*stages) as entered:
        made = make(command_text(["whiskjax", "reproduce", *words]), entered.enter)
        with result_folder(out, files) as folder:
            made.write_sheets(folder)
            write_report(folder, made.summary, made.drawings, make_report(made.paper, made.summary, made.drawings))
    _print(made, out, width)
    raise typer.Exit(0 if made.summary["verdict"]["is_inside"] else NOT_SOUND)


def _print(made: "Reproduction", out: Path, width: int) -> None:
    """Tables first, the verdict last: it is what stays in view.

    **Arguments:** `width`: in characters, where nobody reads along in a terminal.
    """
    from rich.console import Console
    from rich.text import Text

    from ..papers.page import outside, sentences
    from ..show.tables import for_terminal

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=width)
    paper, verdict = made.paper, made.summary["verdict"]
    for table in (*paper.tables, *([paper.beyond] if paper.beyond else [])):
        console.print(for_terminal(table))
        console.print()
    console.print(Text("What the paper contradicts or leaves open (in words in report.html):"))
    for finding in paper.findings:
        console.print(Text(f"  - {finding.title}"))
    console.print()
    for sentence in sentences(verdict):
        console.print(Text(sentence, style="bold red" if outside(verdict) else "bold green"))
    for name in outside(verdict):
        console.print(Text(f"  - outside: {name}"))
    console.print(Text(f"Written to {out}: report.html, results.json, tables and figures"), soft_wrap=True)
