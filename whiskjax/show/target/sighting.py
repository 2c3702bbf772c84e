"""One target as it was seen and found: what every table and figure is made from."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ...estimate.unknown import Unknown
from ...flights.flight import Flight
from ...locate.guess import Guess
from ...locate.location import Location
from ...locate.looks import Looks
from ...rules.results import is_successful
from ..scales import Scales, axes_of, scales_of

STATES = ("used", "gated", "missed", "left out")


@dataclasses.dataclass(frozen=True)
class Sighting:
    """A located target of a flight.

    **Arguments:**

    - `target`: what people called it.
    - `points`: indices of the flight's points whose measurements are the looks; more than one stand for one target.
    - `looks`, `measurement`: of `flight.looks(points)`.
    - `location`: made from them.
    - `unknowns`: those estimated with the target, then those considered, as in `location.estimate.names`.
    - `guess`: where the filter started, on the surface of the height `surface_height_m`.
    - `gate`: the share of good looks that may be lost, or None.
    - `remarks`: what was chosen or changed without being asked.
    """

    flight: Flight
    target: str
    points: Sequence[int]
    looks: Looks
    measurement: Int[np.ndarray, " looks"]
    location: Location
    guess: Guess
    surface_height_m: float
    method: str
    gate: float | None = None
    unknowns: Sequence[Unknown] = ()
    estimated: int = 0
    remarks: Sequence[str] = ()

    @property
    def label(self) -> str:
        """What a title calls the target: its name, or the first and the last of several points."""
        names = [self.flight.points.names[i] for i in self.points]
        return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]} ({len(names)} points)"

    def __len__(self) -> int:
        return len(self.measurement)

    @property
    def is_answered(self) -> bool:
        """Whether there is a position at all."""
        return bool(is_successful(self.location.result))

    @property
    def is_filter(self) -> bool:
        """Whether there is an estimate after every look; a batch has one."""
        return self.method != "batch"

    @property
    def images(self) -> list[str]:
        """The image of each look."""
        return [self.flight.images[int(i)].name for i in self.flight.measurements.image[self.measurement]]

    @property
    def time_s(self) -> Float[np.ndarray, " looks"] | None:
        """When each look was made, where that was recorded."""
        time = self.looks.shot.time_s
        return None if time is None else np.asarray(time)

    @property
    def axes(self) -> tuple[str, str]:
        """What the two axes of an innovation are called."""
        return axes_of(self.flight.is_line)

    @cached_property
    def scales(self) -> Scales:
        """How large pixels are where the looks see the place at which the estimate ended."""
        point = np.broadcast_to(np.asarray(self.location.line_m), (len(self), 3))
        return scales_of(self.flight, self.flight.sensor, self.looks.shot, point, self.measurement)

    @cached_property
    def state(self) -> np.ndarray:
        """What became of each look: one of STATES."""
        looks = self.location.looks
        chosen = (np.asarray(looks.is_used), np.asarray(looks.counts & ~looks.passes), np.asarray(looks.is_missed))
        return np.select(chosen, STATES[:3], STATES[3])

    @cached_property
    def platform_m(self) -> Float[np.ndarray, "looks 3"]:
        """Where the camera was at each look, in the world, as recorded."""
        translation = self.flight.sensor.pose(self.looks.shot).translation
        return np.stack([np.broadcast_to(np.asarray(c, dtype=float), len(self)) for c in translation], axis=-1)

    @cached_property
    def truth_m(self) -> Float[np.ndarray, "3"] | None:
        """The given position of the target, of several points the mean of those that have one."""
        known = self._given
        return known.mean(axis=0) if len(known) else None

    @property
    def _given(self) -> Float[np.ndarray, "n 3"]:
        position = np.asarray(self.flight.points.position_m)[list(self.points)]
        return position[np.isfinite(position).all(axis=1)]

    @property
    def truth_spread_m(self) -> float:
        """How far the given positions of several points lie from their mean, RMS; 0 for one."""
        return float(np.sqrt(((self._given - self._given.mean(axis=0)) ** 2).sum(axis=1).mean()))

    @property
    def truth_covariance_enu_m2(self) -> Float[np.ndarray, "3 3"]:
        """Of the given position, east, north, up: as it was stated, and of several points how they lie about their mean."""
        stated = (np.asarray(self.flight.points.sigma_enu_m)[list(self.points)] ** 2).mean(axis=0)
        apart = self.enu(self._given) - self.enu(self._given).mean(axis=0)
        return np.diag(stated) + apart.T @ apart / len(apart)

    def enu(self, point_m: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """East, north and up of points from where the estimate ended."""
        return (np.asarray(point_m) - np.asarray(self.location.line_m)) @ np.asarray(self.location.world_from_enu)
