"""A POS recording of an hour at 200 Hz, written and read in a process of its own: seconds, and memory above the import's."""

import json
import sys
import time
from pathlib import Path

import numpy as np

from .own_process import peak_gb

RECORDS = 720_000
SBET_RECORDS = 1_000_000


def write(folder: Path) -> None:
    """pos.csv as receivers' software prints it, and pos.sbet."""
    n = np.arange(max(RECORDS, SBET_RECORDS))
    time_s = 345_600 + 0.005 * n
    lat, lon = 32.5 + 7e-7 * n, 120.5 + 4e-7 * n
    roll, pitch, heading = 1.5 * np.sin(0.003 * n), 0.8 + 0.4 * np.sin(0.002 * n), 30 + 0.3 * np.sin(0.001 * n)
    columns = time_s, lat, lon, 3000 + np.sin(0.0005 * n), roll, pitch, heading
    with (folder / "pos.csv").open("w") as file:
        file.write("time_s,lat_deg,lon_deg,height_m,roll_deg,pitch_deg,heading_deg\n")
        text = "%.3f,%.9f,%.9f,%.4f,%.6f,%.6f,%.6f"
        np.savetxt(file, np.column_stack(columns)[:RECORDS], fmt=text)
    sbet = np.zeros((SBET_RECORDS, 17))
    sbet[:, 0], sbet[:, 1], sbet[:, 2], sbet[:, 3] = time_s, np.radians(lat), np.radians(lon), columns[3]
    sbet[:, 7], sbet[:, 8], sbet[:, 9] = np.radians(roll), np.radians(pitch), np.radians(heading)
    sbet.astype("<f8").tofile(folder / "pos.sbet")


def read_csv(folder: Path) -> dict[str, float]:
    """The table alone: every cell a checked number."""
    import pyarrow.csv  # noqa: F401

    from whiskjax.files.navigation import navigation_columns
    from whiskjax.files.sheet import open_sheet
    from whiskjax.files.tables import Column

    before, start = peak_gb(), time.perf_counter()
    sheet = open_sheet(folder, "pos.csv", "a benchmark")
    table = sheet.parse([Column("time_s"), *navigation_columns(sheet, "wgs84", "roll_pitch_heading")])
    seconds = time.perf_counter() - start
    size_gb = (folder / "pos.csv").stat().st_size / 1e9
    return {"seconds": seconds, "times_the_file": (peak_gb() - before) / size_gb, "rows": len(table), "file_gb": size_gb}


def read_sbet(folder: Path) -> dict[str, float]:
    """Positions and attitudes of every record."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from whiskjax.files.sbet import read_sbet as read

    before, start = peak_gb(), time.perf_counter()
    records = read(folder / "pos.sbet")
    size_gb = (folder / "pos.sbet").stat().st_size / 1e9
    seconds = time.perf_counter() - start
    return {"seconds": seconds, "times_the_file": (peak_gb() - before) / size_gb, "rows": len(records.time_s), "file_gb": size_gb}


def by_textbook(folder: Path) -> dict[str, float]:
    """The same table by Python's csv and float."""
    import csv

    start = time.perf_counter()
    with (folder / "pos.csv").open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    columns = [np.array([float(cell) for cell in column]) for column in zip(*rows, strict=True)]
    return {"seconds": time.perf_counter() - start, "rows": len(columns[0])}


if __name__ == "__main__":
    task, where = sys.argv[1:]
    if task == "write":
        write(Path(where))
        print("{}")
    else:
        print(json.dumps({"csv": read_csv, "sbet": read_sbet, "textbook": by_textbook}[task](Path(where))))
