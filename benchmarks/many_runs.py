"""Thousands of calibrations of one flight with other image noise, in a process of its own: its wall clock and its memory.

Run by batch.py with the number of runs, how often to repeat them, and the cores to use; prints JSON.
"""

import json
import os
import resource
import sys
import time

COMPILING = 250  # runs that let everything be compiled


def main(runs: int, repeats: int, cores: list[int]) -> None:
    os.sched_setaffinity(0, cores)  # before jax counts them

    import numpy as np

    import whiskjax as wj

    from .whiskbroom import control_points, recorded

    flight, observed = recorded(), control_points()
    noise_px = np.random.default_rng(7).normal(0, observed.sigma_px, (runs, *observed.pixel_px.shape))

    def calibrate(runs: int) -> wj.Batch:
        return wj.calibrate_redrawn(flight.sensor, observed, flight.unknowns, observed.pixel_px + noise_px[:runs])

    calibrate(COMPILING)
    wall_s = []
    for _ in range(repeats):
        start = time.perf_counter()
        answer = calibrate(runs)
        wall_s.append(time.perf_counter() - start)
        assert answer.is_successful.all()
    peak_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9  # Linux counts in KiB
    print(json.dumps({"wall_s": min(wall_s), "peak_gb": peak_gb}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), [int(core) for core in sys.argv[3].split(",")])
