"""An answer in the terminal: tables first, the verdict last, which is what stays in view."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..show.plain import Summary
    from ..show.tables import Table

_CAUTIONS_SHOWN = 12


def print_answer(what: str, summary: "Summary", head: Sequence[str], tables: Iterable["Table | None"], written: str) -> None:
    """Print what is told of an answer; on a terminal wrapped beside its bullets, in a file one line each.

    **Arguments:** `what`: "calibration", say; `head`: lines below the name of the flight; `written`: the last line.
    """
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

    from ..show.tables import for_terminal

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=100)

    def say(text: str, lead: str = "", style: str = "") -> None:
        if not console.is_terminal or not lead:
            console.print(Text(lead + text, style=style), soft_wrap=not console.is_terminal)
            return
        grid = Grid.grid()
        grid.add_row(Text(lead, style=style), Text(text))
        console.print(grid)

    say(summary["flight"], style="bold")
    for line in head:
        say(line)
    for table in filter(None, tables):
        console.print()
        console.print(for_terminal(table))
    console.print()
    verdict = summary["verdict"]
    say(f"This {what} is {verdict['word']}:", style="bold green" if verdict["is_sound"] else "bold red")
    for reason in verdict["reasons"]:
        if reason["grade"] != "caution":
            say(reason["text"], "  - ", "red" if reason["grade"] == "failure" else "")
    cautions = [reason["text"] for reason in verdict["reasons"] if reason["grade"] == "caution"]
    more = len(cautions) - _CAUTIONS_SHOWN
    for caution in [*cautions[:_CAUTIONS_SHOWN], *([f"and {more} more in results.json"] if more > 0 else [])]:
        say(caution, "warning: ", "yellow")
    say(written)
