"""What the command is doing, on standard error: a bar where somebody reads along, else a line every few seconds."""

import contextlib
import threading
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from ..rules.progress import telling
from .compiling import Compiling
from .standard_error import is_terminal, write_line

EVERY_S = 5.0
SOON_S = 1.0
_MANY = 6


class Stages:
    """Says which of its stages a command is in, what its verb tells of it (`telling`), and when JAX compiles.

    What is over at once is not said: bad input is answered by the error alone.

    **Arguments:** `names`: in the order in which `enter` will name them.
    """

    def __init__(self, *names: str):
        self._names = names
        self._at = 0
        self._told = ""
        self._compiling = Compiling(self._changed)
        self._shown = _Bar(len(names)) if is_terminal() else _Lines()
        self._open = contextlib.ExitStack()

    def __enter__(self) -> "Stages":
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._shown)
            self._changed()
            stack.enter_context(self._compiling)
            stack.enter_context(telling(self._tell))
            self._open = stack.pop_all()
        return self

    def enter(self, name: str) -> None:
        """Say that a stage begins; those before it are done."""
        self._at, self._told = self._names.index(name), ""
        self._changed(is_news=self._at > 0)

    def _tell(self, doing: str) -> None:
        self._told = doing
        self._changed()

    def _changed(self, is_news: bool = False) -> None:
        self._shown.show(self._words(), self._at, is_news)

    def _words(self) -> str:
        """The stage, how many there are if many, and what goes on in it."""
        many = f" ({self._at + 1} of {len(self._names)})" if len(self._names) > _MANY else ""
        doing = [word for word in (self._told, "compiling" * self._compiling.is_now) if word]
        return ": ".join([self._names[self._at] + many, *doing])

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._open.close()


class _Bar:
    """A progress bar on a terminal, gone when all is done."""

    def __init__(self, stages: int):
        self._progress = Progress(
            SpinnerColumn(),
            BarColumn(bar_width=24),
            TextColumn("{task.description}", markup=False),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._progress.add_task("", total=stages)

    def __enter__(self) -> "_Bar":
        self._progress.start()
        return self

    def show(self, words: str, at: int, is_news: bool) -> None:
        self._progress.update(self._task, description=words, completed=at)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


class _Lines:
    """A line when a new stage has lasted a second, and one every few seconds, from a thread that does nothing else."""

    def __init__(self):
        self._words = ""
        self._start = self._due = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="whiskjax progress", daemon=True)

    def __enter__(self) -> "_Lines":
        self._start = time.monotonic()
        self._due = self._start + EVERY_S
        self._thread.start()
        return self

    def show(self, words: str, at: int, is_news: bool) -> None:
        self._words = words
        if is_news:
            self._due = min(self._due, time.monotonic() + SOON_S)

    def _run(self) -> None:
        while not self._end.wait(min(SOON_S, EVERY_S) / 4):
            now = time.monotonic()
            if now >= self._due:
                self._due = now + EVERY_S
                write_line(f"whiskjax: {self._words} ... {now - self._start:.0f} s")

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
