"""Two programs raced against each other in one process."""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import jax


@dataclass(frozen=True)
class Measured:
    """What a benchmark found.

    **Arguments**: reached: the figure that was asked for, a ratio of times (ours / peer's) or seconds; of a race also the
    median over its rounds and the same by the wall clock, the seconds of one call of ours and of the peer, and how many
    items one call works on; compile_s: seconds that tracing and compiling took once, which are in no ratio; note: what
    else the reader should know.
    """

    reached: float
    median: float | None = None
    wall: float | None = None
    ours_s: float | None = None
    peer_s: float | None = None
    items: int = 1
    compile_s: float | None = None
    note: str = ""


def compiled(function: Callable[..., Any], *args: Any) -> tuple[Callable[..., Any], float]:
    """A jitted function compiled for these arguments, and the seconds that took."""
    start = time.perf_counter()
    executable = jax.jit(function).lower(*args).compile()
    return executable, time.perf_counter() - start


def race(
    ours: Callable[[], Any],
    peer: Callable[[], Any],
    *,
    items: int = 1,
    compile_s: float | None = None,
    note: str = "",
    seconds: float = 5.0,
    least_rounds: int = 15,
    least_s: float = 4e-3,
) -> Measured:
    """Runs ours and the peer in turn, many short times, so that whatever else the machine does strikes both alike.

    Time is CPU time of this process: with one thread on one core it is the wall clock without the time lent to others. The
    ratio is that of the fastest calls, which noise can only slow; the median over the rounds stands beside it.

    **Arguments**: ours returns jax arrays, which are waited for; seconds: how long to race at least; least_s: a call that
    takes less is repeated to this length within a round.
    """

    def ours_done() -> None:
        jax.block_until_ready(ours())

    runs = ours_done, peer
    repeats = []
    for run in runs:
        run()  # the first call may still load or allocate
        start = time.perf_counter()
        run()
        repeats.append(max(1, round(least_s / (time.perf_counter() - start))))
    cpu: tuple[list[float], list[float]] = ([], [])
    wall: tuple[list[float], list[float]] = ([], [])
    was_collecting = gc.isenabled()
    gc.disable()
    try:
        end = time.perf_counter() + seconds
        while len(cpu[0]) < least_rounds or time.perf_counter() < end:
            for i, run in enumerate(runs):
                start_cpu, start_wall = time.process_time(), time.perf_counter()
                for _ in range(repeats[i]):
                    run()
                wall[i].append((time.perf_counter() - start_wall) / repeats[i])
                cpu[i].append((time.process_time() - start_cpu) / repeats[i])
    finally:
        if was_collecting:
            gc.enable()
    fastest = [min(times) for times in cpu]
    return Measured(
        reached=fastest[0] / fastest[1],
        median=median(a / b for a, b in zip(*cpu, strict=True)),
        wall=min(wall[0]) / min(wall[1]),
        ours_s=fastest[0],
        peer_s=fastest[1],
        items=items,
        compile_s=compile_s,
        note=note,
    )
