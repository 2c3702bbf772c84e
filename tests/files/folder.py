"""A flight folder to be edited, one thing at a time."""

import csv
from pathlib import Path

import pytest

import whiskjax as wj


class Folder:
    """Edits of a copy; lines count from 1 as in messages, the header being line 1."""

    def __init__(self, path: Path):
        self.path = Path(path)

    def rows(self, file):
        """The cells of a CSV file, header first."""
        with open(self.path / file, newline="") as stream:
            return list(csv.reader(stream))

    def store(self, file, rows):
        """Write the cells of a CSV file."""
        with open(self.path / file, "w", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows)
        return self

    def cell(self, file, line, column, value=None):
        """Replace one cell; without a value, return it."""
        rows = self.rows(file)
        k = rows[0].index(column)
        if value is None:
            return rows[line - 1][k]
        rows[line - 1][k] = value
        return self.store(file, rows)

    def rename(self, file, column, name):
        """Rename a column."""
        rows = self.rows(file)
        rows[0][rows[0].index(column)] = name
        return self.store(file, rows)

    def drop_column(self, file, column):
        """Remove a column."""
        rows = self.rows(file)
        k = rows[0].index(column)
        return self.store(file, [row[:k] + row[k + 1 :] for row in rows])

    def add_column(self, file, column, value):
        """Append a column with the same value everywhere."""
        rows = self.rows(file)
        return self.store(file, [[*rows[0], column], *([*row, value] for row in rows[1:])])

    def keep_lines(self, file, keep):
        """Keep the header and the lines for which `keep(line)` holds."""
        rows = self.rows(file)
        return self.store(file, [rows[0], *(row for line, row in enumerate(rows[1:], 2) if keep(line))])

    def repeat_line(self, file, line, **cells):
        """Insert a copy of a line behind it, with some cells replaced."""
        rows = self.rows(file)
        row = list(rows[line - 1])
        for column, value in cells.items():
            row[rows[0].index(column)] = value
        return self.store(file, [*rows[:line], row, *rows[line:]])

    def toml(self, old, new):
        """Replace a text of flight.toml, which must be there."""
        return self.text("flight.toml", old, new)

    def text(self, file, old, new):
        """Replace the first occurrence of a text, which must be there."""
        text = (self.path / file).read_text()
        assert old in text
        (self.path / file).write_text(text.replace(old, new, 1))
        return self

    def refused(self, *parts):
        """Reading fails with a message that holds all parts."""
        with pytest.raises(wj.FlightError) as caught:
            wj.read_flight(self.path)
        message = str(caught.value)
        missing = [part for part in parts if part not in message]
        assert not missing, f"{missing} not in: {message}"
        return message
