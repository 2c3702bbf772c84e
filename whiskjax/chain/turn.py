"""Scan mirrors and gimbals: rotations about a named axis by a recorded encoder."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.angles import ELEMENTARY, Angle
from ..algebra.vectors import Component, add, is_structural, mul, unstack
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, is_traced, need, plain
from .camera import common_batch, parameter
from .knots import Knots, take
from .link import AbstractLink, Moves, Recorded
from .pose import Pose
from .shot import Shot
from .spline import Interpolation, check_interpolation, hermite, spline_slopes
from .wraps import check_wraps, unwrapped

_POWERS = 2  # of a polynomial that nobody gave: square and cube
# Beside its neighbours: a flyback that no sample fell into.
_MUCH_FASTER = 4.0


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
    """A recorded angle, between its samples linear, as in the papers, or a cubic spline.

    `interpolation` "linear" has a rate that jumps at every sample, and so kinks a cost that is a function of a delay; "cubic" is
    one spline for each piece between gaps, with continuous rate and acceleration (not a knot, as scipy's `CubicSpline`; a
    parabola through three samples, a line through two). A spline overshoots where a mirror flies back within a sample or two:
    such a record stays linear.
    """

    knots: Knots
    angle_rad: Float[Array, " n"]
    rate_rps: Float[Array, " n"] | None  # of the spline
    interpolation: Interpolation = eqx.field(static=True)
    wraps: bool | None = eqx.field(static=True)

    def __init__(
        self,
        time_s: Float[Numbers, " n"],
        angle_rad: Float[Numbers, " n"],
        max_gap_s: float,
        name: str = "Encoder",
        *,
        interpolation: Interpolation = "linear",
        wraps: bool | None = None,
    ):
        """**Arguments:**

        - `time_s`: strictly increasing, seconds; never traced.
        - `angle_rad`: radians.
        - `max_gap_s`: longer intervals are not bridged.
        - `name`: for messages.
        - `interpolation`: "linear" or "cubic".
        - `wraps`: True for angles that were recorded modulo one turn, whose jumps are taken out; False for angles that are what
          they are: cumulative, or of a mirror with flyback. None tells by the record (wraps.py), and refuses where it cannot.

        **Raises:** `WhiskjaxError` for times that do not increase, angles that are not finite, lengths that differ, and a step
        that cannot be told from its complement.
        """
        arrays = Arrays(name)
        time = np.asarray(arrays.take("time_s", time_s, "n", absolute=True))
        angle = plain(arrays.take("angle_rad", angle_rad, "n", absolute=True, finite=True))
        self.knots = Knots(time, max_gap_s, name)
        is_gap = np.diff(time) > max_gap_s
        self.interpolation = check_interpolation(name, interpolation)
        is_cubic = self.interpolation == "cubic"
        if is_traced(angle):
            if check_wraps(name, wraps):
                raise WhiskjaxError(f"{name}: traced angles are taken as they are: no jumps are taken out of them")
        else:
            angle, unclear = unwrapped(time, angle, is_gap, check_wraps(name, wraps))
            if unclear:
                raise WhiskjaxError(f"{name}: {unclear.what}")
        self.angle_rad = jnp.asarray(angle)
        self.rate_rps = jnp.asarray(spline_slopes(time, angle[:, None], is_gap)[:, 0]) if is_cubic else None
        self.wraps = wraps

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """(): all shots read it."""
        return ()

    def at(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        """The angle at each time, radians."""
        i, w, length = self.knots.locate(t)
        before, after = take(self.angle_rad, i), take(self.angle_rad, i + 1)
        if self.rate_rps is None:
            return before + w * (after - before)
        return hermite(w, before, after, length * take(self.rate_rps, i), length * take(self.rate_rps, i + 1))

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


def _as_gain(value: Any) -> Any:
    """An array, except for the structural one, which stays a Python int and costs nothing."""
    return 1 if is_structural(value, 1) else jnp.asarray(value, dtype=float)


class Turn(AbstractLink):
    """Rotation about x, y or z by sign * (gain r + zero_rad + p0 r^2 + p1 r^3 + ...) with the reading r = encoder(t + delay_s).

    Scan mirrors and gimbals are Turns in list order. `delay_s` (how much later than the shot's time stamp the encoder was read),
    `zero_rad` (its index error), `gain` (its scale, nominally one) and `polynomial_rad` (p0, p1, ... by powers of r in radians:
    what a scale that is not even leaves, of which `zero_rad` and `gain` are the constant and the linear term) can be calibrated.
    """

    axis: str = eqx.field(static=True)
    encoder: Encoder | Readings
    sign: int = eqx.field(static=True)
    delay_s: Component = eqx.field(converter=as_parameter)
    zero_rad: Component = eqx.field(converter=as_parameter)
    gain: Component = eqx.field(converter=_as_gain)
    polynomial_rad: Float[Array, "*batch powers"] | None = eqx.field(converter=parameter)

    def __init__(
        self,
        axis: str,
        encoder: Encoder | Readings,
        sign: int = 1,
        delay_s: Component = 0,
        zero_rad: Component = 0,
        gain: Component = 1,
        polynomial_rad: Float[Numbers, "*batch powers"] | None = None,
    ):
        """**Raises:** `WhiskjaxError` for an axis, a sign or an encoder that is none, angles in degrees, a gain that is not
        positive."""
        if axis not in tuple(ELEMENTARY):
            raise WhiskjaxError(f"Turn: a turn has the axis x, y or z, not {axis!r}")
        if sign not in (1, -1):
            raise WhiskjaxError(f"Turn: the sign of a turn is +1 or -1, not {sign!r}")
        need("Turn", "encoder", encoder, (Encoder, Readings), "Encoder(time_s, angle_rad, max_gap_s)")
        arrays = Arrays("Turn")
        self.axis, self.encoder, self.sign = axis, encoder, sign
        self.delay_s = take_component(arrays, "delay_s", delay_s, absolute=True)
        self.zero_rad = take_component(arrays, "zero_rad", zero_rad, within_rad=2 * np.pi)
        self.gain = gain if is_structural(gain, 1) else arrays.take("gain", gain, "...", finite=True, above=0.0)
        powers = "of the reading's square, cube and so on"
        self.polynomial_rad = arrays.take(
            "polynomial_rad", polynomial_rad, "... powers", optional=True, finite=True, within_rad=2 * np.pi, meaning=powers
        )

    def absent(self, field: str) -> Float[np.ndarray, "..."] | None:
        """An even scale."""
        return np.zeros(_POWERS) if field == "polynomial_rad" else None

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of its numbers: readings for each shot, or none."""
        own = common_batch((self.delay_s, 0), (self.zero_rad, 0), (self.gain, 0), (self.polynomial_rad, 1))
        return np.broadcast_shapes(self.encoder.batch_shape, own)

    def _angle(self, shot: Shot) -> Any:
        time: Any = None if isinstance(self.encoder, Readings) else add(shot.need("time_s", "which a turn needs"), self.delay_s)
        angle = self.encoder.at(time)
        return angle if isinstance(angle, Angle) else mul(self.sign, add(self._scaled(angle), self.zero_rad))

    def _scaled(self, reading: Component) -> Component:
        """The reading by its gain, and its powers."""
        scaled = mul(self.gain, reading)
        if self.polynomial_rad is None:
            return scaled
        *rest, series = unstack(self.polynomial_rad)
        for coefficient in reversed(rest):
            series = add(coefficient, mul(reading, series))
        return add(scaled, mul(mul(reading, reading), series))

    def _steepest(self, reading: Float[Array, " n"]) -> Component:
        """The angle changes by no more than so much for each radian of the reading."""
        most, steepest = jnp.max(jnp.abs(reading)), abs(self.gain)
        for k, coefficient in enumerate(() if self.polynomial_rad is None else unstack(self.polynomial_rad)):
            steepest = steepest + (k + 2) * jnp.abs(coefficient) * most ** (k + 1)
        return steepest

    @property
    def kinks(self) -> tuple[str, ...]:
        """The delay, unless the encoder is interpolated by a spline."""
        return ("delay_s",) if isinstance(self.encoder, Encoder) and self.encoder.interpolation == "linear" else ()

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The encoder; readings aligned with the shots have no times."""
        return () if isinstance(self.encoder, Readings) else (Recorded(self.encoder.knots, self.delay_s),)

    def moves(self, shot: Shot) -> Moves:
        """Between the readings of the encoder."""
        if isinstance(self.encoder, Readings):
            return Moves()
        rate = self.encoder.rates()
        turn_radps = mul(self._steepest(self.encoder.angle_rad), jnp.max(jnp.abs(rate)))
        return Moves(tuple(r._replace(leaps=_leaps(rate)) for r in self.recorded), turn_radps)

    def pose(self, shot: Shot) -> Pose:
        """The turn at the shot's time."""
        return Pose(ELEMENTARY[self.axis](self._angle(shot)))

    def ready(self, shot: Shot) -> "Turn":
        """The same turn with the sine and cosine of its angle, scale, index error and sign included."""
        return Turn(self.axis, Readings(Angle.of(self._angle(shot))))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the encoder was recorded at the shot's time."""
        if isinstance(self.encoder, Readings):
            return RESULTS.successful
        return self.encoder.check(add(shot.need("time_s", "which a turn needs"), self.delay_s))
