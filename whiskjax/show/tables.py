"""Tables of a summary, for the terminal and for the report: the same words and the same digits in both."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from ..rules import import_extra
from .plain import Summary

DASH = "–"
_WIDEST_TEXT = 14


class Cell(NamedTuple):
    """What a cell says, and whether it deserves a second look."""

    text: str
    alarm: bool = False


class Table(NamedTuple):
    """A table of text: headings (numbers to the right), rows, and one sentence on how to read it."""

    title: str
    headings: tuple[str, ...]
    is_number: tuple[bool, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    breaks: tuple[int, ...] = ()  # rows after which a group ends


def fixed(value: float | None, decimals: int) -> str:
    """So many decimals, with a proper minus sign; a dash where there is no figure."""
    if value is None:
        return DASH
    text = f"{value:.{decimals}f}"
    return (text[1:] if float(text) == 0 and text[0] == "-" else text).replace("-", "−")


def short(value: float | None, digits: int = 4) -> str:
    """Up to so many significant digits."""
    return DASH if value is None else f"{value:.{digits}g}".replace("-", "−")


def percent(share: float | None) -> str:
    """A share in percent; close to 0 and 100 with the decimal that tells it from them."""
    if share is None:
        return DASH
    return fixed(max(100 * share, 0.0), 1) + " %"


def decimals_of(sigma: float | None) -> int:
    """Decimals that show two digits of a sigma; six where there is none."""
    if sigma is None or not sigma > 0:
        return 6
    return min(12, max(0, 1 - math.floor(math.log10(sigma))))


def decimals_among(rows: Sequence[Summary], *keys: str) -> int:
    """Decimals that show two digits of the largest of some figures."""
    return decimals_of(max((abs(row[key]) for row in rows for key in keys if row[key] is not None), default=None))


def weights(summary: Summary) -> Table | None:
    """Sigmas estimated from the data; None where they were not."""
    found = summary["weights"]
    if not found:
        return None
    return Table(
        "Weights from the data",
        ("group", "values", "sigma ×", "± %"),
        (False, True, True, True),
        tuple(
            (
                Cell(row["group"]),
                Cell(str(row["n"])),
                Cell(short(row["sigma_factor"], 3), not row["is_plausible"]),
                Cell(fixed(100 * row["relative_sigma"], 0), row["relative_sigma"] > 0.5),
            )
            for row in found
        ),
        "The factor by which the given sigmas of a group were multiplied, and how well the data know it.",
    )


def for_terminal(table: Table) -> Any:
    """The table as rich draws it; nothing is cut off, long names wrap."""
    rich_table = import_extra("rich.table", "app")
    text = import_extra("rich.text", "app")
    box = import_extra("rich.box", "app")
    group = import_extra("rich.console", "app").Group
    drawn = rich_table.Table(
        title=text.Text(table.title), title_justify="left", title_style="bold",
        box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), collapse_padding=True, show_edge=False,
    )  # fmt: skip
    for k, (heading, number) in enumerate(zip(table.headings, table.is_number, strict=True)):
        lines = heading.split(": ")
        width = max(len(line) for line in (*lines, *(row[k].text for row in table.rows)))
        width = width if number else min(width, _WIDEST_TEXT)
        drawn.add_column(text.Text("\n".join(lines)), justify="right" if number else "left", overflow="fold", min_width=width)
    for i, row in enumerate(table.rows):
        cells = [text.Text(cell.text, style="bold yellow" if cell.alarm else "") for cell in row]
        drawn.add_row(*cells, end_section=i in table.breaks)
    return group(drawn, text.Text(table.caption, style="dim")) if table.caption else drawn
