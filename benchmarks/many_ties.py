"""A block in a process of its own, on one thread and with nothing compiled before: memory, compile time, the whole adjustment.

Run by three_line.py with a task, a file, and the numbers that the task takes; prints JSON.
"""

import os

os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)

from .one_thread import keep_to_one_thread

keep_to_one_thread()

import dataclasses  # noqa: E402
import json  # noqa: E402
import pickle  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import jax  # noqa: E402
import numpy as np  # noqa: E402

from whiskjax.estimate.block.solve import gauss_newton, reduce  # noqa: E402
from whiskjax.flights import songshan  # noqa: E402

from .own_process import peak_gb  # noqa: E402
from .three_line import Posed, pose  # noqa: E402


def draw(path: Path, ties: int, copies: int) -> dict[str, float]:
    """Writes copies of a block."""
    cpu_s, at = _timed(lambda: pose(songshan.Scene("A", "nominal", ties)))
    path.write_bytes(pickle.dumps(copied(at, copies)))
    return {"draw_s": cpu_s, "peak_gb": peak_gb()}


def copied(at: Posed, copies: int) -> Posed:
    """All points as many times, each time measured anew, over the same trajectory.

    A copy adds noise of its own to the one that was drawn, so sigmas are larger by sqrt(2). To draw a million tie points, line
    searches and all, would take as long as to adjust them.
    """
    block, rng = at.block, np.random.default_rng(1)

    def repeated(a: Any) -> np.ndarray:
        return np.tile(a, (copies, *[1] * (np.ndim(a) - 1)))

    sigma = repeated(block.sigma_px)
    noise = sigma * rng.standard_normal(sigma.shape)
    shot = jax.tree.map(repeated, block.shot)
    more = dataclasses.replace(
        block,
        shot=dataclasses.replace(shot, time_s=shot.time_s + songshan.LINE_S * noise[:, 1]),
        pixel_px=repeated(block.pixel_px) + noise * [1, 0],
        sigma_px=np.sqrt(2) * sigma,
        point=np.concatenate([block.point + k * len(block.role) for k in range(copies)]),
        position_m=repeated(block.position_m),
        covariance_m2=repeated(block.covariance_m2),
        role=repeated(block.role),
        points=(),
        images=(),
    )
    return at._replace(block=more, start_m=repeated(at.start_m))


def solve(path: Path) -> dict[str, float]:
    """CPU seconds and memory of the solution from given coordinates, as Ceres begins."""
    at: Posed = pickle.loads(path.read_bytes())
    loaded_gb = peak_gb()
    prepare_s, prepared = _timed(at.prepared)
    first_s, _ = _timed(lambda: reduce(prepared.ready, prepared.start))
    reduce_s, _ = _timed(lambda: reduce(prepared.ready, prepared.start))
    solve_s, solved = _timed(lambda: gauss_newton(prepared.ready, prepared.start))
    return {
        "rays": len(at.block),
        "loaded_gb": loaded_gb,
        "prepare_s": prepare_s,
        "compile_s": first_s - reduce_s,
        "reduce_s": reduce_s,
        "solve_s": solve_s,
        "steps": solved.steps,
        "cost": float(solved.reduced.cost),
        "bytes_a_ray": sum(a.nbytes for a in jax.tree.leaves(prepared.ready.tiles)) / len(at.block),
        "peak_gb": peak_gb(),
    }


def adjust(path: Path, calls: int) -> dict[str, float]:
    """CPU seconds of the first and the last call of `wj.adjust`, and the memory that it takes, covariances included."""
    at: Posed = pickle.loads(path.read_bytes())
    took_s, found = zip(*[_timed(at.adjusted) for _ in range(calls)], strict=True)
    return {"first_s": took_s[0], "adjust_s": took_s[-1], "factor": found[-1].variance_factor, "peak_gb": peak_gb()}


def _timed(of: Callable[[], Any]) -> tuple[float, Any]:
    """CPU seconds, and what came out."""
    start = time.process_time()
    answer = of()
    jax.block_until_ready(jax.tree.leaves(answer))
    return time.process_time() - start, answer


if __name__ == "__main__":
    task, path, numbers = sys.argv[1], Path(sys.argv[2]), map(int, sys.argv[3:])
    print(json.dumps({"draw": draw, "solve": solve, "adjust": adjust}[task](path, *numbers)))
