"""What goes wrong is one line on standard error and an exit code, never a traceback."""

import functools
from collections.abc import Callable
from typing import TypeVar

import typer

from ..rules import WhiskjaxError
from .standard_error import write_line

BAD_INPUT, NOT_SOUND = 1, 3

F = TypeVar("F", bound=Callable[..., None])


def answers_failures(verb: F) -> F:
    """A verb whose refusals (bad input, files that cannot be read or written, missing extras) end in exit code 1."""

    @functools.wraps(verb)
    def guarded(*args, **kwargs):
        try:
            return verb(*args, **kwargs)
        except BrokenPipeError:
            raise
        except OSError as error:
            _say(f"{error.strerror or error}: {error.filename}" if error.filename else str(error))
        except (WhiskjaxError, ImportError) as error:
            _say(str(error))
        raise typer.Exit(BAD_INPUT)

    return guarded  # pyright: ignore[reportReturnType]


def _say(message: str) -> None:
    write_line(f"whiskjax: error: {message}")
