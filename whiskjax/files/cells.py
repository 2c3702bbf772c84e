"""CSV text cut into rows and cells, slowly and carefully: what small tables, and every message about a large one, are made of.

RFC 4180, and no more: cells are separated by commas; a cell that holds a comma, a line break or a quotation mark stands between
quotation marks, those inside doubled. Blank lines are skipped. Lines end with LF, CRLF or CR; they are counted from 1, as editors
do.
"""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Bool, Float

from ..rules import FlightError

# As long as Python's csv module lets a cell be: a longer one comes from a quotation mark that nobody closed.
LONGEST_CELL = 131_072

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_CELL = re.compile(r'(?:"([^"]*(?:""[^"]*)*)"|([^",]*))(,|\Z)')
_LINE_END = re.compile(r"\r\n|\r|\n")


class CsvFile(NamedTuple):
    """Where a table is, and how messages call it."""

    path: Path
    name: str


def rows_of(csv: CsvFile) -> Iterator[tuple[int, list[str]]]:
    """The rows of a table: the number of the line where each ends, and its cells without the spaces around them.

    **Raises:** `FlightError` naming file and line where the text is not UTF-8, or holds a NUL, a stray quotation mark or a cell
    that nobody can have meant.
    """
    inside, first, pieces = False, 0, []
    for number, line in _lines(csv):
        quotes = line.count('"')
        if not inside and not quotes:
            line = line.rstrip("\r\n")
            if line:
                yield number, _cells(csv, number, line, line.split(","))
            continue
        if not inside:
            first, pieces = number, []
        pieces.append(line)
        inside ^= quotes % 2 == 1  # a line break between quotation marks belongs to the cell
        if not inside:
            row = "".join(pieces).rstrip("\r\n")
            yield number, _cells(csv, first, row, _unquoted(csv, first, row))
    if inside:
        _fail(csv, first, "a quotation mark opens here and is never closed; remove it, or double it inside a quoted cell")


def _lines(csv: CsvFile) -> Iterator[tuple[int, str]]:
    try:
        with csv.path.open(encoding="utf-8-sig", newline="") as file:
            for number, line in enumerate(file, 1):
                if "\0" in line:
                    _fail(csv, number, "holds a NUL character: a binary file, or one that was cut off while it was written?")
                yield number, line
    except UnicodeDecodeError:
        data = csv.path.read_bytes()
        try:
            data.decode()
        except UnicodeDecodeError as error:
            line = len(_LINE_END.findall(data[: error.start].decode())) + 1
            raise FlightError(f"{csv.name}, line {line}: not a UTF-8 text file: {error}") from error


def _unquoted(csv: CsvFile, line: int, row: str) -> list[str]:
    cells, at = [], 0
    while True:
        found = _CELL.match(row, at)
        if found is None:
            what = "a stray quotation mark: a cell is quoted as a whole or not at all, and quotation marks inside are doubled"
            _fail(csv, line, f"cell {len(cells) + 1} holds {what}")
        quoted, plain, end = found.groups()
        cells.append(plain if quoted is None else quoted.replace('""', '"'))
        if not end:
            return cells
        at = found.end()


def _cells(csv: CsvFile, line: int, row: str, cells: list[str]) -> list[str]:
    if len(row) > LONGEST_CELL:
        for k, cell in enumerate(cells):
            if len(cell) > LONGEST_CELL:
                _fail(csv, line, f"cell {k + 1} holds {len(cell)} characters, and nobody writes so many into one")
    return [cell.strip() for cell in cells]


def _fail(csv: CsvFile, line: int, what: str) -> NoReturn:
    raise FlightError(f"{csv.name}, line {line}: {what}")


def number_of(text: str) -> float | None:
    """The number that a cell holds, NaN or infinite ones included; None where it is no plain decimal number.

    Python's `float` also takes 0_3 and the digits of every script, which no other program reads as the same number.
    """
    return float(text) if _NUMBER.fullmatch(text) or _NOT_FINITE.fullmatch(text) else None


def texts_of(csv: CsvFile, header: tuple[str, ...], wanted: list[str]) -> dict[str, list[str]]:
    """The wanted columns as text.

    **Raises:** `FlightError` naming the line whose number of cells is not that of the header, and where `rows_of` raises.
    """
    places = [header.index(name) for name in wanted]
    columns: list[list[str]] = [[] for _ in wanted]
    rows = rows_of(csv)
    next(rows)
    for line, cells in rows:
        if len(cells) != len(header):
            _fail(csv, line, f"{len(cells)} cells, but the header names {len(header)} columns")
        for column, k in zip(columns, places, strict=True):
            column.append(cells[k])
    return dict(zip(wanted, columns, strict=True))


def row_of(csv: CsvFile, row: int) -> tuple[int, list[str]]:
    """Line and cells of one row, counted from 0 after the header."""
    return next(itertools.islice(rows_of(csv), row + 1, None))


def numbers_of(cells: list[str]) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Cells as numbers, NaN where one is blank or none, and which of them hold a number."""
    found = [number_of(cell) for cell in cells]
    is_number = np.array([value is not None for value in found], dtype=bool)
    return np.array([np.nan if value is None else value for value in found], dtype=np.float64), is_number
