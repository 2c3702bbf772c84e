"""CSV files read: every column against its specification, and every refusal names the file, the line and the column.

A small file is cut into cells and looked at one by one. A large one is read by Apache Arrow, and its cells are looked at only
to say where something is wrong.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from jaxtyping import Bool, Float

from ..rules import FlightError
from . import fast_csv
from .cells import CsvFile, numbers_of, row_of, rows_of, texts_of
from .names import listed, meant, shown
from .tables import Column, Table


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A CSV file whose header is known and whose rows are still to be read."""

    csv: CsvFile
    header: tuple[str, ...]

    @property
    def file(self) -> str:
        """How messages call the file."""
        return self.csv.name

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

        **Raises:** `FlightError` for a missing or unknown column, for a row that has too many or too few cells, and for a cell
        that its column does not allow.
        """
        wanted, left_out = self._choose({column.name: column for column in columns}, pattern, ignore)
        texts = [column.name for column in wanted if column.text or column.choices]
        numbers = [column.name for column in wanted if column.name not in texts]
        large = self.csv.path.stat().st_size >= fast_csv.WORTH_BYTES
        read = fast_csv.read_columns(self.csv.path, self.header, numbers, texts) if large else None
        if read is None:
            read = texts_of(self.csv, self.header, [column.name for column in wanted])
        found: dict[str, Any] = {}
        for column in wanted:
            check = self._texts if column.name in texts else self._numbers
            found[column.name] = check(column, read[column.name])
        rows = len(next(iter(found.values()), ()))
        return Table(self.file, found, LinesOf(self.csv, rows), left_out, self._cells)

    def _choose(
        self, expected: dict[str, Column], pattern: Callable[[str], Column | None], ignore: Callable[[str], bool]
    ) -> tuple[list[Column], tuple[str, ...]]:
        """The columns to read, in the order of the header, and the names of those left out."""
        for name, column in expected.items():
            if column.required and name not in self.header:
                raise FlightError(
                    f"{self.file}, line 1: the column {name} is missing{meant(name, set(self.header) - set(expected))}; "
                    f"the header has {listed(self.header)}"
                )
        wanted, left_out = [], []
        for name in self.header:
            column = expected.get(name) or pattern(name)
            if column is not None:
                wanted.append(column)
            elif ignore(name):
                left_out.append(name)
            else:
                raise FlightError(
                    f"{self.file}, line 1: no column {name!r} is known here{meant(name, expected)}; expected are "
                    f"{', '.join(expected)}"
                )
        return wanted, tuple(left_out)

    def _texts(self, column: Column, cells: list[str]) -> list[str | None]:
        if not column.blank and "" in cells:
            self._fail(cells.index(""), column, "is blank, and a value is needed")
        if column.choices:
            for row, cell in enumerate(cells):
                if cell and cell not in column.choices:
                    self._fail(row, column, f"{shown(cell)} is not one of {', '.join(column.choices)}")
        return [cell or None for cell in cells]

    def _numbers(self, column: Column, found: Float[np.ndarray, " n"] | list[str]) -> Float[np.ndarray, " n"]:
        """**Arguments:** `found`: numbers, NaN where a cell is blank, or cells."""
        if isinstance(found, list):
            blank = np.array([not cell for cell in found], dtype=bool)
            values, is_number = numbers_of(found)
        else:
            values, blank, is_number = found, np.isnan(found), True
        if not column.blank:
            self._refuse(column, blank, "is blank, and a value is needed", told=False)
        self._refuse(column, ~(is_number | blank), "is not a number")
        self._refuse(column, ~(np.isfinite(values) | blank), "is not a finite number")
        if column.positive:
            self._refuse(column, ~((values > 0) | blank), "is not positive", column.hint)
        what = f"lies outside {column.low:g} to {column.high:g}" if np.isfinite(column.high) else f"is less than {column.low:g}"
        self._refuse(column, ~(((values >= column.low) & (values <= column.high)) | blank), what, column.hint)
        return values

    def _refuse(self, column: Column, wrong: Bool[np.ndarray, " n"], what: str, hint: str = "", told: bool = True) -> None:
        if wrong.any():
            row = int(np.argmax(wrong))
            value = f"{shown(self._cells(row)[column.name])} " if told else ""
            self._fail(row, column, value + (f"{what}; {hint}" if hint else what))

    def _fail(self, row: int, column: Column, what: str) -> NoReturn:
        raise FlightError(f"{self.file}, line {row_of(self.csv, row)[0]}, column {column.name}: {what}")

    def _cells(self, row: int) -> dict[str, str]:
        return dict(zip(self.header, row_of(self.csv, row)[1], strict=True))


class LinesOf(Sequence[int]):
    """The line of each row in its file, looked up where it is asked for: few tables are ever asked."""

    def __init__(self, csv: CsvFile, rows: int):
        self._csv, self._rows = csv, rows

    def __len__(self) -> int:
        return self._rows

    def __getitem__(self, row: Any) -> Any:
        return row_of(self._csv, range(self._rows)[row])[0]


def open_sheet(folder: Path, file: str, needed_by: str) -> Sheet:
    """A CSV file, its header read.

    **Arguments:** `needed_by`: who asks, for the message where the file does not exist.

    **Raises:** `FlightError` where the file does not exist, has no header, or names a column twice.
    """
    path = folder / file
    if not path.is_file():
        there = listed(sorted(p.name for p in folder.iterdir()))
        raise FlightError(f"{file} does not exist, but {needed_by} needs it; the folder holds {there}")
    csv = CsvFile(path, file)
    line, names = next(rows_of(csv), (0, []))
    if line != 1:
        raise FlightError(f"{file}, line 1: the header with the names of the columns is missing")
    if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
        raise FlightError(f"{file}, line 1: columns are separated by commas, not as in {names[0]!r}")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise FlightError(f"{file}, line 1: the column {twice[0]!r} is there twice")
    return Sheet(csv, tuple(names))
