"""What the `reproduce` verbs print."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..show.finding import Finding
    from ..show.tables import Table


def print_study(
    tables: "Sequence[Table]",
    findings: "Sequence[Finding]",
    sentences: Sequence[str],
    outside: Sequence[str],
    out: Path,
    width: int = 120,
) -> None:
    """Tables first, the verdict last: it is what stays in view.

    **Arguments:** `sentences`: how many figures are where they should be; `outside`: names of those that are not; `width`: in
    characters, where nobody reads along in a terminal.
    """
    from rich.console import Console
    from rich.text import Text

    from ..show.tables import for_terminal

    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=width)
    for table in tables:
        console.print(for_terminal(table))
        console.print()
    console.print(Text("What the paper contradicts or leaves open (in words in report.html):"))
    for finding in findings:
        console.print(Text(f"  - {finding.title}"))
    console.print()
    for sentence in sentences:
        console.print(Text(sentence, style="bold red" if outside else "bold green"))
    for name in outside:
        console.print(Text(f"  - outside: {name}"))
    console.print(Text(f"Written to {out}: report.html, results.json, tables and figures"), soft_wrap=True)


def bands_sentence(verdict: dict) -> str:
    """How many figures are inside of their bands."""
    return f"{verdict['bands_inside']} of {verdict['bands']} figures with a band are inside it."
