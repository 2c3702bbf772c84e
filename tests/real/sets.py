"""Where the real flights are, and what all converters do: read columns, write a folder, count what was left out."""

import csv
import dataclasses
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_BESIDE = Path(__file__).parents[3] / "shared" / "data"


def data_folder() -> Path:
    """$WHISKJAX_DATA, or shared/data beside the repository."""
    return Path(os.environ.get("WHISKJAX_DATA") or _BESIDE)


def missing(source: Path) -> str:
    """Why a set cannot be used; empty where it can."""
    if source.is_dir():
        return ""
    return f"the real flights are not part of the repository and {source} does not exist; set WHISKJAX_DATA to their folder"


class Rows:
    """A CSV file of a set: columns as texts or numbers, NaN where a cell is blank."""

    def __init__(self, path: Path):
        with path.open(newline="", encoding="utf-8") as file:
            self.cells = list(csv.DictReader(file))

    def __len__(self) -> int:
        return len(self.cells)

    def texts(self, column: str) -> list[str]:
        """One column as it is written."""
        return [row[column] for row in self.cells]

    def numbers(self, *columns: str) -> np.ndarray:
        """One column (n,), or several (n, columns)."""
        table = np.array([[float(row[c]) if row[c] else np.nan for c in columns] for row in self.cells]).reshape(-1, len(columns))
        return table[:, 0] if len(columns) == 1 else table

    def where(self, keep: Iterable[bool]) -> "Rows":
        """Those rows for which `keep` holds."""
        some = object.__new__(Rows)
        some.cells = [row for row, k in zip(self.cells, keep, strict=True) if k]
        return some

    def among(self, **names: Collection[str]) -> "Rows":
        """Those rows whose text is one of the names given for a column, in every column that has names."""
        return self.where(all(row[column] in known for column, known in names.items()) for row in self.cells)


@dataclasses.dataclass(frozen=True)
class Converted:
    """A flight folder, and what of the source is not in it: how many of what, and why."""

    folder: Path
    left_out: tuple[str, ...] = ()


def left_out(counts: Mapping[str, int]) -> tuple[str, ...]:
    """Sentences for what was left out at all."""
    return tuple(f"{what}: {count}" for what, count in counts.items() if count)


def toml_text(text: str) -> str:
    """A basic string of TOML."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def write_flight_folder(
    folder: Path, toml: str, tables: Mapping[str, Mapping[str, Iterable[Any]]], counts: Mapping[str, int] | None = None
) -> Converted:
    """Write flight.toml and the tables.

    **Arguments:** `toml`: with the word NOTES where the sentences about what was left out belong; `tables`: for each file the
    columns, numbers or texts; `counts`: what was left out.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sentences = left_out(counts or {})
    notes = "Left out: " + "; ".join(sentences) + "." if sentences else "Nothing was left out."
    (folder / "flight.toml").write_text(toml.replace("NOTES", toml_text(notes)), encoding="utf-8")
    for name, columns in tables.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(map(_text, column) for column in columns.values()), strict=True))
    return Converted(folder, sentences)


def _text(value: Any) -> str:
    # The shortest text that reads back to the same number.
    return repr(float(value)) if isinstance(value, float | np.floating) else str(value)
