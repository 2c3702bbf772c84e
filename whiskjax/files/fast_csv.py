"""CSV columns read by Apache Arrow, for tables whose careful reading would take seconds: all plain ones, and nothing else.

What Arrow reads otherwise than `cells` does, or does not say exactly where it is wrong, is left to `cells`: then `read_columns`
returns None. So nothing here words an error.
"""

import codecs
from pathlib import Path
from typing import Any

import numpy as np

from ..rules import import_extra
from .cells import LONGEST_CELL

# Arrow takes 0.1 s to import; by then the careful reader is through with this many bytes.
WORTH_BYTES = 1_000_000
_BLOCK_BYTES = 1 << 22
_QUOTE, _NEWLINE = ord('"'), ord("\n")
_BETWEEN = np.frombuffer(b',\n\r"', dtype=np.uint8)


def read_columns(path: Path, header: tuple[str, ...], numbers: list[str], texts: list[str]) -> dict[str, Any] | None:
    """Columns of numbers as float64 arrays, NaN where a cell is blank, and of texts as lists without the spaces around them.

    **Returns:** None where the table holds anything that has to be looked at cell by cell.
    """
    breaks_in_cells = _is_plain(path)
    if breaks_in_cells is None:
        return None
    pa, csv = import_extra("pyarrow", "files"), import_extra("pyarrow.csv", "files")
    types = {name: pa.float64() for name in numbers} | {name: pa.string() for name in texts}
    try:
        table = csv.read_csv(
            path,
            csv.ReadOptions(column_names=list(header), skip_rows=1),
            csv.ParseOptions(newlines_in_values=breaks_in_cells),
            csv.ConvertOptions(column_types=types, include_columns=list(types), null_values=[""]),
        )
    except pa.ArrowInvalid:
        return None
    out: dict[str, Any] = {}
    for name in numbers:
        column = table[name]
        values = column.to_numpy()
        if int(np.isfinite(values).sum()) + column.null_count != len(values):
            return None  # nan and inf are words that Arrow takes for numbers
        out[name] = values
    for name in texts:
        out[name] = [text.strip() for text in table[name].to_pylist()]
    del table
    pa.default_memory_pool().release_unused()  # the text that was read is as large as the numbers
    return out


def _is_plain(path: Path) -> bool | None:
    """Whether line breaks stand inside cells; None where quotation marks, characters or lines are not as they should be."""
    inside, breaks = 0, False
    with path.open("rb") as file:
        file.seek(len(codecs.BOM_UTF8) if file.read(3) == codecs.BOM_UTF8 else 0)
        while block := file.read(_BLOCK_BYTES):
            block += file.readline(LONGEST_CELL + 2)  # to the end of a line, or a line that is too long
            if b"\0" in block or not (block.isascii() or _decodes(block)):
                return None
            characters = np.frombuffer(block, dtype=np.uint8)
            ends = np.flatnonzero(characters == _NEWLINE)
            if np.diff(ends, prepend=-1, append=len(block)).max() > LONGEST_CELL:
                return None
            if b'"' in block:
                quotes = np.flatnonzero(characters == _QUOTE)
                if not _are_whole_cells(characters, quotes, inside):
                    return None
                breaks |= bool(((np.searchsorted(quotes, ends) + inside) % 2 == 1).any())
                inside = (inside + len(quotes)) % 2
            else:
                breaks |= inside == 1
    return None if inside else breaks


def _are_whole_cells(characters: np.ndarray, quotes: np.ndarray, inside: int) -> bool:
    """Whether every cell is quoted as a whole or not at all: odd quotation marks open it, even ones close it."""
    opens, closes = quotes[inside::2], quotes[1 - inside :: 2]
    before, after = characters[opens[opens > 0] - 1], characters[closes[closes < len(characters) - 1] + 1]
    return bool(np.isin(before, _BETWEEN).all() and np.isin(after, _BETWEEN).all())


def _decodes(block: bytes) -> bool:
    try:
        block.decode()
    except UnicodeDecodeError:
        return False
    return True
