"""`python -m tests.peers [--data DIR] [--out DIR]`: every claim against a peer, its figure, its band and who sets it."""

import argparse
import importlib
import sys
import time
from pathlib import Path

from tests.real.sets import missing

from .figures import as_json, table
from .source import peer_values

# Whether the values are in the folder of peers' values, or worked out here by the peer itself.
STORED = ("erfa", "rugged", "bal", "usgscsm", "lro_nac", "pyorbital", "pdal")
RUN_HERE = ("opencv", "gtsam", "stonesoup")


def main() -> int:
    """Work out every claim; 0 only where all figures lie in their bands and no peer is missing."""
    parser = argparse.ArgumentParser(prog="python -m tests.peers", description="whiskjax beside independent programs.")
    parser.add_argument("--data", type=Path, default=peer_values(), help="folder of the peers' values [default: %(default)s]")
    parser.add_argument("--out", type=Path, help="keep figures.json here")
    given = parser.parse_args()
    folder = given.data

    import jax
    import pytest

    jax.config.update("jax_enable_x64", True)
    figures, absent = [], 0
    for name in (*STORED, *RUN_HERE):
        if name in STORED and (why := missing(folder)):
            print(f"{name}: {why}", file=sys.stderr)
            absent += 1
            continue
        start = time.perf_counter()
        try:
            peer = importlib.import_module(f"tests.peers.test_{name}")
        except pytest.skip.Exception as why:
            print(f"{name}: {why}", file=sys.stderr)
            absent += 1
            continue
        figures += [(peer.PEER, figure) for figure in (peer.figures(folder) if name in STORED else peer.figures())]
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    if figures:
        print(table(figures))
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "figures.json").write_text(as_json(figures), encoding="utf-8")
    outside = sum(not figure.is_inside for _, figure in figures)
    print()
    print(f"{len(figures)} figures, {outside} outside their bands, {absent} peers missing")
    return 1 if outside or absent else 0


if __name__ == "__main__":
    sys.exit(main())
