"""Thousands of locations in a process of its own: raced on two cores, or watched for their memory.

Run by location.py with the task and the cores to use; prints JSON.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from .own_process import peak_gb

ROUNDS = 400  # a busy machine seldom leaves both cores to one call
MANY_RUNS, MANY_LOOKS = 10_000, 180
SHARE, LANES = 1000, 500  # runs that are drawn at once, and those that are located side by side


def race_threads(threads: int) -> dict[str, float]:
    """Wall clock of ours and of C++ on as many threads, each the fastest of many calls; and the median of their ratio."""
    import jax
    import numpy as np

    from . import location
    from .timing import compiled

    recorded, pixel_px = location.in_chunks(location.drawn(location.RUNS, location.LOOKS, 1), location.LANES)
    shares = [jax.tree.map(lambda a, k=k: a[k::threads], (recorded, pixel_px)) for k in range(threads)]
    executable, _ = compiled(location.locate(True), shares[0])
    peer = location.cxx.prepared(location.recorded_for_peer(), location.start_for_peer(), location.cxx.Sigmas(), True, threads)

    def done(share: Any) -> Any:
        return jax.block_until_ready(executable(share))

    with ThreadPoolExecutor(threads - 1) as pool:

        def ours() -> None:
            others = pool.map(done, shares[1:])
            done(shares[0])
            list(others)

        wall_s = np.array([[_wall(run) for run in (ours, peer)] for _ in range(ROUNDS)])
    ours_s, peer_s = wall_s.min(0)
    return {"ours_s": ours_s, "peer_s": peer_s, "median": float(np.median(wall_s[:, 0] / wall_s[:, 1]))}


def _wall(run: Callable[[], Any]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def watch_memory() -> dict[str, float]:
    """Locate run after run; records are drawn and forgotten share by share, estimates and covariances are kept."""
    import jax

    from . import location
    from .timing import compiled

    executable = None
    kept, draw_s, locate_s = [], 0.0, 0.0
    for seed in range(MANY_RUNS // SHARE):
        start = time.perf_counter()
        data = jax.block_until_ready(location.in_chunks(location.drawn(SHARE, MANY_LOOKS, seed), LANES))
        draw_s += time.perf_counter() - start
        executable = executable or compiled(location.locate(True), data)[0]
        start = time.perf_counter()
        kept.append(location.arrays(executable(data)))
        locate_s += time.perf_counter() - start
    return {"peak_gb": peak_gb(), "draw_s": draw_s, "locate_s": locate_s}


if __name__ == "__main__":
    task, cores = sys.argv[1], [int(core) for core in sys.argv[2].split(",")]
    os.sched_setaffinity(0, cores)  # before jax counts them
    print(json.dumps(race_threads(len(cores)) if task == "race" else watch_memory()))
