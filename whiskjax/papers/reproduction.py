"""A paper, reproduced: what every one of them hands to whoever prints and writes it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from ..show.plain import Summary
from ..show.style import Drawing
from .page import Paper

# The last stage of every reproduction; those before it are the paper's own.
DRAW = "draw and write"
# Called with its name before each stage.
Enter = Callable[[str], None]


class Reproduction(NamedTuple):
    """`write_sheets` writes the paper's CSV files into a folder."""

    summary: Summary
    drawings: Sequence[Drawing]
    paper: Paper
    write_sheets: Callable[[Path], None]
