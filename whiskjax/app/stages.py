"""What the command is doing, on standard error, for people who wait; silent where nobody watches."""

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


class Stages:
    """A progress bar over named stages.

    **Arguments:** `names`: in the order in which `enter` will name them.
    """

    def __init__(self, *names: str):
        console = Console(stderr=True)
        self._names = names
        self._progress = Progress(
            SpinnerColumn(),
            BarColumn(bar_width=24),
            TextColumn("{task.description}"),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=len(names))

    def __enter__(self) -> "Stages":
        self._progress.start()
        return self

    def enter(self, name: str) -> None:
        """Say that a stage begins; those before it are done."""
        self._progress.update(self._task, description=name, completed=self._names.index(name))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._progress.stop()
