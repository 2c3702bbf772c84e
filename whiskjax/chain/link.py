"""What every link is: a function from a shot to the pose outer_from_inner."""

import abc
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Mat3
from ..rules import RESULTS
from .knots import Knots
from .part import AbstractPart
from .pose import Pose
from .shot import Shot


class Recorded(NamedTuple):
    """Sample times between which a link moves evenly, and how much later than the shot's time they were read, seconds.

    `leaps`: the intervals in which it went where no sample says how: a flyback from one sample to the next. None: nowhere.
    """

    knots: Knots
    delay_s: Component
    leaps: Bool[Array, " n-1"] | None = None


class Moves(NamedTuple):
    """What a search along time has to know of a link, or of a chain: it turns and moves no faster than this between samples."""

    recorded: tuple[Recorded, ...] = ()
    turn_radps: Component = 0
    speed_mps: Component = 0


class AbstractLink(AbstractPart):
    """One link of the chain, from the Earth inwards to the camera."""

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """() for a link that serves all shots; else it broadcasts with the shots."""
        return ()

    @abc.abstractmethod
    def pose(self, shot: Shot) -> Pose:
        """Pose outer_from_inner of each shot."""

    @abc.abstractmethod
    def check(self, shot: Shot) -> RESULTS:
        """Whether the link knows the pose of each shot."""

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The series in time that the link reads."""
        return ()

    @property
    def is_timed(self) -> bool:
        """Whether the link asks for a shot's time."""
        return bool(self.recorded)

    def moves(self, shot: Shot) -> "Moves":
        """How the link moves in time; a link that does not, or nearly so, does not move at all."""
        return Moves()

    @property
    def kinks(self) -> tuple[str, ...]:
        """Fields by which the pose has no continuous derivative: delays of records that are interpolated linearly."""
        return ()

    def ready(self, shot: Shot) -> "Pose | AbstractLink":
        """What the pose is made of, for one pass over the shots: interpolation, sines and cosines are done, products are not.

        A link aligned with the shots; where that saves nothing, the pose itself.
        """
        return self.pose(shot)

    def chosen(self, shot: Shot) -> "AbstractLink":
        """The link that acts on these shots, where that is known before tracing; a link that makes no choice is itself."""
        return self


class Given(AbstractLink):
    """A pose that the shot already carries, or what it is made of: what `bake` leaves behind."""

    index: int = eqx.field(static=True)

    def pose(self, shot: Shot) -> Pose:
        """The pose in the shot."""
        carried = shot.poses[self.index]
        return carried if isinstance(carried, Pose) else carried.pose(shot)

    def check(self, shot: Shot) -> RESULTS:
        """Checked when it was baked."""
        return RESULTS.successful


class Fixed(AbstractLink):
    """A constant rotation that nobody estimates."""

    rotation: Mat3

    def pose(self, shot: Shot) -> Pose:
        """The same for every shot."""
        return Pose(self.rotation)

    def check(self, shot: Shot) -> RESULTS:
        """Always known."""
        return RESULTS.successful
