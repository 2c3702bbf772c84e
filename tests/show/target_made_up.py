"""Located targets for figures and tables: twelve looks, with and without an answer, a gross error, several points, unknowns."""

import dataclasses
import functools

import numpy as np

import whiskjax as wj
from whiskjax.flights import tianshan
from whiskjax.flights.flight import Flight, Points
from whiskjax.show.target.sighting import Sighting

LOOKS = 12


@functools.cache
def flight() -> Flight:
    """Twelve looks along a leg of 20 km."""
    return tianshan.simulate(3, tianshan.Scene(path="race", looks=LOOKS))


def sighting(flight: Flight, method="iterated", gate=None, estimate=(), **more) -> Sighting:
    """What `whiskjax locate` would hand on; `more` replaces fields."""
    points = range(len(flight.points.names))
    looks, measurement = flight.looks(points)
    guess = wj.first_guess(flight.sensor, looks, wj.HeightSurface(1000.0), np.array([2300.0, 2300, 1500]))
    surface = wj.HeightSurface(1000.0)
    location = wj.locate(
        flight.sensor, looks, guess=guess, surface=surface, errors=flight.errors, method=method, gate=gate, estimate=estimate,
        throw=False,
    )  # fmt: skip
    made = Sighting(flight, "target", points, looks, measurement, location, guess, 1000.0, method, gate, estimate, len(estimate))
    return dataclasses.replace(made, **more)


def spoilt() -> Flight:
    """Look 7 is 4000 px wrong."""
    m = flight().measurements
    sample = m.sample_px.copy()
    sample[7] += 4000
    return dataclasses.replace(flight(), measurements=dataclasses.replace(m, sample_px=sample))


def one_look() -> Flight:
    """Only the first."""
    m = flight().measurements
    return dataclasses.replace(flight(), measurements=type(m)(**{name: values[:1] for name, values in vars(m).items()}))


def unknown_position() -> Flight:
    """The target is a tie point without coordinates."""
    p = flight().points
    tie = Points(p.names, np.full((1, 3), np.nan), p.sigma_enu_m, ["tie"])
    return dataclasses.replace(flight(), points=tie)


UNKNOWNS = (wj.Unknown("gimbal zero", "gimbal_roll.zero_rad", 0.0, 1e-3),)
CASES = {
    "sound": lambda: sighting(flight()),
    "gated": lambda: sighting(spoilt(), gate=1e-3),
    "not gated": lambda: sighting(spoilt()),
    "one look": lambda: sighting(one_look()),
    "batch": lambda: sighting(flight(), method="batch"),
    "position unknown": lambda: sighting(unknown_position()),
    "no noise": lambda: sighting(dataclasses.replace(flight(), errors=())),
    "an unknown": lambda: sighting(flight(), estimate=UNKNOWNS),
}
made = functools.cache(lambda case: CASES[case]())
