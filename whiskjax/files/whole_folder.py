"""A folder that is written whole or not at all, whenever its writer dies and whoever writes beside it.

Everything about a run lies in a work folder beside the name, `.NAME.writing-XXXXXXXX`: `new`, which is being filled, and `lock`,
whose lock the run holds until it ends, so that others can tell a run at work from one that was killed. When `new` is complete it
changes places with the folder in one system call (Linux: `renameat2` with RENAME_EXCHANGE; macOS: `renamex_np` with RENAME_SWAP),
under the lock `.NAME.lock`: at every instant the name leads to a whole folder, old or new. What a killed run leaves beside it is
its work folder, which the next run removes.

File systems without that call (some network ones) need two renames: the old folder to `old` in the work folder, then `new` to the
name. A run killed between the two leaves no folder of that name, but both whole in its work folder; the next run puts the old one
back. A cut of power is another matter: nothing here waits for the disk.
"""

import contextlib
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from .carry import carry, like
from .exchange import exchange
from .lock import hold, is_held, locked
from .place import check_place, try_to_write

_PARTS = {"lock", "new", "old", "gone"}  # of a work folder
_LONGEST = 150  # bytes of a name that is taken into those beside it


def check_before(folder: str | Path, keep: Callable[[Path], Iterable[str]]) -> None:
    """Before the work: whether `whole_folder` will be able to write there. What killed runs left beside it is removed.

    **Raises:** `FlightError` where it will not be.
    """
    real = check_place(folder)
    try_to_write(folder)
    if real.parent.exists():
        with locked(_beside(real, "lock")):
            _clear_dead(real)
            if real.exists():
                keep(real)


@contextlib.contextmanager
def whole_folder(folder: str | Path, keep: Callable[[Path], Iterable[str]]) -> Iterator[Path]:
    """A new folder that takes its place when the block ends well; if the block fails, everything is as it was.

    Two runs at once into one folder both end whole; the later one stays.

    **Arguments:**

    - `folder`: where; it is made, with its parents.
    - `keep`: asked under the lock, when the new folder is complete, and only where there is an old one: the names in the old one
      that are not replaced but taken along. It raises where the old folder may not be replaced.

    **Raises:** `FlightError` where nothing can be put there (`check_place`).
    """
    folder = check_place(folder)
    made = _make_parents(folder.parent)
    try:
        with locked(_beside(folder, "lock")):
            _clear_dead(folder)
            work = Path(tempfile.mkdtemp(prefix=_beside(folder, "writing-").name, dir=folder.parent))
            held = hold(work / "lock")
        try:
            (work / "new").mkdir()
            yield work / "new"
            with locked(_beside(folder, "lock")):
                try:
                    _put(work, folder, keep)
                finally:
                    _settle(work, folder)
        finally:
            _remove(work)
            os.close(held)
    except BaseException:
        for parent in reversed(made):
            with contextlib.suppress(OSError):
                parent.rmdir()
        raise


def _clear_dead(folder: Path) -> None:
    """Remove what killed runs left beside a folder, and put the folder back where one was killed between two renames.

    Only to be called under the lock of the folder.
    """
    name = re.compile(re.escape(_beside(folder, "writing-").name) + "[a-z0-9_]{8}")
    for path in sorted(folder.parent.iterdir()):
        if not name.fullmatch(path.name):
            continue
        try:
            if {*os.listdir(path)} <= _PARTS and not is_held(path / "lock"):
                _settle(path, folder)
                _remove(path)
        except FileNotFoundError:  # the lock is the last to go
            with contextlib.suppress(OSError):
                path.rmdir()
        except NotADirectoryError:
            continue


def _beside(folder: Path, what: str) -> Path:
    """The path of a hidden neighbour; long names are replaced by their hash, as no name has more than 255 bytes."""
    name = os.fsencode(folder.name)
    key = folder.name if len(name) <= _LONGEST else hashlib.sha256(name).hexdigest()[:32]
    return folder.with_name(f".{key}.{what}")


def _put(work: Path, folder: Path, keep: Callable[[Path], Iterable[str]]) -> None:
    """Put the new folder in its place, with what is kept of the old one."""
    new = work / "new"
    if not folder.exists():
        new.rename(folder)
        return
    there = {*os.listdir(folder)}
    carry(folder, new, keep(folder))
    like(folder, new)
    os.utime(new)
    if exchange(new, folder):
        old = new
    else:
        old = folder.rename(work / "old")
        new.rename(folder)
    # What somebody put into the old folder in the meantime.
    carry(old, folder, {*os.listdir(old)} - there - {*os.listdir(folder)})


def _settle(work: Path, folder: Path) -> None:
    """Put the old folder back, if it was taken away and nothing came in its place.

    Only to be called under the lock of the folder: without it the name may be missing for the instant between another run's two
    renames, and what is put there is in that run's way.
    """
    with contextlib.suppress(FileNotFoundError):
        if folder.exists():
            (work / "old").rename(work / "gone")  # a half removed folder must never be put back
        else:
            (work / "old").rename(folder)


def _remove(work: Path) -> None:
    """Remove a work folder, with what was settled in it."""
    for name in ("new", "gone"):
        shutil.rmtree(work / name, ignore_errors=True)
    if os.listdir(work) == ["lock"]:  # else something could not be removed, and the next run tries again
        (work / "lock").unlink()
        with contextlib.suppress(FileNotFoundError):
            work.rmdir()


def _make_parents(parent: Path) -> list[Path]:
    """Make the folders that are missing; returns them, outermost first."""
    missing = [folder for folder in (parent, *parent.parents) if not folder.exists()][::-1]
    for folder in missing:
        folder.mkdir(exist_ok=True)
    return missing
