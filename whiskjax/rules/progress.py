"""What a long computation is doing, told to whoever listens: the command line, a notebook, a log.

Solvers on the host say one short line at each stage and round (`tell`). Nobody hears it unless a listener was named (`telling`),
so that nothing is printed by a library. Pure Python: nothing of it is traced, compiled or part of a result.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@contextmanager
def telling(listener: Callable[[str], None] | None) -> Iterator[None]:
    """Within the `with` block, the verbs tell what they are doing: `with telling(print): calibrate(...)`.

    **Arguments:** `listener`: called with one line of text ("blunders: start 12 of 61"), in the caller's thread, a few times to
    some hundred times in a run; None is silence. What it raises ends the computation. Blocks nest: the innermost listener hears.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(doing: str) -> None:
    """Say what is being done, as "subject: what is going on"; nothing happens where nobody listens."""
    listener = _listener.get()
    if listener is not None:
        listener(doing)
