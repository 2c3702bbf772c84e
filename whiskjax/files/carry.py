"""Files of somebody else in a folder that is replaced: they go along, by a second name for the same file."""

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from ..rules.errors import FlightError

MOST = 10_000
# A file system without hard links, one file with too many of them, or somebody else's file that the kernel protects.
_NO_LINKS = (errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)


def check_carried(folder: Path, names: Iterable[str]) -> None:
    """Refuse what could not be carried along, or not be removed afterwards.

    **Raises:** `FlightError` naming a folder that may not be changed or lies on another file system; and where there are more
    than 10,000 entries: then somebody took the folder for another one.
    """
    count, device = 0, folder.stat().st_dev
    for root in (folder / name for name in names):
        for path, folders, files in os.walk(root) if _is_folder(root) else ():
            count += len(folders) + len(files)
            if os.stat(path).st_dev != device:
                raise FlightError(
                    f"{folder} holds another file system, mounted at {path}; give the results a folder of their own"
                )
            if not os.access(path, os.R_OK | os.W_OK | os.X_OK):
                raise FlightError(f"{folder} holds {path}, which you may not change; give the results a folder of their own")
            if count > MOST:
                raise FlightError(f"{folder} holds more than {MOST} files of others; give the results a folder of their own")


def carry(source: Path, into: Path, names: Iterable[str]) -> None:
    """Give entries of one folder a second place in another of the same file system: files as hard links, folders with their
    rights and times, links as links. Where hard links are not to be had, files are copied.

    **Raises:** `OSError`; the source is as it was.
    """
    made: list[tuple[Path, Path]] = []
    waiting = [(source / name, into / name) for name in names]
    while waiting:
        there, here = waiting.pop()
        if _is_folder(there):
            here.mkdir()
            made.append((there, here))
            waiting += [(there / name, here / name) for name in os.listdir(there)]
        else:
            _link(there, here)
    for there, here in reversed(made):  # inner ones first: what is put into a folder changes its time
        like(there, here)


def like(there: Path, here: Path) -> None:
    """Rights, times, extended attributes, and, where we may, the owner of a folder."""
    of = there.stat()
    if (of.st_uid, of.st_gid) != (here.stat().st_uid, here.stat().st_gid):
        with contextlib.suppress(OSError):
            os.chown(here, of.st_uid, of.st_gid)
    shutil.copystat(there, here)


def _link(there: Path, here: Path) -> None:
    try:
        os.link(there, here, follow_symlinks=False)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        shutil.copy2(there, here, follow_symlinks=False)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()
