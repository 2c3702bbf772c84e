"""A large CSV file read in a process of its own: seconds, and the memory that it took beyond the imports.

Run by files.py with "table" and a CSV file, or "flight" and a folder; prints JSON.
"""

import json
import sys
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pyarrow.csv  # noqa: F401  (imported where a table is large; not a part of what reading takes)

import whiskjax as wj
from whiskjax.files import schema  # noqa: F401

from .files import parse
from .own_process import peak_gb

if __name__ == "__main__":
    what, path = sys.argv[1], Path(sys.argv[2])
    jnp.asarray(np.zeros(3)).block_until_ready()  # starts what JAX starts once
    imports_gb, start = peak_gb(), time.perf_counter()
    kept = parse(path) if what == "table" else wj.read_flight(path)
    seconds = time.perf_counter() - start
    file = path if what == "table" else path / "pos.csv"
    more_gb = peak_gb() - imports_gb
    print(json.dumps({"seconds": seconds, "peak_gb": more_gb, "ratio": more_gb * 1e9 / file.stat().st_size}))
