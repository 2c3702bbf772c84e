"""`whiskjax reproduce`: a paper's tables and figures beside those of its simulation, over many seeds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .command import command_text
from .failure import NOT_SOUND, answers_failures
from .output import refuse_place, result_folder, write_report
from .print_study import bands_sentence, print_study
from .reproduce_location import location
from .reproduce_three_line import three_line
from .start import start_jax

if TYPE_CHECKING:
    from ..flights.haian_study import Study
    from ..show.plain import Summary
    from ..show.style import Drawing

_DRAW = "draw and write"
_OURS = (
    "results.json",
    "report.html",
    "seeds.csv",
    *(f"table_{number}.csv" for number in range(1, 8)),
    *(f"figure_{number}.png" for number in range(3, 8)),
    "open_questions.csv",
    *(f"open_{question}.png" for question in ("weights", "drift", "blunders", "pos_errors", "covariance")),
)

reproduce = typer.Typer(
    no_args_is_help=True, help="Repeat a paper: its tables and figures beside a simulation's, over many seeds."
)


reproduce.command()(location)
reproduce.command("three-line")(three_line)


@reproduce.command()
@answers_failures
def whiskbroom(
    out: Annotated[Path, typer.Option(help="The folder for results; those of an earlier run there are replaced.")],
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
    refuse_place(out, _OURS)
    start_jax()
    from ..flights.haian_answers import QUESTIONS
    from .stages import Stages

    chosen = range(first_seed, first_seed + seeds)
    asked = QUESTIONS if open_questions else ()
    with Stages(*(_stage(unknowns, seed) for unknowns in (12, 15) for seed in chosen), *asked, _DRAW) as stages:
        from ..flights.haian_answers import Sizes, ask
        from ..flights.haian_study import study
        from ..show.whiskbroom.charts import draw_charts
        from ..show.whiskbroom.open_questions import draw_answers
        from ..show.whiskbroom.summary import summarise

        found = study(chosen, lambda unknowns, seed: stages.enter(_stage(unknowns, seed)))
        answers = ask(Sizes(), stages.enter) if open_questions else None
        stages.enter(_DRAW)
        summary = summarise(found, answers, _command(out, seeds, first_seed, open_questions))
        drawings = [*draw_charts(found), *(draw_answers(answers) if answers else ())]
        with result_folder(out, _OURS) as folder:
            _write(folder, found, summary, drawings)
    _print(summary, out)
    raise typer.Exit(0 if summary["verdict"]["is_inside"] else NOT_SOUND)


def _stage(unknowns: int, seed: int) -> str:
    return f"{unknowns} unknowns, seed {seed}"


def _command(out: Path, seeds: int, first_seed: int, open_questions: bool) -> str:
    words = ["whiskjax", "reproduce", "whiskbroom", "--out", str(out)]
    words += ["--seeds", str(seeds), "--first-seed", str(first_seed)]
    words += [] if open_questions else ["--no-open-questions"]
    return command_text(words)


def _write(folder: Path, study: "Study", summary: "Summary", drawings: "list[Drawing]") -> None:
    from ..show.whiskbroom.open_questions import write_answers
    from ..show.whiskbroom.page import make_report
    from ..show.whiskbroom.tables import write_seeds, write_sheets

    write_sheets(folder, summary)
    write_answers(folder / "open_questions.csv", summary["open_questions"])
    write_seeds(folder / "seeds.csv", study)
    write_report(folder, summary, drawings, make_report(summary, drawings))


def _print(summary: "Summary", out: Path) -> None:
    from ..show.whiskbroom.findings import findings
    from ..show.whiskbroom.open_questions import answers_table
    from ..show.whiskbroom.tables import bands, in_order

    verdict, questions = summary["verdict"], summary["open_questions"]
    tables, sentences = [*in_order(summary), bands(summary)], [bands_sentence(verdict)]
    if questions:
        tables.append(answers_table(questions))
        sentences.append(
            f"{verdict['open_met']} of {verdict['open_asked']} figures with a band are inside it among the open questions."
        )
    print_study(tables, findings(summary), sentences, (*verdict["outside"], *verdict["open_missed"]), out)
