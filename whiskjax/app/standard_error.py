"""Lines on standard error; where it is closed, or a pipe that nobody reads any more, they are not said, and nothing fails."""

import contextlib
import sys


def write_line(text: str) -> None:
    """Write one line now."""
    stream = sys.stderr
    if stream is None:  # closed before Python began
        return
    with contextlib.suppress(OSError, ValueError):  # ValueError: closed since
        stream.write(f"{text}\n")
        stream.flush()


def is_terminal() -> bool:
    """Whether somebody reads along."""
    try:
        return sys.stderr is not None and sys.stderr.isatty()
    except ValueError:
        return False
