"""CSV tables: what a column may hold, a table whose cells were checked, and tables as text."""

import csv
import dataclasses
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from ..rules import FlightError

# A code for missing data is this many times the range of all other numbers away from them, and farther than two turns.
_TIMES_RANGE, _FARTHEST = 20.0, 720.0


@dataclasses.dataclass(frozen=True)
class Column:
    """What a column may hold.

    **Arguments:**

    - `name`: with its unit.
    - `required`: whether the header must have it.
    - `blank`: whether a cell may be left empty; a number is NaN there, a text None.
    - `low`, `high`: the numbers allowed, both included.
    - `positive`: only numbers above zero.
    - `choices`: the texts allowed; makes it a column of texts.
    - `text`: a column of texts.
    - `hint`: the remedy named where a number lies outside.
    """

    name: str
    required: bool = True
    blank: bool = False
    low: float = -np.inf
    high: float = np.inf
    positive: bool = False
    choices: tuple[str, ...] = ()
    text: bool = False
    hint: str = ""


@dataclasses.dataclass(frozen=True)
class Table:
    """A checked table: columns by name (numbers as float arrays, texts as lists), and the line of each row in the file.

    `cells` gives a row's cells as they are written, by column.
    """

    file: str
    columns: Mapping[str, Any]
    lines: Sequence[int]
    left_out: tuple[str, ...] = ()
    cells: Callable[[int], Mapping[str, str]] = lambda row: {}

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Any:
        return self.columns[name]

    def number(self, row: int, column: str) -> float | None:
        """One number; None where it is blank or the column is not there."""
        value = self.columns[column][row] if column in self.columns else np.nan
        return None if np.isnan(value) else float(value)

    def text(self, row: int, column: str) -> str | None:
        """One text; None where it is blank or the column is not there."""
        return self.columns[column][row] if column in self.columns else None

    def place(self, row: int, column: str = "") -> str:
        """A row, or one cell, named for people; lines count from 1, the header included."""
        return f"{self.file}, line {self.lines[row]}" + (f", column {column}" if column else "")

    def fail(self, row: int, column: str, what: str) -> NoReturn:
        """**Raises:** `FlightError`, always."""
        raise FlightError(f"{self.place(row, column)}: {what}")


def check_increasing(table: Table, column: str, rows: np.ndarray | None = None, owner: str = "") -> None:
    """Refuse numbers that repeat or go back.

    **Arguments:** `rows`: the rows that belong together, all by default; `owner`: whose they are, for the message.
    """
    rows = np.arange(len(table)) if rows is None else rows
    values = table[column][rows]
    wrong = np.diff(values) <= 0
    if wrong.any():
        i = int(np.argmax(wrong))
        kind = "repeats that of" if values[i + 1] == values[i] else "is less than that of"
        table.fail(
            rows[i + 1],
            column,
            f"{owner}{values[i + 1]:.10g} {kind} line {table.lines[rows[i]]} ({values[i]:.10g}); "
            f"sort the lines by {column} and remove duplicates",
        )


def refuse_codes(table: Table, column: str, rows: np.ndarray) -> None:
    """Refuse numbers of a series that lie so far from all others that they can only be codes for missing data, as -9999.

    **Arguments:** `rows`: those where the column is not blank.
    """
    values = table[column][rows]
    order = np.argsort(values)
    gaps = np.diff(values[order])
    if len(gaps) < 2:
        return
    cut = int(np.argmax(gaps)) + 1
    few, many = sorted((order[:cut], order[cut:]), key=len)
    low, high = float(values[many].min()), float(values[many].max())
    if len(few) <= max(1, len(values) // 10) and gaps[cut - 1] > max(_FARTHEST, _TIMES_RANGE * (high - low)):
        row = int(rows[few.min()])
        what = f"{values[few.min()]:.10g} lies far from all others, which are {low:.6g} to {high:.6g}"
        table.fail(row, column, f"{what}; where it stands for missing data, leave the cell blank")


def exact(values: Any) -> list[str]:
    """Numbers as the shortest text that reads back to the same float64; blank for NaN."""
    return ["" if v != v else repr(v).removesuffix(".0") for v in np.asarray(values, dtype=np.float64).tolist()]


def rounded(values: Any, tolerance: float, most: int = 14) -> list[str]:
    """Numbers with the fewest decimals, the same for the whole column, that keep each within the tolerance."""
    values = np.asarray(values, dtype=np.float64)
    known = values[np.isfinite(values)]
    decimals = next((d for d in range(most) if np.all(np.abs(np.round(known, d) - known) <= tolerance)), most)
    # Adding zero turns -0 into 0.
    return ["" if v != v else f"{v:.{decimals}f}" for v in (np.round(values, decimals) + 0.0).tolist()]


def texts(values: Iterable[Any]) -> list[str]:
    """Names and integers as they are; blank for None."""
    return ["" if v is None else str(v) for v in values]


def table_text(columns: Mapping[str, list[str]]) -> str:
    """A CSV file as text, with commas and newlines as every program reads them."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return out.getvalue()
