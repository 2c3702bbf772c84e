"""Reading recordings: seconds, memory, and the ratio to Python's own csv module."""

import tempfile
from functools import cache

from .own_process import in_own_process
from .suite import benchmark
from .timing import Measured

_TRIES = 3


@cache
def _read() -> dict[str, dict[str, float]]:
    with tempfile.TemporaryDirectory() as folder:
        in_own_process("many_records", "write", folder)
        tries = {"csv": _TRIES, "sbet": _TRIES, "textbook": 1}
        return {
            task: min((in_own_process("many_records", task, folder) for _ in range(n)), key=lambda found: found["seconds"])
            for task, n in tries.items()
        }


def _told(found: dict[str, float]) -> str:
    return f"{found['rows']:.0f} rows, {1e3 * found['file_gb']:.0f} MB, wall clock, best of {_TRIES}"


@benchmark("csv", what="a CSV table of 720,000 POS records, every cell checked", peer="-", asked=2.0, unit="s")
def csv_seconds() -> Measured:
    return Measured(_read()["csv"]["seconds"], note=_told(_read()["csv"]))


@benchmark("csv.memory", what="the same: peak memory above the import's, over the file", peer="-", asked=4.0)
def csv_memory() -> Measured:
    return Measured(_read()["csv"]["times_the_file"], note=_told(_read()["csv"]))


@benchmark("csv.textbook", what="the same against Python's csv and float, which check nothing", peer="csv, float", asked=None)
def csv_against_python() -> Measured:
    ours, peer = (_read()[task]["seconds"] for task in ("csv", "textbook"))
    return Measured(ours / peer, ours_s=ours, peer_s=peer, items=int(_read()["csv"]["rows"]))


@benchmark("sbet", what="an SBET file of 1,000,000 records, to positions and attitudes", peer="-", asked=1.0, unit="s")
def sbet_seconds() -> Measured:
    found = _read()["sbet"]
    return Measured(found["seconds"], note=f"{_told(found)}; peak memory {found['times_the_file']:.1f} times the file")
