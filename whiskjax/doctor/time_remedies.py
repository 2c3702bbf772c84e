"""Clocks that do not agree: whole seconds between images, POS and encoders."""

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..chain.knots import Knots
from ..chain.lines import LineTimes
from ..chain.trajectory import Trajectory
from ..chain.turn import Encoder, Turn
from ..flights.flight import Flight
from ..rules import WhiskjaxError
from .image_remedies import with_lines
from .poses import with_links
from .remedy import Remedy, constant

MOST_S = 20
_GPS = {18: " (GPS time is 18 s ahead of UTC since 2017)", 19: " (TAI is 19 s ahead of GPS time)"}


def time_remedies(flight: Flight) -> Iterator[Remedy]:
    """Shifts by whole seconds of images, of POS, and of encoders, where half of the measurements then lie in the record."""
    links = flight.sensor.links
    has_pos = any(isinstance(link, Trajectory) for link in links)
    turns = [name for name, link in zip(flight.sensor.names, links, strict=True) if _is_recorded_turn(link)]
    if not has_pos and not turns:
        return
    table, is_recorded = "lines.csv" if flight.is_line else "images.csv", _Record.of(flight)
    for s in (k for k in range(-MOST_S, MOST_S + 1) if k):
        why = _GPS.get(abs(s), "")
        if is_recorded(-s, -s):
            yield Remedy(
                f"images {s:+d} s",
                "clock of images",
                f"Times of the images are off by a whole number of seconds against POS{why}.",
                lambda f, _, s=s: _images_later(f, s),
                constant(f"{table}: add {s:+d} to time_s"),
                oddity=1 + (abs(s) != 18),
                pairs=abs(s) in (1, 18),
            )
        if has_pos and turns and is_recorded(s, 0):
            yield Remedy(
                f"POS {s:+d} s",
                "clock of POS",
                f"Times of POS are off by a whole number of seconds against images and encoders{why}.",
                lambda f, _, s=s: _links_later(f, s, Trajectory),
                constant(f"pos.csv: add {s:+d} to time_s (or the trajectory's delay_s = {-s})"),
                oddity=2 + (abs(s) != 18),
                pairs=abs(s) in (1, 18),
            )
        if has_pos and turns and is_recorded(0, s):
            yield Remedy(
                f"encoders {s:+d} s",
                "clock of encoders",
                f"Times of the encoders are off by a whole number of seconds against POS and images{why}.",
                lambda f, _, s=s: _links_later(f, s, Turn),
                constant(f"encoders.csv: add {s:+d} to time_s (or delay_s = {-s} of {', '.join(turns)})"),
                oddity=2 + (abs(s) != 18),
                pairs=abs(s) in (1, 18),
            )


class _Record(NamedTuple):
    """What was recorded when: sample times and gaps of POS and of encoders, and the times of the measurements, seconds."""

    pos: list[Knots]
    encoders: list[Knots]
    time_s: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, flight: Flight) -> "_Record":
        links, m = flight.sensor.links, flight.measurements
        try:
            time = np.asarray(flight.shot(m.image, m.line_px).time_s, dtype=float)
        except WhiskjaxError:  # lines outside their tables: then all is tried, and refused where it is
            time = np.zeros(0)
        pos = [link.knots for link in links if isinstance(link, Trajectory)]
        turns = [link.encoder for link in links if isinstance(link, Turn)]
        return cls(pos, [encoder.knots for encoder in turns if isinstance(encoder, Encoder)], time)

    def __call__(self, pos_s: float, encoders_s: float) -> bool:
        """Whether at least half of the measurements lie in the records, shifted by so much."""
        inside = np.ones(len(self.time_s), dtype=bool)
        for records, later in ((self.pos, pos_s), (self.encoders, encoders_s)):
            for knots in records:
                samples = np.asarray(knots.time_s) + later
                i = np.searchsorted(samples, self.time_s, side="right") - 1
                known = (i >= 0) & (i < len(samples) - 1)
                inside &= known & ~np.asarray(knots.is_gap)[np.clip(i, 0, len(samples) - 2)]
        return not len(inside) or 2 * int(inside.sum()) >= len(inside)


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
