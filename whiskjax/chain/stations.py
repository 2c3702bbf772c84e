"""Links with unknown motions of their own: corrections in time at nodes, poses for each image.

Both hold small motions, six numbers a station, and make a shot's pose from a weighted sum of a few stations' motions. A block
adjustment needs no more of them than that.
"""

import abc

import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import ZERO, Component, Vec3
from .link import AbstractLink
from .pose import Pose
from .shot import Shot

# The fields that hold the motions of the stations.
MOTIONS = ("turn_rad", "shift_m")


class AbstractStations(AbstractLink):
    """A link whose pose follows from small motions (turn, shift) at stations: nodes in time, or images.

    They live in its fields `turn_rad` and `shift_m`, (stations, 3) each; None is exactly zero.
    """

    @property
    @abc.abstractmethod
    def stations(self) -> int:
        """Number of stations."""

    @property
    def segments(self) -> tuple[int, ...]:
        """Numbers of stations that follow each other in time without a break, strip by strip; all where they lie in no time."""
        return (self.stations,)

    @property
    def node_s(self) -> Float[np.ndarray, " stations"] | None:
        """The time of every station, on the host; None where stations are not nodes in time."""
        return None

    @property
    def epoch_s(self) -> Float[np.ndarray, " stations"] | None:
        """As many times, on the host: motions there determine those of the stations. None where they are not nodes in time."""
        return None

    @property
    @abc.abstractmethod
    def motions(self) -> tuple[Float[Array, "stations 3"] | None, Float[Array, "stations 3"] | None]:
        """The motions of the stations: `turn_rad` and `shift_m`."""

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """No motion of any station."""
        return np.zeros((self.stations, 3)) if field in ("turn_rad", "shift_m") else None

    @abc.abstractmethod
    def acting(self, shot: Shot) -> list[tuple[Component, Component]]:
        """Pairs (station index, weight) that act on each shot; consecutive stations, the first one first."""

    @abc.abstractmethod
    def moved(self, shot: Shot, turn: Vec3, shift: Vec3) -> Pose:
        """The pose of each shot for a given motion; `vectors.ZERO` is exactly none."""


def motion(link: AbstractStations, shot: Shot) -> tuple[Vec3, Vec3]:
    """The motion (turn, shift) of each shot: the weighted sum over the stations that act."""
    acting = link.acting(shot)

    def total(of: Float[Array, "stations 3"] | None) -> Vec3:
        return ZERO if of is None else tuple(sum(w * of[:, axis][i] for i, w in acting) for axis in range(3))

    turn, shift = link.motions
    return total(turn), total(shift)
