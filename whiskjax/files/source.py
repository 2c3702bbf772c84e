"""A flight folder being read: what is open, which images there are, what was left out."""

import dataclasses
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..rules import FlightError
from .sheet import Sheet, open_sheet
from .tables import Column, Table

if TYPE_CHECKING:
    from .schema import FlightTable

IMAGES = "images.csv"
_IMAGE_COLUMNS = (
    Column("image", text=True),
    *(Column(key, required=False, blank=True, text=True) for key in ("view", "swing", "strip")),
    Column("time_s", required=False, blank=True),
    *(Column(name, required=False, blank=True, positive=True) for name in ("focal_px", "rows", "columns")),
)


@dataclasses.dataclass
class Source:
    """The folder, its flight.toml, the tables opened so far, and notes of what is odd or used by nothing."""

    folder: Path
    toml: "FlightTable"
    sheets: dict[str, Sheet] = dataclasses.field(default_factory=dict)
    noted: list[str] = dataclasses.field(default_factory=list)

    @property
    def first_centre(self) -> float:
        """The number that the files give the centre of the first pixel; inside it is 0."""
        return self.toml.pixel.first_pixel_centre

    @cached_property
    def images(self) -> Table:
        """images.csv, every name once."""
        return _images_table(self.sheet(IMAGES, "every flight"))

    def sheet(self, file: str, needed_by: str) -> Sheet:
        """A table as text, opened once."""
        if file not in self.sheets:
            self.sheets[file] = open_sheet(self.folder, file, needed_by)
        return self.sheets[file]

    def leave_out(self, table: Table, why: str) -> None:
        """Note columns that nothing uses."""
        if table.left_out:
            self.note([f"{table.file}: {', '.join(table.left_out)} left out: {why}."])

    def note(self, sentences: Iterable[str]) -> None:
        """Note what is odd; what the flight's notes say already, because it was read and written before, is not said again."""
        for sentence in sentences:
            if sentence not in self.noted and sentence not in self.toml.notes:
                self.noted.append(sentence)


def _images_table(sheet: Sheet) -> Table:
    table = sheet.parse(_IMAGE_COLUMNS)
    if not len(table):
        raise FlightError(f"{IMAGES} has no images: add a line for each")
    seen: dict[str, int] = {}
    for row, name in enumerate(table["image"]):
        if name in seen:
            table.fail(row, "image", f"image {name!r} is there twice; the first is line {table.lines[seen[name]]}")
        seen[name] = row
    for name in ("rows", "columns"):
        for row in np.flatnonzero(table[name] % 1 > 0) if name in table else ():
            table.fail(int(row), name, f"{table[name][row]:g} is not a whole number")
    return table
