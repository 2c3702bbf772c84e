"""A measurement in a process of its own, with the threads that it wants: for memory and for several cores."""

import json
import os
import subprocess
import sys
from pathlib import Path

from . import one_thread


def in_own_process(module: str, *arguments: str) -> dict[str, float]:
    """What a module of this folder prints as its last line (JSON), run in a new process.

    **Raises:** `RuntimeError` with what the process said where it fails.
    """
    inherited = {k: v for k, v in os.environ.items() if k not in ("XLA_FLAGS", *one_thread.ENVIRONMENT)}
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{module}", *arguments],
        cwd=Path(__file__).parent.parent,
        env=inherited | {"JAX_PLATFORMS": "cpu", "JAX_ENABLE_X64": "1"},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise RuntimeError(f"the process of {module} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def peak_gb() -> float:
    """Peak of this process; Linux counts in KiB. What getrusage reports would begin with that of the process that started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9
