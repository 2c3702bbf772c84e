"""Large recordings read: 720,000 records of POS as CSV (55 MB), a million as SBET, against readers that check nothing."""

import csv
import functools
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from whiskjax.files.navigation import navigation_columns
from whiskjax.files.sbet import RECORD, read_sbet
from whiskjax.files.sheet import open_sheet
from whiskjax.files.tables import Column, Table

from .own_process import in_own_process
from .suite import benchmark
from .timing import Measured, race

ROWS, FEW_ROWS, RECORDS = 720_000, 72_000, 1_000_000
RATE_HZ = 200.0
FLIGHT = Path(__file__).parent.parent / "examples" / "haian"
NAMES = ("time_s", "lat_deg", "lon_deg", "height_m", "roll_deg", "pitch_deg", "heading_deg")


def columns(n: int) -> list[np.ndarray]:
    """A smooth flight to the north: time, latitude, longitude, height, roll, pitch, heading, in seconds, degrees and metres."""
    t = np.arange(n) / RATE_HZ
    wave = [0.5 * np.sin(t / period) for period in (3.1, 4.7, 11.0)]
    return [t, 32.0 + 5e-4 * t, 121.5 + 1e-4 * t, 3000 + wave[2], wave[0], wave[1], 30 + wave[2]]


@functools.cache
def folder() -> Path:
    """The files, written once; they go with the process."""
    made = tempfile.TemporaryDirectory(prefix="whiskjax-files-")
    _KEPT.append(made)
    path = Path(made.name)
    write_csv(path / "many.csv", columns(ROWS))
    write_csv(path / "few.csv", columns(FEW_ROWS))
    time_s, lat, lon, height, *attitude = columns(RECORDS)
    records = np.zeros(RECORDS, dtype=RECORD)
    fields = ("lat_rad", "lon_rad", "roll_rad", "pitch_rad", "heading_rad")
    for name, degrees in zip(fields, (lat, lon, *attitude), strict=True):
        records[name] = np.radians(degrees)
    records["time_s"], records["height_m"] = time_s, height
    records.tofile(path / "many.sbet")
    return path


_KEPT: list[Any] = []


def write_csv(path: Path, values: list[np.ndarray]) -> None:
    """As exporters write: 76 bytes a row."""
    digits = (7, 10, 10, 5, 6, 6, 6)
    form = ",".join(f"%.{d}f" for d in digits)
    with path.open("w") as file:
        file.write(",".join(NAMES) + "\n")
        np.savetxt(file, np.stack(values, axis=-1), fmt=form)


def parse(path: Path) -> Table:
    """A POS table, every cell checked."""
    sheet = open_sheet(path.parent, path.name, "the benchmark")
    return sheet.parse([Column("time_s"), *navigation_columns(sheet, "wgs84", "roll_pitch_heading")])


def textbook(path: Path) -> list[list[float]]:
    """The same numbers by Python's csv and float, nothing checked."""
    with path.open(newline="") as file:
        rows = csv.reader(file)
        next(rows)
        return [[float(cell) for cell in row] for row in rows]


def _same(path: Path, peer: Callable[[], Any]) -> None:
    found = parse(path)
    np.testing.assert_array_equal(np.stack([found[name] for name in NAMES], axis=-1), np.asarray(peer()))


@benchmark(
    "files.csv",
    what="a CSV table of 72,000 POS records, every cell checked, against Python's csv and float",
    peer="csv and float",
    asked=None,
)
def against_textbook() -> Measured:
    path = folder() / "few.csv"
    _same(path, lambda: textbook(path))
    return race(lambda: parse(path)["time_s"], lambda: textbook(path), items=FEW_ROWS, note="ours checks every cell")


@benchmark("files.csv.arrow", what="the same against Arrow alone, which checks nothing", peer="pyarrow.csv", asked=None)
def against_arrow() -> Measured:
    from pyarrow.csv import ReadOptions, read_csv

    path = folder() / "few.csv"
    raw = lambda: read_csv(path, ReadOptions(use_threads=False))
    _same(path, lambda: np.stack([column.to_numpy() for column in raw().columns], axis=-1))
    return race(lambda: parse(path)["time_s"], raw, items=FEW_ROWS, note="which checks nothing and names no line")


@functools.cache
def _many(what: str) -> dict[str, float]:
    path = folder() / "many.csv"
    if what == "flight":
        path = folder() / "flight"
        if not path.exists():
            shutil.copytree(FLIGHT, path)
            write_csv(path / "pos.csv", _as_recorded(path / "pos.csv"))
    return in_own_process("many_records", what, str(path))


def _as_recorded(path: Path) -> list[np.ndarray]:
    """The bundled flight's own POS, as many times as dense."""
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    time_s = np.linspace(table[0, 0], table[-1, 0], ROWS)
    return [time_s, *(np.interp(time_s, table[:, 0], column) for column in table.T[1:])]


@benchmark("files.csv.720k", what="a CSV table of 720,000 POS records (55 MB), every cell checked", peer="-", asked=2.0, unit="s")
def many_rows() -> Measured:
    table, flight = _many("table"), _many("flight")
    return Measured(table["seconds"], note=f"wall clock; all of read_flight with it as pos.csv {flight['seconds']:.2f} s")


@benchmark("files.csv.720k.memory", what="the same: peak memory above the import's, over the file", peer="the file", asked=4.0)
def memory() -> Measured:
    table, flight = _many("table"), _many("flight")
    note = f"peak above that of the imports, {table['peak_gb']:.3f} GB; of all of read_flight {flight['ratio']:.2f}x"
    return Measured(table["ratio"], note=note)


@benchmark("files.sbet.1M", what="an SBET file of 1,000,000 records, to positions and attitudes", peer="-", asked=1.0, unit="s")
def sbet() -> Measured:
    path, seconds = folder() / "many.sbet", []
    for _ in range(3):
        start = time.process_time()
        read_sbet(path)
        seconds.append(time.process_time() - start)
    return Measured(min(seconds), note=f"CPU time for {path.stat().st_size / 1e6:.0f} MB, positions and attitudes computed")
