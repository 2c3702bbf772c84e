"""`python -m benchmarks trust`: can the verdict be fooled?

Every way to be wrong is tried on many seeds, truth and errors drawn anew in each, and the verdict is compared with the truth.
"""

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import repeat
from pathlib import Path

import jax

from ..one_thread import CORES
from .catalogue import CATALOGUE, chosen
from .run import Bench, Row, Run
from .suspects import SCENES, Tried, tried
from .suspects import SEEDS as SUSPECTS_SEEDS
from .suspects import table as table_of_suspects
from .table import page, table, write
from .way import Way

SEEDS, CLEAN, OTHER_CLEAN = 100, 1000, 200
SHORT_SEEDS, SHORT_CLEAN = 1, 2
_PROCESSES = 2


def rows_of(ways: Sequence[Way], seeds: int, clean: int) -> Iterator[Row]:
    """The rows of these ways, one after the other, in this process.

    **Arguments:** `seeds`: of each way; `clean`: of clean data of the scene itself, and at most `OTHER_CLEAN` of its variants.
    """
    jax.config.update("jax_enable_x64", True)
    for way in ways:
        yield _bench().row(way, range(_count(way, seeds, clean)))


def _count(way: Way, seeds: int, clean: int) -> int:
    if way.kind != "clean":
        return seeds
    return clean if way.name == "clean" else min(clean, OTHER_CLEAN)


@cache
def _bench() -> Bench:
    """One for each process, which keeps what was answered to data that are not spoiled."""
    return Bench()


def main(arguments: Sequence[str]) -> int:
    """Runs what is asked and prints the table; 0 where no scored way fooled the verdict."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks trust", description=__doc__)
    parser.add_argument("--verb", nargs="+", choices=tuple(CATALOGUE), default=list(CATALOGUE), help="default: all")
    parser.add_argument("--way", nargs="+", default=[], metavar="NAME", help="beginnings of names of ways (default: all)")
    parser.add_argument("--seeds", type=int, help=f"of each way (default: {SEEDS})")
    parser.add_argument("--clean", type=int, help=f"seeds of clean data (default: {CLEAN}; of variants at most {OTHER_CLEAN})")
    parser.add_argument("--suspects", action="store_true", help="only: is the number that is wrong the one that is suspected?")
    parser.add_argument("--short", action="store_true", help=f"{SHORT_SEEDS} seeds and {SHORT_CLEAN} clean ones, in this process")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write all figures")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="write the tables as a Markdown page")
    options = parser.parse_args(arguments)
    seeds = options.seeds or (SHORT_SEEDS if options.short else SEEDS)
    clean = options.clean or (SHORT_CLEAN if options.short else CLEAN)
    if options.suspects:
        print(suspected(options.seeds or SUSPECTS_SEEDS))
        return 0
    ways = chosen(options.verb, options.way, options.short)
    start, rows = time.perf_counter(), []
    for row in (rows_of if options.short else _in_processes)(ways, seeds, clean):
        rows.append(row)
        print(f"{time.perf_counter() - start:.0f} s, {row.way.verb}: {row.way.name}", file=sys.stderr, flush=True)
        if options.out is not None:  # of a run that is cut short, what was found
            write(rows, options.out)
    print(page(rows) if options.page is None else table(rows))
    print(f"{sum(len(row.runs) for row in rows)} runs, {time.perf_counter() - start:.0f} s")
    if options.page is not None:
        options.page.write_text(page(rows), encoding="utf-8")
    return int(any(row.way.kind == "scored" and row.share("fooled") > 0 for row in rows))


def suspected(seeds: int) -> str:
    """The table of suspects, scene by scene."""
    spawn, scenes = multiprocessing.get_context("spawn"), list(SCENES)
    with ProcessPoolExecutor(_PROCESSES, spawn, initializer=_use, initargs=(CORES,)) as pool:
        return table_of_suspects([run for runs in pool.map(_suspects_of, scenes, repeat(seeds)) for run in runs])


def _suspects_of(scene: str, seeds: int) -> list[Tried]:
    jax.config.update("jax_enable_x64", True)
    found = []
    for seed in range(seeds):
        found += tried(scene, seed)
        print(f"{scene}: seed {seed}", file=sys.stderr, flush=True)
    return found


def _in_processes(ways: Sequence[Way], seeds: int, clean: int) -> Iterator[Row]:
    """The same rows, of which each process takes the next as soon as it has done one."""
    asked = [(way.verb, way.name) for way in ways]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(_PROCESSES, spawn, initializer=_use, initargs=(CORES,)) as pool:
        for way, found in zip(ways, pool.map(_runs_of, asked, repeat(seeds), repeat(clean)), strict=True):
            yield Row(way, *found)


def _use(cores: set[int]) -> None:
    """The other benchmarks keep to one core, which processes at once would share."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def _runs_of(asked: tuple[str, str], seeds: int, clean: int) -> tuple[tuple[str, ...], tuple[Run, ...]]:
    """Names of unknowns and runs of a way, told by verb and name: ways are functions, and stay where they are."""
    (way,) = (way for way in CATALOGUE[asked[0]] if way.name == asked[1])
    (row,) = rows_of([way], seeds, clean)
    return row.names, row.runs
