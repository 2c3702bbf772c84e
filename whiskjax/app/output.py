"""The folder of a run's results: checked before the work, replaced whole, and only where it is ours."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.whole_folder import check_before, whole_folder
from ..rules.errors import FlightError
from .ours import RESULTS, of_others, results_text, sign

if TYPE_CHECKING:
    from ..show.plain import Summary
    from ..show.style import Drawing


def refuse_place(out: Path, ours: tuple[str, ...], flight: Path | None = None) -> None:
    """Refuse, before any work is done, a place where results cannot go.

    **Arguments:** `ours`: the names that the run may write; `flight`: the folder that it reads.

    **Raises:** `FlightError` where no folder can be written there, where it is, holds or lies in a flight, and where it holds
    something of somebody else's that a result would replace.
    """
    try:
        if flight is not None and (read := Path(os.path.realpath(flight))) in Path(os.path.realpath(out)).parents:
            raise FlightError(f"{out} lies in the flight {read}, which is only read; give another folder for the results")
        check_before(out, lambda old: _kept(out, old, ours, flight))
    except FlightError as error:
        raise FlightError(f"--out {error}") from error


@contextlib.contextmanager
def result_folder(out: Path, ours: tuple[str, ...]) -> Iterator[Path]:
    """A new folder that takes the place of `out` when the block ends well: results of an earlier run go, all else stays.

    If the block fails, `out` is as it was. results.json, which the block must write, gets the list of all files that it wrote.

    **Arguments:** as `refuse_place`.
    """
    with whole_folder(out, lambda old: _kept(out, old, ours)) as folder:
        yield folder
        sign(folder)


def write_report(folder: Path, summary: "Summary", drawings: "Sequence[Drawing]", page: str) -> None:
    """What every verb leaves behind: results.json with all figures of the summary, NAME.png of each drawing, report.html."""
    (folder / RESULTS).write_text(results_text(summary), encoding="utf-8")
    for drawing in drawings:
        drawing.write(folder)
    (folder / "report.html").write_text(page, encoding="utf-8")


def _kept(out: Path, real: Path, ours: tuple[str, ...], flight: Path | None = None) -> list[str]:
    """What goes along when results are replaced; **raises** where that would lose something."""
    if (real / "flight.toml").exists():
        raise FlightError(f"{out}: this folder holds a flight; give another one for the results")
    kept = of_others(real, ours)
    read = real if flight is None else Path(os.path.realpath(flight))
    if real in read.parents and (name := read.relative_to(real).parts[0]) not in kept:
        raise FlightError(f"{out} holds in {name} the flight that is read, which the results would replace; give another folder")
    return kept
