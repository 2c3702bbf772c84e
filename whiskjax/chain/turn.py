"""Scan mirrors and gimbals: rotations about a named axis by a recorded encoder."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..algebra.angles import ELEMENTARY, Angle
from ..algebra.vectors import Component, add, is_structural, mul
from ..rules import RESULTS, WhiskjaxError
from .knots import Knots, take
from .link import AbstractLink, Moves, Recorded
from .pose import Pose
from .shot import Shot

# Beside its neighbours: a flyback that no sample fell into.
_MUCH_FASTER = 4.0


def as_parameter(value: Any) -> Any:
    """An array, except for the structural zero, which stays a Python int and costs nothing, and for a known `Angle`."""
    if isinstance(value, Angle):
        return value
    return 0 if is_structural(value, 0) else jnp.asarray(value, dtype=float)


class Encoder(eqx.Module):
    """A recorded angle, linear between its samples."""

    knots: Knots
    angle_rad: Float[Array, " n"]
    max_gap_s: float = eqx.field(static=True)

    def __init__(
        self, time_s: Float[ArrayLike, " n"], angle_rad: Float[ArrayLike, " n"], max_gap_s: float, name: str = "encoder"
    ):
        """**Arguments:**

        - `time_s`: strictly increasing, seconds.
        - `angle_rad`: radians; jumps of a whole turn between samples are unwrapped.
        - `max_gap_s`: longer intervals are not bridged.
        - `name`: for messages.

        **Raises:** `WhiskjaxError` for times that do not increase, angles that are not finite, lengths that differ.
        """
        angle = np.asarray(angle_rad, dtype=np.float64)
        self.knots = Knots(time_s, max_gap_s, name)
        if angle.shape != self.knots.time_s.shape:
            raise WhiskjaxError(f"{name}: {angle.shape} angles for {self.knots.time_s.shape} times")
        if not np.isfinite(angle).all():
            raise WhiskjaxError(f"{name}: the angle of sample {int(np.argmin(np.isfinite(angle)))} is not a finite number")
        self.angle_rad = jnp.asarray(np.unwrap(angle))
        self.max_gap_s = float(max_gap_s)

    def at(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        """The angle at each time, radians."""
        i, w, _ = self.knots.locate(t)
        before = take(self.angle_rad, i)
        return before + w * (take(self.angle_rad, i + 1) - before)

    def rates(self) -> Float[Array, " n-1"]:
        """How fast the angle changes from each sample to the next, radians per second."""
        return jnp.diff(self.angle_rad) / jnp.diff(self.knots.time_s)

    def check(self, t: Float[Array, "..."]) -> RESULTS:
        """Whether the encoder was recorded at each time."""
        return self.knots.check(t)


def _leaps(rate: Float[Array, " n-1"]) -> Bool[Array, " n-1"]:
    """Where a mirror goes back between two samples, as far as it came in many: against both neighbours, and much faster."""
    before, here, after = rate[:-2], rate[1:-1], rate[2:]
    against = (here * before < 0) & (here * after < 0)
    faster = jnp.abs(here) > _MUCH_FASTER * jnp.maximum(jnp.abs(before), jnp.abs(after))
    return jnp.zeros(rate.shape, dtype=bool).at[1:-1].set(against & faster)


class Readings(eqx.Module):
    """A recorded angle for each shot, in radians, aligned with the shots: nothing to interpolate, and no delay to calibrate."""

    angle_rad: Component = eqx.field(converter=as_parameter)

    def at(self, t: Component) -> Component:
        """The reading of each shot, whatever its time."""
        return self.angle_rad


class Turn(AbstractLink):
    """Rotation about x, y or z by sign * (encoder(time + delay_s) + zero_rad).

    Scan mirrors and gimbals are Turns in list order. `delay_s` (how much later than the shot's time stamp the encoder was read)
    and `zero_rad` (its index error) can be calibrated.
    """

    axis: str = eqx.field(static=True)
    encoder: Encoder | Readings
    sign: int = eqx.field(default=1, static=True)
    delay_s: Component = eqx.field(default=0, converter=as_parameter)
    zero_rad: Component = eqx.field(default=0, converter=as_parameter)

    def __check_init__(self):
        if self.axis not in ELEMENTARY:
            raise WhiskjaxError(f"a turn has the axis x, y or z, not {self.axis!r}")
        if self.sign not in (1, -1):
            raise WhiskjaxError(f"the sign of a turn is +1 or -1, not {self.sign!r}")

    def _angle(self, shot: Shot) -> Any:
        time: Any = None if isinstance(self.encoder, Readings) else add(shot.need("time_s", "which a turn needs"), self.delay_s)
        angle = self.encoder.at(time)
        return angle if isinstance(angle, Angle) else mul(self.sign, add(angle, self.zero_rad))

    def moves(self, shot: Shot) -> Moves:
        """Between the readings of the encoder."""
        if isinstance(self.encoder, Readings):
            return Moves()
        rate = self.encoder.rates()
        return Moves((Recorded(self.encoder.knots, self.delay_s, _leaps(rate)),), jnp.max(jnp.abs(rate)))

    def pose(self, shot: Shot) -> Pose:
        """The turn at the shot's time."""
        return Pose(ELEMENTARY[self.axis](self._angle(shot)))

    def ready(self, shot: Shot) -> "Turn":
        """The same turn with the sine and cosine of its angle, index error and sign included."""
        return Turn(self.axis, Readings(Angle.of(self._angle(shot))))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the encoder was recorded at the shot's time."""
        if isinstance(self.encoder, Readings):
            return RESULTS.successful
        return self.encoder.check(add(shot.need("time_s", "which a turn needs"), self.delay_s))
