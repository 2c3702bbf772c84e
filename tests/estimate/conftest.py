"""One simulated flight and one calibration, shared by the tests of this room."""

import pytest

import whiskjax as wj
from tests.estimate.textbooks import Textbook
from whiskjax.flights import haian


@pytest.fixture(scope="session")
def flight():
    return haian.simulate(11)


@pytest.fixture(scope="session")
def calibration(flight):
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)


@pytest.fixture(scope="session")
def textbook(flight):
    """Whitened residuals of the scanner in a plain loop over observations: Jin et al. (2024), equation 9, by numpy and scipy."""
    return Textbook(flight)
