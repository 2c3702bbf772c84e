"""Locks on files: held by an open file, so that the kernel frees them when a process ends, however it ends."""

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

_CANNOT = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of a path, waiting for it; the file is there only as long as somebody holds it or waits.

    Where the file system has no locks nothing is held.
    """
    while True:
        handle = _open(path)
        try:
            _lock(handle, fcntl.LOCK_EX)
            if _is_at(handle, path):
                break
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # whoever held it has removed the file: what was locked is no longer the lock of this path
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def hold(path: Path) -> int:
    """Make a file and hold its lock until the handle that is returned is closed."""
    handle = _open(path)
    _lock(handle, fcntl.LOCK_EX)
    return handle


def is_held(path: Path) -> bool:
    """Whether some process, this one included, holds the lock of a file; also True where that cannot be known."""
    handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        return not _lock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(handle)


def _open(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)


def _lock(handle: int, how: int) -> bool:
    """Whether it is locked now; False where the file system has no locks."""
    try:
        fcntl.flock(handle, how)
    except BlockingIOError:
        raise
    except OSError as error:
        if error.errno in _CANNOT:
            return False
        raise
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path, follow_symlinks=False))
    except FileNotFoundError:
        return False
