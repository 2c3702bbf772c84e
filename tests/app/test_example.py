"""The bundled example is what its README says it is."""

from pathlib import Path

import numpy as np

import whiskjax as wj
from whiskjax.files.read import read_flight
from whiskjax.flights import haian

EXAMPLE = Path(__file__).parents[2] / "examples" / "haian"


def test_the_example_is_the_simulation_of_its_seed():
    bundled, made = read_flight(EXAMPLE), haian.simulate(2024)
    assert bundled.name == made.name
    for name in ("line_px", "sample_px", "sigma_line_px", "sigma_sample_px"):
        # 1e-6 px: what another processor's rounding could change.
        np.testing.assert_allclose(getattr(bundled.measurements, name), getattr(made.measurements, name), rtol=0, atol=1e-6)
    np.testing.assert_allclose(bundled.points.position_m, made.points.position_m, rtol=0, atol=1e-7)
    assert [x.name for x in bundled.unknowns] == [x.name for x in made.unknowns]


def test_the_example_is_sound_in_ten_steps():
    flight = read_flight(EXAMPLE)
    found = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    assert found.is_sound and found.steps <= 10 and found.fit.check.freedom == 2 * 101


def test_the_example_is_small():
    assert sum(path.stat().st_size for path in EXAMPLE.iterdir()) < 2e6
