"""The list of benchmarks: what is measured, and what was asked of it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from .timing import Measured


@dataclass(frozen=True)
class Benchmark:
    """A measurement and the largest figure that passes.

    **Arguments**: what: for people; asked: None where no figure was asked for and only the baseline guards it; unit: "x" for our
    time over the peer's, "s" for seconds, "GB" for memory; on_request: measured only where it is named.
    """

    name: str
    what: str
    peer: str
    asked: float | None
    unit: Literal["x", "s", "GB"]
    measure: Callable[[], Measured]
    on_request: bool = False


BENCHMARKS: dict[str, Benchmark] = {}


def benchmark(
    name: str, *, what: str, peer: str, asked: float | None, unit: Literal["x", "s", "GB"] = "x", on_request: bool = False
):
    """Puts a function that measures into the list."""

    def register(measure: Callable[[], Measured]) -> Callable[[], Measured]:
        if name in BENCHMARKS:
            raise ValueError(f"two benchmarks are called {name}")
        BENCHMARKS[name] = Benchmark(name, what, peer, asked, unit, measure, on_request)
        return measure

    return register
