"""CSV tables: every column has a specification, and every refusal names the file, the line and the column."""

import csv
import dataclasses
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Float

from ..rules import FlightError
from .names import listed, meant


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
    """A checked table: columns by name (numbers as float arrays, texts as lists), and the line of each row in the file."""

    file: str
    columns: Mapping[str, Any]
    lines: Sequence[int]
    left_out: tuple[str, ...] = ()

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


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A table as text: header and cells, nothing checked but the number of cells in each row."""

    file: str
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]

    def parse(
        self,
        columns: Iterable[Column],
        *,
        pattern: Callable[[str], Column | None] = lambda name: None,
        ignore: Callable[[str], bool] = lambda name: False,
    ) -> Table:
        """Check every cell.

        **Arguments:** the columns expected; `pattern` may give the specification of further ones by name; those for which
        `ignore` holds are left out and listed in `left_out`.

        **Raises:** `FlightError` for a missing or unknown column, and for a cell that its column does not allow.
        """
        expected = {column.name: column for column in columns}
        for name, column in expected.items():
            if column.required and name not in self.header:
                raise FlightError(
                    f"{self.file}, line 1: the column {name} is missing{meant(name, set(self.header) - set(expected))}; "
                    f"the header has {listed(self.header)}"
                )
        found: dict[str, Any] = {}
        left_out = []
        for k, name in enumerate(self.header):
            column = expected.get(name) or pattern(name)
            if column is not None:
                found[name] = self._check(column, [row[k].strip() for row in self.rows])
            elif ignore(name):
                left_out.append(name)
            else:
                raise FlightError(
                    f"{self.file}, line 1: no column {name!r} is known here{meant(name, expected)}; expected are "
                    f"{', '.join(expected)}"
                )
        return Table(self.file, found, self.lines, tuple(left_out))

    def _check(self, column: Column, cells: list[str]) -> Any:
        empty = [not cell for cell in cells]
        if not column.blank and any(empty):
            self._fail(empty.index(True), column, "is blank, and a value is needed")
        if column.text or column.choices:
            for i, cell in enumerate(cells):
                if column.choices and cell and cell not in column.choices:
                    self._fail(i, column, f"{cell!r} is not one of {', '.join(column.choices)}")
            return [cell or None for cell in cells]
        return self._numbers(column, cells, np.array(empty, dtype=bool))

    def _numbers(self, column: Column, cells: list[str], empty: np.ndarray) -> Float[np.ndarray, " n"]:
        try:
            values = np.array([cell or "nan" for cell in cells], dtype=np.float64)
        except ValueError:
            self._fail(next(i for i, cell in enumerate(cells) if cell and not _is_number(cell)), column, "is not a number", cells)
        wrong = ~np.isfinite(values) & ~empty
        if wrong.any():
            self._fail(int(np.argmax(wrong)), column, "is not a finite number", cells)
        wrong = ~((values >= column.low) & (values <= column.high)) & ~empty
        what = f"lies outside {column.low:g} to {column.high:g}" if np.isfinite(column.high) else f"is less than {column.low:g}"
        if column.positive:
            wrong, what = ~(values > 0) & ~empty, "is not positive"
        if wrong.any():
            self._fail(int(np.argmax(wrong)), column, f"{what}; {column.hint}" if column.hint else what, cells)
        return values

    def _fail(self, row: int, column: Column, what: str, cells: list[str] | None = None) -> NoReturn:
        value = f"{cells[row]!r} " if cells else ""
        raise FlightError(f"{self.file}, line {self.lines[row]}, column {column.name}: {value}{what}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def open_sheet(folder: Path, file: str, needed_by: str) -> Sheet:
    """Read a CSV file as text.

    **Arguments:** `needed_by`: who asks, for the message where the file does not exist.

    **Raises:** `FlightError` where the file does not exist, has no header or no row, names a column twice, or where a row has
    too many or too few cells.
    """
    path = folder / file
    if not path.is_file():
        there = listed(sorted(p.name for p in folder.iterdir()))
        raise FlightError(f"{file} does not exist, but {needed_by} needs it; the folder holds {there}")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FlightError(f"{file}: not a UTF-8 text file: {error}") from error
    reader = csv.reader(io.StringIO(text, newline=""))
    header: tuple[str, ...] = tuple(name.strip() for name in next(reader, []))
    if not header:
        raise FlightError(f"{file}, line 1: the header with the names of the columns is missing")
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise FlightError(f"{file}, line 1: columns are separated by commas, not as in {header[0]!r}")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise FlightError(f"{file}, line 1: the column {twice[0]!r} is there twice")
    rows, lines = [], []
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            raise FlightError(f"{file}, line {reader.line_num}: {len(row)} cells, but the header names {len(header)} columns")
        rows.append(row)
        lines.append(reader.line_num)
    return Sheet(file, header, rows, lines)


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
