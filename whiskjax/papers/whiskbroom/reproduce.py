"""Jin et al. (2024), reproduced over many seeds."""

from pathlib import Path

from ..reproduction import DRAW, Enter, Reproduction
from .answer_tables import draw_answers, write_answers
from .answers import QUESTIONS, Sizes, ask
from .charts import draw_charts
from .page import page
from .study import study
from .summary import summarise
from .tables import write_seeds, write_sheets


def _stage(unknowns: int, seed: int) -> str:
    return f"{unknowns} unknowns, seed {seed}"


def stages(seeds: range, open_questions: bool) -> tuple[str, ...]:
    """In the order in which `reproduce` enters them."""
    each = (_stage(unknowns, seed) for unknowns in (12, 15) for seed in seeds)
    return (*each, *(QUESTIONS if open_questions else ()), DRAW)


def reproduce(seeds: range, open_questions: bool, command: str, enter: Enter) -> Reproduction:
    """Tables 1 to 7, Figures 3 to 7, and the answers to what the paper leaves open if they are wanted.

    **Arguments:** `command`: how it was made, for the reader who wants to repeat it.
    """
    found = study(seeds, lambda unknowns, seed: enter(_stage(unknowns, seed)))
    answers = ask(Sizes(), enter) if open_questions else None
    enter(DRAW)
    summary = summarise(found, answers, command)
    drawings = [*draw_charts(found), *(draw_answers(answers) if answers else ())]

    def write(folder: Path) -> None:
        write_sheets(folder, summary)
        write_answers(folder / "open_questions.csv", summary["open_questions"])
        write_seeds(folder / "seeds.csv", found)

    return Reproduction(summary, drawings, page(summary), write)
