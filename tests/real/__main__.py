"""`python -m tests.real [--data DIR] [--out DIR]`: convert the real flights, calibrate them, print asked beside reached."""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from .sets import data_folder, missing


def main() -> int:
    """Run every set that is there; 0 only where all figures asked for are met and no set is missing."""
    parser = argparse.ArgumentParser(prog="python -m tests.real", description="Asked and reached on the real flights.")
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder of the sets [default: %(default)s]")
    parser.add_argument("--out", type=Path, help="keep the flight folders and figures.json here")
    given = parser.parse_args()
    if why := missing(given.data):
        print(why, file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as scratch:
        return _run(given.data, given.out or Path(scratch), keep=given.out is not None)


def _run(data: Path, out: Path, keep: bool) -> int:
    import jax

    jax.config.update("jax_enable_x64", True)
    from . import reach_blocks, reach_clarreo, reach_ign_frame, reach_location, reach_misb_uas, reach_rtk_drone
    from .figures import as_json, table

    figures, folders, notes, absent = [], [], [], 0
    for module in (reach_ign_frame, reach_misb_uas, reach_clarreo, reach_rtk_drone, reach_location, reach_blocks):
        source = data if module in (reach_location, reach_blocks) else data / module.SET
        if why := missing(source):
            print(f"{module.SET}: {why}", file=sys.stderr)
            absent += 1
            continue
        start = time.perf_counter()
        reached = module.reach(source, out)
        print(f"{module.SET}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
        figures += reached.figures
        folders += reached.folders
        notes += reached.notes
    print(table(figures))
    print()
    for note in notes:
        print(note)
    if keep:
        (out / "figures.json").write_text(as_json(figures), encoding="utf-8")
        print()
        print("The same from the command line:")
        for folder in folders:
            loss = " --loss cauchy" if folder.name == reach_rtk_drone.SET else ""
            if "unknown" in (folder / "flight.toml").read_text(encoding="utf-8"):
                print(f"  whiskjax calibrate {folder} --out {out / 'calibrated' / folder.name}{loss}")
    unmet = sum(not f.is_met for f in figures)
    print()
    print(f"{sum(f.asked is not None for f in figures)} figures asked, {unmet} not met, {absent} sets missing")
    return 1 if unmet or absent else 0


if __name__ == "__main__":
    sys.exit(main())
