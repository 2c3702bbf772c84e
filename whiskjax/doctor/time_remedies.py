"""Clocks that do not agree: whole seconds between images, POS and encoders."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import numpy as np

from ..chain.lines import LineTimes
from ..chain.trajectory import Trajectory
from ..chain.turn import Encoder, Turn
from ..flights.flight import Flight
from .image_remedies import with_lines
from .poses import with_links
from .remedy import Remedy, constant

MOST_S = 20
_GPS = {18: " (GPS time is 18 s ahead of UTC since 2017)", 19: " (TAI is 19 s ahead of GPS time)"}


def time_remedies(flight: Flight) -> Iterator[Remedy]:
    """Shifts by whole seconds of images, of POS, and of encoders against the rest."""
    links = flight.sensor.links
    has_pos = any(isinstance(link, Trajectory) for link in links)
    turns = [name for name, link in zip(flight.sensor.names, links, strict=True) if _is_recorded_turn(link)]
    if not has_pos and not turns:
        return
    table = "lines.csv" if flight.is_line else "images.csv"
    for s in (k for k in range(-MOST_S, MOST_S + 1) if k):
        why = _GPS.get(abs(s), "")
        yield Remedy(
            f"images {s:+d} s",
            "clock of images",
            f"Times of the images are off by a whole number of seconds against POS{why}.",
            lambda f, _, s=s: _images_later(f, s),
            constant(f"{table}: add {s:+d} to time_s"),
            oddity=1 + (abs(s) != 18),
            pairs=abs(s) in (1, 18),
        )
        if has_pos and turns:
            yield Remedy(
                f"POS {s:+d} s",
                "clock of POS",
                f"Times of POS are off by a whole number of seconds against images and encoders{why}.",
                lambda f, _, s=s: _links_later(f, s, Trajectory),
                constant(f"pos.csv: add {s:+d} to time_s (or the trajectory's delay_s = {-s})"),
                oddity=2 + (abs(s) != 18),
                pairs=abs(s) in (1, 18),
            )
            yield Remedy(
                f"encoders {s:+d} s",
                "clock of encoders",
                f"Times of the encoders are off by a whole number of seconds against POS and images{why}.",
                lambda f, _, s=s: _links_later(f, s, Turn),
                constant(f"encoders.csv: add {s:+d} to time_s (or delay_s = {-s} of {', '.join(turns)})"),
                oddity=2 + (abs(s) != 18),
                pairs=abs(s) in (1, 18),
            )


def _is_recorded_turn(link: Any) -> bool:
    return isinstance(link, Turn) and isinstance(link.encoder, Encoder)


def _images_later(flight: Flight, by_s: float) -> Flight:
    if flight.is_line:
        return with_lines(flight, lambda lines: LineTimes(np.asarray(lines.line), np.asarray(lines.time_s) + by_s))
    images = [i if i.time_s is None else dataclasses.replace(i, time_s=i.time_s + by_s) for i in flight.images]
    return dataclasses.replace(flight, images=images)


def _links_later(flight: Flight, by_s: float, kind: type) -> Flight:
    def change(_: str, link: Any) -> Any:
        if not isinstance(link, kind) or (kind is Turn and not _is_recorded_turn(link)):
            return link
        where = (lambda x: x.encoder.knots.time_s) if kind is Turn else (lambda x: x.knots.time_s)
        return eqx.tree_at(where, link, where(link) + by_s)  # knots find intervals by the time since the first sample

    return dataclasses.replace(flight, sensor=with_links(flight.sensor, change))
