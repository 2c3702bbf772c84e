"""One thread on one core, set before numpy and jax are imported: only then is a ratio of times a ratio of work."""

import os
import sys

ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "JAX_PLATFORMS": "cpu",
    "JAX_ENABLE_X64": "1",
}
CORES = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else {0}  # that this process may use, before it keeps to one
XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def keep_to_one_thread() -> None:
    """Binds this process and its children to one core, and the numerical libraries to one thread."""
    early = {"numpy", "jax"} & sys.modules.keys()
    if early:
        raise RuntimeError(f"{', '.join(sorted(early))} was imported before the number of threads was set")
    os.environ.update(ENVIRONMENT)
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {XLA_FLAGS}".strip()
    if hasattr(os, "sched_setaffinity"):
        # The last of the cores we may use: interrupts tend to be served by the first.
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
