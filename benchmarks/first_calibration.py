"""What a user waits for after `import whiskjax`: read a flight folder and calibrate it, once, in a process of its own.

Run by second_start.py with the folder as argument; prints the seconds of reading and of calibrating as JSON.
"""

import json
import sys
import time
from pathlib import Path

import whiskjax as wj
from whiskjax.app.start import start_jax


def main(folder: Path) -> None:
    start_jax()
    imported = time.perf_counter()
    flight = wj.read_flight(folder)
    read = time.perf_counter()
    wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    calibrated = time.perf_counter()
    print(json.dumps({"read_s": read - imported, "calibrate_s": calibrated - read}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
