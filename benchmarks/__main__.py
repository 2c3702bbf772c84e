"""Measures, prints asked and reached side by side, and with --gate fails where a figure is not reached."""

from .one_thread import keep_to_one_thread

keep_to_one_thread()

import argparse  # noqa: E402
import sys  # noqa: E402
from pathlib import Path  # noqa: E402

from . import (  # noqa: E402, F401  (each registers its benchmarks)
    batch,
    blunders,
    calibration,
    files,
    geodesy,
    imaging,
    location,
    second_start,
    three_line,
)
from .measure import measure_all  # noqa: E402
from .page import page  # noqa: E402
from .report import machine, read_baseline, table, verdict, write_baseline  # noqa: E402
from .suite import BENCHMARKS, Benchmark  # noqa: E402
from .trust.bench import main as trust  # noqa: E402


def chosen(names: list[str]) -> list[Benchmark]:
    """Every benchmark but those on request, or those whose name begins with one of `names`."""
    unknown = [name for name in names if not any(known.startswith(name) for known in BENCHMARKS)]
    if unknown:
        sys.exit(f"no benchmark is called {', '.join(unknown)}; there are {', '.join(BENCHMARKS)}")
    return [b for b in BENCHMARKS.values() if (b.name.startswith(tuple(names)) if names else not b.on_request)]


def main() -> int:
    if sys.argv[1:2] == ["trust"]:
        return trust(sys.argv[2:])
    more = "`python -m benchmarks trust` asks whether the verdict can be fooled: see its own --help."
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__, epilog=more)
    parser.add_argument("names", nargs="*", metavar="NAME", help="beginning of a benchmark's name (default: all)")
    parser.add_argument("--gate", action="store_true", help="exit with 1 where a figure is missed or has regressed")
    parser.add_argument("--update", action="store_true", help="write the ratios into baseline.json")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the figures as a Markdown page")
    options = parser.parse_args()

    baseline = read_baseline()
    rows, left_out = measure_all(chosen(options.names), baseline)
    print(", ".join(f"{key} {value}" for key, value in machine().items()))
    print("One thread on one core. reached: our CPU time / the peer's, fastest calls; median over rounds; wall clock.")
    print("\n".join([table(rows, baseline), *left_out]))
    if options.update:
        write_baseline(rows)
    if options.page:
        options.page.write_text(page(rows), encoding="utf-8")
    failed = [b.name for b, m in rows if verdict(b, m, baseline.get(b.name))]
    if failed:
        print(f"{len(failed)} of {len(rows)} failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if options.gate and failed else 0


if __name__ == "__main__":
    sys.exit(main())
