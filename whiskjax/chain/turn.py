"""Scan mirrors and gimbals: rotations about a named axis by a recorded encoder."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..algebra.angles import ELEMENTARY, Angle
from ..algebra.vectors import Component, add, is_structural, mul
from ..rules import RESULTS, Arrays, WhiskjaxError, need
from .knots import Knots, take
from .link import AbstractLink
from .pose import Pose
from .shot import Shot


def as_parameter(value: Any) -> Any:
    """An array, except for the structural zero, which stays a Python int and costs nothing, and for a known `Angle`."""
    if isinstance(value, Angle):
        return value
    return 0 if is_structural(value, 0) else jnp.asarray(value, dtype=float)


def take_component(
    arrays: Arrays, name: str, value: Any, absolute: bool = False, within_rad: float | None = None, meaning: str = ""
) -> Any:
    """A number for each shot, or one for all, as `Arrays.take` does; the structural zero and a known `Angle` are left alone."""
    if is_structural(value, 0) or isinstance(value, Angle):
        return value
    return arrays.take(name, value, "...", absolute=absolute, finite=True, within_rad=within_rad, meaning=meaning)


class Encoder(eqx.Module):
    """A recorded angle, linear between its samples."""

    knots: Knots
    angle_rad: Float[Array, " n"]
    max_gap_s: float = eqx.field(static=True)

    def __init__(
        self, time_s: Float[ArrayLike, " n"], angle_rad: Float[ArrayLike, " n"], max_gap_s: float, name: str = "Encoder"
    ):
        """**Arguments:**

        - `time_s`: strictly increasing, seconds.
        - `angle_rad`: radians; jumps of a whole turn between samples are unwrapped.
        - `max_gap_s`: longer intervals are not bridged.
        - `name`: for messages.

        **Raises:** `WhiskjaxError` for times that do not increase, angles that are not finite, lengths that differ.
        """
        self.knots = Knots(time_s, max_gap_s, name)
        angle = np.asarray(Arrays(name).take("angle_rad", angle_rad, "n", absolute=True, finite=True))
        if angle.shape != self.knots.time_s.shape:
            raise WhiskjaxError(f"{name}: angle_rad has shape {angle.shape}, but there are {self.knots.time_s.shape[0]} times")
        self.angle_rad = jnp.asarray(np.unwrap(angle))
        self.max_gap_s = float(max_gap_s)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """(): all shots read it."""
        return ()

    def at(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        """The angle at each time, radians."""
        i, w, _ = self.knots.locate(t)
        before = take(self.angle_rad, i)
        return before + w * (take(self.angle_rad, i + 1) - before)

    def check(self, t: Float[Array, "..."]) -> RESULTS:
        """Whether the encoder was recorded at each time."""
        return self.knots.check(t)


class Readings(eqx.Module):
    """A recorded angle for each shot, in radians, aligned with the shots: nothing to interpolate, and no delay to calibrate."""

    angle_rad: Component = eqx.field(converter=as_parameter)

    def __init__(self, angle_rad: Component):
        """**Raises:** `WhiskjaxError` for float32, or what is not a finite number."""
        self.angle_rad = take_component(Arrays("Readings"), "angle_rad", angle_rad, absolute=True)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of the shots."""
        return () if isinstance(self.angle_rad, Angle) else np.shape(self.angle_rad)

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
    sign: int = eqx.field(static=True)
    delay_s: Component = eqx.field(converter=as_parameter)
    zero_rad: Component = eqx.field(converter=as_parameter)

    def __init__(self, axis: str, encoder: Encoder | Readings, sign: int = 1, delay_s: Component = 0, zero_rad: Component = 0):
        """**Raises:** `WhiskjaxError` for an axis or a sign that is none, an encoder that is none, an index error in degrees."""
        if axis not in tuple(ELEMENTARY):
            raise WhiskjaxError(f"Turn: a turn has the axis x, y or z, not {axis!r}")
        if sign not in (1, -1):
            raise WhiskjaxError(f"Turn: the sign of a turn is +1 or -1, not {sign!r}")
        need("Turn", "encoder", encoder, (Encoder, Readings), "Encoder(time_s, angle_rad, max_gap_s)")
        arrays = Arrays("Turn")
        self.axis, self.encoder, self.sign = axis, encoder, sign
        self.delay_s = take_component(arrays, "delay_s", delay_s, absolute=True)
        self.zero_rad = take_component(arrays, "zero_rad", zero_rad, within_rad=2 * np.pi)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of its numbers: readings for each shot, or none."""
        return np.broadcast_shapes(self.encoder.batch_shape, np.shape(self.delay_s), np.shape(self.zero_rad))

    def _angle(self, shot: Shot) -> Any:
        time: Any = None if isinstance(self.encoder, Readings) else add(shot.need("time_s", "which a turn needs"), self.delay_s)
        angle = self.encoder.at(time)
        return angle if isinstance(angle, Angle) else mul(self.sign, add(angle, self.zero_rad))

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
