"""Where a whole folder can be put; asked before the work, so that no run is lost to the name of its results."""

import os
import stat
import tempfile
from pathlib import Path

from ..rules.errors import FlightError

_PROBE = b"\0" * 65536


def check_place(folder: str | Path) -> Path:
    """Where a folder of this name is put: an absolute path, every link followed.

    A folder is replaced by renaming (`whole_folder`), which asks more of its place than writing into it does: its parent must be
    writable, and it may be neither a mount point nor where this process stands.

    **Raises:** `FlightError` that begins with the name given and says what is wrong with it and what to do.
    """
    given = Path(folder)
    if "\0" in str(given):
        raise FlightError(f"{str(given)!r}: no name of a folder holds a zero byte; give another name")
    try:
        real = _followed(given)
        _refuse_kind(given, real)
        there = _existing(real.parent)
        _refuse_rights(given, real, there)
        _refuse_names(given, real, there)
    except OSError as error:
        raise FlightError(f"{given}: {error.strerror or error}; give another folder") from error
    return real


def try_to_write(folder: str | Path) -> None:
    """Make a folder and a file of 64 KiB where a folder is to be put, and remove both: quotas and full or broken disks show only
    in the doing.

    **Raises:** `FlightError` where that fails.
    """
    there = _existing(Path(folder).resolve().parent)
    try:
        with tempfile.TemporaryDirectory(prefix=".whiskjax-", dir=there) as made:
            handle = os.open(Path(made) / "probe", os.O_WRONLY | os.O_CREAT, 0o600)
            try:
                os.write(handle, _PROBE)
                os.fsync(handle)  # some file systems notice only here that there is no space
            finally:
                os.close(handle)
    except OSError as error:
        raise FlightError(
            f"{folder}: nothing can be written in {there}: {error.strerror or error}; give another folder"
        ) from error


def _followed(given: Path) -> Path:
    """The path with every link followed; one that leads nowhere is refused, as what it means is anybody's guess."""
    try:
        real = given.resolve()
    except RuntimeError as error:  # Python before 3.13 says so of links in a circle
        raise FlightError(f"{given}: its links lead in a circle; give the name of a folder") from error
    for path in (given.absolute(), *given.absolute().parents):
        if path.is_symlink() and not path.exists():
            raise FlightError(
                f"{given}: {path} is a link to {os.readlink(path)}, which does not exist; make that, or remove the link"
            )
    return real


def _refuse_kind(given: Path, real: Path) -> None:
    """What is there already must be a folder that can be renamed."""
    if real.exists() and not real.is_dir():
        raise FlightError(f"{given} is a file; give the name of a folder")
    if os.path.ismount(real):
        raise FlightError(f"{given} is where a file system is mounted, which cannot be replaced; give a folder inside of it")
    try:
        here = Path.cwd().resolve()
    except OSError:  # the folder in which this process began is gone
        return
    if real == here or real in here.parents:
        raise FlightError(
            f"{given} is the folder that you are in, or one above it, and would be replaced under your feet; give a folder "
            "inside of it"
        )


def _existing(there: Path) -> Path:
    """The folder itself, or the nearest one above it that exists."""
    while not there.exists():
        there = there.parent
    return there


def _refuse_rights(given: Path, real: Path, there: Path) -> None:
    """Renaming changes the parent and the folder that is renamed."""
    if not there.is_dir():
        raise FlightError(f"{given}: {there} is a file; give the name of a folder")
    for folder in (there, real) if real.exists() else (there,):
        if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            raise FlightError(f"{given}: you may not write in {folder}; give another folder")
    if real.exists() and there.stat().st_mode & stat.S_ISVTX and os.geteuid() not in (0, there.stat().st_uid, real.stat().st_uid):
        raise FlightError(f"{given} belongs to somebody else, and in {there} only owners rename; give another folder")


def _refuse_names(given: Path, real: Path, there: Path) -> None:
    longest = os.pathconf(there, "PC_NAME_MAX")
    for part in real.relative_to(there).parts:
        if len(os.fsencode(part)) > longest:
            raise FlightError(f"{given}: a name too long, of more than {longest} bytes; give another folder")
