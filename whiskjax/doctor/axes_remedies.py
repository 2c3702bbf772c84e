"""Axes that point elsewhere: the 24 signed permutations that are rotations."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from ..chain.mounts import CONVENTIONS, Axes
from ..chain.sensor import Sensor
from ..flights.flight import Flight
from .poses import with_links
from .remedy import Remedy, constant

CAMERA_AXES = "camera_axes"
SAME = "x y z"


def axes_remedies(flight: Flight) -> Iterator[Remedy]:
    """Every `axes` link with all other conventions; and the camera turned in its mount, where no such link stands before it."""
    links = list(zip(flight.sensor.names, flight.sensor.links, strict=True))
    for i, (name, link) in enumerate(links):
        if isinstance(link, Axes):
            written = " ".join(word.lstrip("+") for word in link.axes.split())
            for axes in CONVENTIONS:
                if axes != written:
                    yield _instead(i, name, link.axes, axes)
    if not isinstance(links[-1][1], Axes):
        for axes in CONVENTIONS:
            if axes != SAME:
                yield _before_camera(axes)


def _instead(i: int, name: str, written: str, axes: str) -> Remedy:
    def change(flight: Flight, _: float | None) -> Flight:
        new: Any = lambda frame, link: Axes(axes) if frame == name else link
        return dataclasses.replace(flight, sensor=with_links(flight.sensor, new))

    return Remedy(
        f"axes of {name}: {axes}",
        f"axes of {name}",
        f"The axes of the frame {name} are {axes} and not {written}.",
        change,
        constant(f'flight.toml: chain[{i}] (frame {name!r}): axes = "{axes}"'),
        oddity=2,
    )


def _before_camera(axes: str) -> Remedy:
    def change(flight: Flight, _: float | None) -> Flight:
        sensor = flight.sensor
        links = dict(zip(sensor.names, sensor.links, strict=True)) | {CAMERA_AXES: Axes(axes)}
        return dataclasses.replace(flight, sensor=Sensor(links, sensor.camera, sensor.refraction))

    return Remedy(
        f"camera turned: {axes}",
        "axes of the camera",
        f"The camera is mounted turned: its axes lie along {axes} of the frame before it.",
        change,
        constant(f'flight.toml: before [camera] a link [[chain]] frame = "{CAMERA_AXES}", link = "axes", axes = "{axes}"'),
        oddity=2,
    )
