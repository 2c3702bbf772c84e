"""Every mistake on every flight: `python -m tests.doctor [SCENE ...]` prints which remedies come first."""

import sys
import time

import jax

jax.config.update("jax_enable_x64", True)

from tests.doctor.scenes import REAL, SIMULATED  # noqa: E402
from tests.doctor.spoils import SPOILS  # noqa: E402
from tests.doctor.table import Row, diagnosed, share  # noqa: E402


def main(names: list[str]) -> None:
    """Print the table."""
    scenes = SIMULATED | REAL
    rows: list[Row] = []
    for name in names or scenes:
        sound = scenes[name]()
        for spoil in SPOILS:
            start = time.perf_counter()
            row = diagnosed(name, sound, spoil)
            if row is not None:
                rows.append(row)
                print(f"{row.text} {time.perf_counter() - start:5.0f} s", flush=True)
    right, told = share(rows)
    print(f"the right remedy is first in {right} of {told}; {len(rows) - told} mistakes change nothing that the data would show")


if __name__ == "__main__":
    main(sys.argv[1:])
