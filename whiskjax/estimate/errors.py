"""How a recorded frame errs: one statement that weighs, draws and names.

White, constant and Ornstein-Uhlenbeck errors are one kind, told apart by the time after which they are forgotten: zero, infinite,
or between. Two exposures at t_i and t_j, for which the error was not drawn anew in between, have the covariance
sigma_i sigma_j exp(-|t_i - t_j| / tau) of each component (Gelb 1974, section 4.5, the first-order Markov process).
"""

import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Mat3, Vec3, is_structural, vadd
from ..chain.pose import Motion
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..earth.surface import AbstractSurface
from ..rules import Arrays, Numbers, WhiskjaxError, arrays_of, is_traced, need, plain
from ..rules.spread import LEAST_SIGMA, MOST_SIGMA, refuse_sigmas
from .level import in_frame
from .memory import CONSTANT, FADING, WHITE, correlation, drawn

AXES = ("turn x", "turn y", "turn z", "shift x", "shift y", "shift z")
ANEW = ("flight", *KEYS)
_FRAMES = ("frame", "level")
_MOTIONS = tuple(Motion(**{kind: axis}) for kind in ("turn", "shift") for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))


class FrameErrors(eqx.Module):
    """How the recorded pose of a frame errs: recorded = true @ motion, a small turn about and shift along three axes.

    Components are independent of each other and of other frames. Several statements of one frame add: a GNSS bias in level axes
    beside an attitude that wanders and a vibration.

    **Arguments:**

    - `frame`: its name in the sensor; of a `Correction`, the frame behind it, whose motions it holds.
    - `turn_sigma_rad`, `shift_sigma_m`: 1-sigma about and along x, y, z; numbers, or arrays (exposures,) or (images,) where the
      record has an accuracy of its own for each. The number 0 is exactly none and costs nothing; an array of 0 is a value.
      Infinite: the pose was not recorded and is free, for `adjust` alone; another, finite statement of the frame then says how
      far the start may be off, by which steps are scaled (a tenth of a radian and of the distance without one).
    - `correlation_s`: after how many seconds errors are forgotten, one number, or six for turns and shifts. 0: new at every
      exposure (white); infinite: constant; between: an Ornstein-Uhlenbeck process.
    - `anew`: for each what of a shot the errors are drawn anew: "flight" (never), "strip", "image", "swing" or "view".
    - `axes`: "frame", those of the frame itself, or "level", east, north and up where the frame is.
    """

    frame: str = eqx.field(static=True)
    turn_sigma_rad: Vec3
    shift_sigma_m: Vec3
    correlation_s: tuple[Component, ...]
    memory: tuple[str, ...] = eqx.field(static=True)
    anew: str = eqx.field(static=True)
    axes: str = eqx.field(static=True)

    def __init__(
        self,
        frame: str,
        turn_sigma_rad: Sequence[Numbers] | Numbers = (0, 0, 0),
        shift_sigma_m: Sequence[Numbers] | Numbers = (0, 0, 0),
        correlation_s: Sequence[Numbers] | Numbers = 0.0,
        anew: str = "flight",
        axes: str = "frame",
    ):
        """**Raises:** `WhiskjaxError` where there are not three sigmas of each, one is negative, no number or in degrees, a
        correlation time is negative or no time, or `anew` or `axes` is a word that means nothing here."""
        need("FrameErrors", "frame", frame, str)
        arrays = Arrays("FrameErrors")
        self.frame = frame
        self.turn_sigma_rad = _sigmas(arrays, "turn_sigma_rad", turn_sigma_rad, within_rad=2 * np.pi)
        self.shift_sigma_m = _sigmas(arrays, "shift_sigma_m", shift_sigma_m)
        self.correlation_s, self.memory = _correlations(arrays, correlation_s)
        for name, value, known in (("anew", anew, ANEW), ("axes", axes, _FRAMES)):
            if value not in known:
                arrays.refuse(name, f"is {value!r}; it is one of {', '.join(known)}")
        self.anew, self.axes = anew, axes

    @property
    def sigma(self) -> tuple[Component, ...]:
        """The six sigmas: turns in radians, shifts in metres."""
        return (*self.turn_sigma_rad, *self.shift_sigma_m)

    @property
    def acting(self) -> tuple[int, ...]:
        """Which of the six components there are at all: all but those that are structurally zero."""
        return tuple(k for k, sigma in enumerate(self.sigma) if not is_structural(sigma, 0))

    @property
    def is_white(self) -> bool:
        """Whether all of its errors are new at every exposure."""
        return all(self.memory[k] == WHITE for k in self.acting)

    @property
    def free(self) -> tuple[bool, ...]:
        """Of each component, whether it was not recorded: its sigma is infinite. Never of one that is traced."""
        return tuple(not is_traced(s) and bool(np.isinf(s).any()) for s in self.sigma)

    @property
    def described(self) -> str:
        """What tells it from other statements of its frame, in words that no number enters."""
        return f"{self.frame}: {', '.join(dict.fromkeys(self.memory))}, anew for each {self.anew}, {self.axes} axes"

    def key(self, shot: Shot) -> Any:
        """The shots' key for which the errors are drawn anew; 0 where that is the flight.

        **Raises:** `WhiskjaxError` where the shots do not carry it.
        """
        return 0 if self.anew == "flight" else shot.need(self.anew, f"for which errors of {self.frame} are drawn anew")

    def exposures(self, shot: Shot, count: int | None = None) -> "Exposures":
        """What the errors have to know of exposures, each (n,): time where it matters, and which of them share a draw.

        **Arguments:** `count`: how many there are, where nothing of the shots says it.

        **Raises:** `WhiskjaxError` where the shots lack it, or are no list.
        """
        shapes = [np.shape(getattr(shot, name)) for name in ("time_s", *KEYS) if getattr(shot, name) is not None]
        shape = np.broadcast_shapes(*shapes, *(np.shape(sigma) for sigma in self.sigma))
        if len(shape) > 1:
            raise WhiskjaxError(f"exposures of the shape {shape}: errors are correlated along one axis; use vmap for the others")
        n = shape[0] if shape else 1 if count is None else count
        time, group = None, 0 if self.is_white else self.key(shot)
        if any(self.memory[k] == FADING for k in self.acting):
            time = plain(shot.need("time_s", f"by which errors of {self.frame} are forgotten"))
            time = arrays_of(time).broadcast_to(time, (n,))
        return Exposures(n, time, arrays_of(group).broadcast_to(plain(group), (n,)))

    def correlation(self, shot: Shot, component: int, count: int | None = None) -> Float[Array, "n n"]:
        """The correlation of one component (0 to 5, as in `AXES`) between exposures: exp(-|dt| / tau), 0 where drawn anew."""
        n, time, group = self.exposures(shot, count)
        return correlation(self.memory[component], self.correlation_s[component], time, group[:, None] == group[None, :], n)

    def covariance(self, shot: Shot) -> Float[Array, "6 n n"]:
        """The covariance of each component between exposures (n,), turns in rad^2 and shifts in m^2; zero where there is none.

        **Raises:** `WhiskjaxError` where the shots lack a time or a key that the errors need, or are no list.
        """
        n = self.exposures(shot).count
        found = [jnp.zeros((n, n))] * 6
        for k in self.acting:
            sigma = jnp.broadcast_to(self.sigma[k], (n,))
            found[k] = sigma[:, None] * sigma[None, :] * self.correlation(shot, k)
        return jnp.stack(found)

    def draw(self, key: Any, shot: Shot, sensor: Sensor | None = None, surface: AbstractSurface | None = None) -> Motion:
        """One draw of these errors alone, as `draw_errors` draws it: the motion of each exposure, in the frame's own axes."""
        return draw_errors([self], key, shot, sensor, surface)[self.frame]

    def refuse_free(self, owner: str) -> None:
        """**Raises:** `WhiskjaxError` where a sigma is infinite, for who needs a pose that was recorded."""
        if any(self.free):
            raise WhiskjaxError(
                f"{owner}: the poses of {self.frame} are free (an infinite sigma): nothing was recorded; adjust finds them"
            )

    def check(self, sensor: Sensor) -> None:
        """**Raises:** `WhiskjaxError` where the sensor has no such frame, or a sigma is none that anything can be weighed by."""
        if self.frame not in sensor.names:
            raise WhiskjaxError(f"no frame named {self.frame!r}; there are {', '.join(sensor.names)}")
        for name, sigma in zip(AXES, self.sigma, strict=True):
            if not is_traced(sigma):
                finite = np.atleast_1d(sigma)[np.isfinite(np.atleast_1d(sigma))]
                refuse_sigmas(finite, lambda _, name=name: f"errors of {self.frame}: the sigma of {name}", zero=True)


class Exposures(NamedTuple):
    """How many there are, when they were made, and the group of each: those that share a draw."""

    count: int
    time_s: Float[Array, " n"] | None
    group: Array


def unit_motion(component: int, turned: Mat3 | None = None) -> Motion:
    """The unit motion of one of the six components in the frame's axes, its zeros and ones structural.

    **Arguments:** `turned`: the rotation from the statement's axes into the frame's, where they are level.
    """
    if turned is None:
        return _MOTIONS[component]
    column = tuple(row[component % 3] for row in turned)
    return Motion(turn=column) if component < 3 else Motion(shift=column)


def need_errors(owner: str, errors: Any) -> tuple[FrameErrors, ...]:
    """The statements that somebody was given, as a tuple.

    **Raises:** `WhiskjaxError` where they are no sequence of statements, or exactly the same one is there twice.
    """
    need(owner, "errors", errors, Sequence, "[FrameErrors(...), ...]")
    for i, one in enumerate(errors):
        need(owner, f"errors[{i}]", one, FrameErrors)
        if any(_is_same(one, other) for other in errors[:i]):
            raise WhiskjaxError(
                f"{owner}: errors[{i}] of {one.frame!r} says exactly what one before it says; statements of a frame add, so give "
                "it once, or one with the larger sigma"
            )
    return tuple(errors)


def draw_errors(
    errors: Sequence[FrameErrors], key: Any, shot: Shot, sensor: Sensor | None = None, surface: AbstractSurface | None = None
) -> dict[str, Motion]:
    """One draw of all errors: by which motion the recorded pose of each frame is off at each exposure. Traceable.

    **Arguments:**

    - `key`: of `jax.random`. A statement draws by its own words, so that other statements change nothing of what it draws.
    - `shot`: the exposures, (n,), in any order; with time and keys where statements need them.
    - `sensor`: needed where axes are level, since it says how the frames are turned.
    - `surface`: what is level; the ellipsoid by default.

    **Returns:** by frame, the motion of each exposure, components (n,), in the frame's own axes: recorded = true @ motion; of
    several statements the sum. Components of which nobody speaks are structurally zero.

    **Raises:** `WhiskjaxError` where shots lack a time or a key, sigmas are infinite, or nobody knows what is up.
    """
    errors = need_errors("draw_errors", errors)
    found: dict[str, Motion] = {}
    for i, one in enumerate(errors):
        one.refuse_free("draw_errors")
        n, time, group = one.exposures(shot)
        # Of the same words the second draws something else than the first.
        ordinal = sum(other.described == one.described for other in errors[:i])
        own = jax.random.fold_in(jax.random.fold_in(key, zlib.crc32(one.described.encode())), ordinal)
        white = plain(jax.random.normal(own, (6, n), float))  # of components that do not act, too: which do changes no other
        standard, six = drawn(white, one.acting, one.memory, one.correlation_s, time, group), [0] * 6
        for k in one.acting:
            six[k] = plain(one.sigma[k]) * standard[k]
        motion = Motion(tuple(six[:3]), tuple(six[3:]))
        if one.axes == "level":
            motion = in_frame(one.frame, motion, shot, sensor, surface)
        before = found.get(one.frame, Motion())
        found[one.frame] = Motion(vadd(before.turn, motion.turn), vadd(before.shift, motion.shift))
    return found


def _is_same(a: FrameErrors, b: FrameErrors) -> bool:
    if a is b:
        return True
    if a.described != b.described or a.memory != b.memory:
        return False
    pairs = list(zip((*a.sigma, *a.correlation_s), (*b.sigma, *b.correlation_s), strict=True))
    if any(is_traced(p) or is_traced(q) for p, q in pairs):
        return False
    return all(np.shape(p) == np.shape(q) and np.array_equal(p, q) for p, q in pairs)


def _sigmas(arrays: Arrays, name: str, values: Any, within_rad: float | None = None) -> Vec3:
    """Three components; a number that is exactly zero stays structural and costs nothing."""
    several = isinstance(values, tuple | list) or getattr(values, "ndim", 0) > 0
    if not several or len(values) != 3:
        arrays.refuse(name, f"is {values!r}; a sigma about or along each of three axes is needed")
    taken = []
    for value in values:
        if isinstance(value, int | float | np.number) and value == 0:
            taken.append(0)
            continue
        array = arrays.take(name, value, "...", least=0.0)
        if not is_traced(array):
            held = np.asarray(array)
            arrays.take(name, np.where(np.isinf(held), 0.0, held), "...", finite=True, within_rad=within_rad)
        taken.append(_known(array))
    return tuple(taken)


def _known(number: Any) -> Array:
    """As an array; what is known stays so while others trace."""
    with nullcontext() if is_traced(number) else jax.ensure_compile_time_eval():
        return jnp.asarray(number, dtype=float)


def _correlations(arrays: Arrays, given: Any) -> tuple[tuple[Component, ...], tuple[str, ...]]:
    """Six times, and what each of them means; what is known to be zero or infinite is so before tracing."""
    how: Any = {"least": 0.0, "meaning": "seconds"}
    if isinstance(given, tuple | list):
        six = [arrays.take("correlation_s", one, "", **how) for one in given]
    else:
        taken = arrays.take("correlation_s", given, "six" if np.ndim(given) else "", **how)
        six = [taken] * 6 if np.ndim(taken) == 0 else list(taken)
    if len(six) != 6:
        arrays.refuse("correlation_s", f"has {len(six)} entries; one time is expected, or six: of the turns and of the shifts")
    times: list[Component] = []
    memory: list[str] = []
    for axis, value in zip(AXES, six, strict=True):
        if is_traced(value):
            times.append(value)
            memory.append(FADING)
            continue
        seconds = float(value)
        if seconds not in (0.0, np.inf) and not LEAST_SIGMA < seconds < MOST_SIGMA:
            arrays.refuse("correlation_s", f"of {axis} is {seconds:g} s: 0 is new at every exposure, and infinite is constant")
        known = {0.0: WHITE, np.inf: CONSTANT}.get(seconds, FADING)
        times.append(_known(seconds) if known == FADING else 0)
        memory.append(known)
    return tuple(times), tuple(memory)
