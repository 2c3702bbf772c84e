"""Encoders of mirrors and gimbals: the sign, and the angle of the mirror where that of the beam is needed."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx

from ..chain.turn import Encoder, Turn
from ..flights.flight import Flight
from .poses import with_links
from .remedy import Remedy, constant


def encoder_remedies(flight: Flight) -> Iterator[Remedy]:
    """Every encoder: the other sign, half and twice the angle."""
    for i, (name, link) in enumerate(zip(flight.sensor.names, flight.sensor.links, strict=True)):
        if not (isinstance(link, Turn) and isinstance(link.encoder, Encoder)):
            continue
        place = f"flight.toml: chain[{i}] (frame {name!r})"
        yield Remedy(
            f"sign of encoder {name}",
            f"encoder of {name}",
            f"The encoder of {name} turns the other way.",
            lambda f, _, name=name: _other_way(f, name),
            constant(f"{place}: sign = {-link.sign}"),
        )
        for factor, word, why in (
            (2.0, "twice", "It records the angle of a mirror, which turns the beam by twice as much."),
            (0.5, "half", "It records the angle of the beam, which a mirror turns by twice its own."),
        ):
            yield Remedy(
                f"{word} the angle of encoder {name}",
                f"encoder of {name}",
                why,
                lambda f, _, name=name, factor=factor: _scaled(f, name, factor),
                constant(f"encoders.csv: multiply the column that chain[{i}] (frame {name!r}) reads by {factor:g}"),
            )


def _other_way(flight: Flight, name: str) -> Flight:
    def change(frame: str, link: Any) -> Any:
        return dataclasses.replace(link, sign=-link.sign) if frame == name else link

    return dataclasses.replace(flight, sensor=with_links(flight.sensor, change))


def _scaled(flight: Flight, name: str, factor: float) -> Flight:
    def change(frame: str, link: Any) -> Any:
        if frame != name:
            return link
        link = eqx.tree_at(lambda x: x.encoder.angle_rad, link, link.encoder.angle_rad * factor)
        rate = link.encoder.rate_rps
        return link if rate is None else eqx.tree_at(lambda x: x.encoder.rate_rps, link, rate * factor)

    return dataclasses.replace(flight, sensor=with_links(flight.sensor, change))
