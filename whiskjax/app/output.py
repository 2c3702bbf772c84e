"""An output folder that is written whole or not at all."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..rules import FlightError

if TYPE_CHECKING:
    from ..show.plain import Summary
    from ..show.style import Drawing


def refuse_place(out: Path, flight: Path | None = None) -> None:
    """Refuse, before any work is done, a place where results cannot go.

    **Raises:** `FlightError` where `out` is a file, holds a flight, or lies where this user may not write.
    """
    if out.exists() and not out.is_dir():
        raise FlightError(f"--out {out}: this is a file; give the name of a folder")
    if (out / "flight.toml").exists() or (flight is not None and out.resolve() == flight.resolve()):
        raise FlightError(f"--out {out}: this folder holds a flight; give another one for the results")
    there = out.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise FlightError(f"--out {out}: {there} is a file; give the name of a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FlightError(f"--out {out}: you may not write in {there}")


@contextlib.contextmanager
def whole_folder(out: Path, ours: tuple[str, ...]) -> Iterator[Path]:
    """A temporary folder beside `out` whose contents take their place there when the block ends well.

    If the block fails, the temporary folder and the parents made for it go, and `out` is as it was. In a folder that exists,
    results of an earlier run are replaced and all else is left alone.

    **Arguments:** `ours`: the names that a run may write; old ones that the new run did not write are removed.
    """
    out = out.absolute()
    made = _make_parents(out.parent)
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}.writing-", dir=out.parent))
        try:
            yield temporary
            temporary.chmod(0o777 & ~_umask())
            if out.exists():
                for name in ours:
                    _remove(out / name)
                for path in sorted(temporary.iterdir()):
                    _remove(out / path.name)
                    path.rename(out / path.name)
            else:
                temporary.rename(out)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except BaseException:
        for folder in reversed(made):
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def write_report(folder: Path, summary: "Summary", drawings: "Sequence[Drawing]", page: str) -> None:
    """What every verb leaves behind: results.json with all figures of the summary, NAME.png of each drawing, report.html."""
    text = json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    for drawing in drawings:
        drawing.write(folder)
    (folder / "report.html").write_text(page, encoding="utf-8")


def _make_parents(parent: Path) -> list[Path]:
    """Make the folders that are missing; returns them, outermost first."""
    missing = [folder for folder in (parent, *parent.parents) if not folder.exists()][::-1]
    for folder in missing:
        folder.mkdir(exist_ok=True)
    return missing


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _umask() -> int:
    """The umask, which can only be read by setting it; temporary folders are private, results are as other files."""
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
