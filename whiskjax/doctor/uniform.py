"""Flights of one form: what conventions are static in, is turned into arrays, so that all that is tried compiles once.

The axes of an `Axes` link and the sign of a `Turn` are part of what is compiled for. Here the first is a rotation of numbers, and
the second the same turn between two half turns about another axis, R_x(-a) = H R_x(a) H, of numbers too.
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..chain.link import AbstractLink, Fixed
from ..chain.mounts import Axes, Mount
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.turn import Turn
from ..estimate.errors import FrameErrors
from ..estimate.unknown import Unknown
from ..flights.flight import Flight
from .axes_remedies import CAMERA_AXES

# A half turn about another axis of those that a turn has.
_HALF = {"x": np.diag([-1.0, 1.0, -1.0]), "y": np.diag([1.0, -1.0, -1.0]), "z": np.diag([-1.0, 1.0, -1.0])}
_HELD_M = 1e-9


def uniform(flight: Flight) -> Flight:
    """The same flight, its axes and signs as arrays, with an axes link before the camera, whatever it had.

    A flight without unknowns gets one that nothing can move, since there is nothing to solve for without any.
    """
    sensor = flight.sensor
    links: dict[str, AbstractLink] = {}
    for name, link in zip(sensor.names, sensor.links, strict=True):
        if isinstance(link, Axes):
            links[name] = _fixed(np.asarray(link.pose(_NO_SHOT).matrix))
        elif isinstance(link, Turn):
            half = _fixed(np.eye(3) if link.sign > 0 else _HALF[link.axis])
            forwards = dataclasses.replace(link, sign=1)
            links |= {_beside(name, "before"): half, name: forwards, _beside(name, "after"): half}
        else:
            links[name] = link
    if not isinstance(sensor.links[-1], Axes):
        links[CAMERA_AXES] = _fixed(np.eye(3))
    unknowns = tuple(flight.unknowns)
    if not unknowns:
        links[_beside("camera", "held")] = Mount(lever_arm_m=np.zeros(3))
        unknowns = (Unknown("held", f"{_beside('camera', 'held')}.lever_arm_m[0]", 0.0, _HELD_M),)
    return dataclasses.replace(flight, sensor=Sensor(links, sensor.camera, sensor.refraction), unknowns=unknowns)


_NO_SHOT: Any = Shot()


def _beside(name: str, where: str) -> str:
    return f"{name}_{where}_of_doctor"


def _fixed(rotation: np.ndarray) -> Fixed:
    return Fixed(tuple(tuple(jnp.asarray(entry) for entry in row) for row in rotation))


def whitened_errors(flight: Flight) -> list[FrameErrors]:
    """What is stated of the records' errors, taken as new at every exposure: they widen every residual by what they can do to it.

    Statements of poses that were not recorded are left out.
    """
    stated = [one for one in flight.errors if not any(one.free)]
    return [FrameErrors(one.frame, one.turn_sigma_rad, one.shift_sigma_m, 0.0, "flight", one.axes) for one in stated]
