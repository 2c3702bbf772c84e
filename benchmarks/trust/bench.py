"""`python -m benchmarks trust`: can the verdict be fooled?

Every way to be wrong is tried on many seeds, truth and errors drawn anew in each, and the verdict is compared with the truth.
"""

import argparse
import multiprocessing
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import jax

from .catalogue import CATALOGUE, chosen
from .run import Bench, Row
from .table import page, table, write

SEEDS, CLEAN, SHORT = 100, 1000, 3
_PROCESSES = 2


def rows_of(verb: str, names: Sequence[str], seeds: int, clean: int, part: int = 0, parts: int = 1) -> list[Row]:
    """The rows of one verb, or every so many of them, in this process."""
    jax.config.update("jax_enable_x64", True)
    bench = Bench()
    rows = []
    for way in chosen([verb], names)[part::parts]:
        start = time.perf_counter()
        rows.append(bench.row(way, range(clean if way.kind == "clean" else seeds)))
        print(f"{verb}: {way.name}, {time.perf_counter() - start:.1f} s", file=sys.stderr, flush=True)
    return rows
