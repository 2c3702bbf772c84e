"""Flights: what a flight is, and the three papers' flights as seeded simulations."""

from . import haian as haian
from . import songshan as songshan
from . import tianshan as tianshan
