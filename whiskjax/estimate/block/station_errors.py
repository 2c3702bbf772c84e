"""Statements of errors as an adjustment takes them: motions of a link at its stations, which the record observed as zero."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...chain.correction import AbstractUniform, Correction
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...chain.stations import AbstractStations
from ...earth.surface import AbstractSurface
from ...rules import WhiskjaxError, arrays_of, is_traced
from ..errors import AXES, FrameErrors, need_errors
from ..level import frame_from_level
from ..memory import CONSTANT, FADING, WHITE
from .block import Block
from .station_rows import Axes, errs

# Of a start about which nothing was said: a tenth of a radian, and of the distance to the points.
_LOOSE = 0.1


@dataclasses.dataclass(frozen=True)
class StationErrors:
    """The unknown motions of a link with stations: what `adjust` estimates of the trajectory.

    The record observes each axis at as many times as there are coefficients. Its errors there are independent (white), or
    Ornstein-Uhlenbeck processes with covariance sigma^2 exp(-|dt| / correlation); covariances of several statements add. Those
    in level axes are turned into the frame's axes where the frame is at that time, which hang together then.

    - `link`: a `Correction` with orientation images or a spline, or a `PosePerImage`.
    - `errors`: all statements of it with finite sigmas.
    - `sigma`: (6,) turns (rad) and shifts (m), by which the motions are whitened; 0 keeps the axis as it is. Where statements are
      traced it is held: what it is changes nothing but the unit of the motions.
    - `free`: (6,) axes of which nothing was recorded; there `sigma` says how far the start may be off.
    - `surface`: what is level; the ellipsoid by default.
    """

    link: str
    errors: tuple[FrameErrors, ...]
    sigma: Float[Any, " 6"]
    free: tuple[bool, ...]
    surface: AbstractSurface | None = None

    @property
    def observed(self) -> bool:
        """Whether all motions were recorded."""
        return not any(self.free)

    @property
    def correlation_s(self) -> tuple[float | tuple[float, ...] | None, ...]:
        """Of each axis the time after which its errors are forgotten; None where they are white, all where there are several."""
        found = []
        for k in range(6):
            times = tuple(e.correlation_s[k] for e in self.errors if k in e.acting and e.memory[k] == FADING)
            times = tuple(t if is_traced(t) else float(t) for t in times)
            found.append(None if not times else times[0] if len(times) == 1 else times)
        return tuple(found)

    def known(self) -> "StationErrors":
        """The same as if the start had been recorded as well as it is known."""
        return dataclasses.replace(self, free=(False,) * 6)

    def stations(self, sensor: Sensor) -> AbstractStations:
        """The link that holds the motions."""
        return sensor[self.link]

    def roots(self, sensor: Sensor) -> Float[Any, "groups rows rows"]:
        """The rows that turn whitened coefficients (unit: one sigma) into whitened residuals of the record.

        Six groups, one an axis, where axes are independent; where errors are in level axes two, turns and shifts, the three axes
        of each one behind the other. Axes with sigma 0 hold their coefficients at zero; zero rows where nothing was observed.

        **Raises:** `WhiskjaxError` where errors wander in time, and the link has no nodes in time; where they leave a direction
        in which the record does not err; or where nobody knows what is up.
        """
        link = self.stations(sensor)
        axes = Axes(link, self.errors, self.sigma, self.free)
        if all(e.axes == "frame" for e in self.errors):
            each = [axes.alone(k) for k in range(6)]
            return arrays_of(each).stack(each)
        with jax.ensure_compile_time_eval():
            times = Shot(image=np.arange(link.stations)) if link.epoch_s is None else Shot(time_s=jnp.asarray(link.epoch_s))
        # A node may lie behind the end of the record: what is level there is what the last samples lead to.
        into = frame_from_level(self.link, sensor.pose(times, self.link), self.surface)
        both = [axes.together(first, into) for first in (0, 3)]
        return arrays_of(both).stack(both)


def at_stations(
    owner: str,
    errors: Sequence[FrameErrors],
    sensor: Sensor,
    block: Block | None = None,
    surface: AbstractSurface | None = None,
) -> StationErrors | None:
    """What the statements say of the motions of one link; None where there is no statement.

    **Arguments:** `block`: by whose control points the size of a free start is guessed, where nobody told it; `surface`: what is
    level, the ellipsoid by default.

    **Raises:** `WhiskjaxError` for statements of several links, of a link without stations, and for what stations cannot have.
    """
    errors = need_errors(owner, errors)
    if not errors:
        return None
    links = list(dict.fromkeys(e.frame for e in errors))
    for e in errors:
        e.check(sensor)
    for name in links:
        if not isinstance(sensor[name], AbstractStations):
            raise WhiskjaxError(
                f"{owner}: {name} is a {type(sensor[name]).__name__}; a Correction or a PosePerImage is needed, whose motions "
                "can be estimated"
            )
    if len(links) > 1:
        raise WhiskjaxError(f"{owner}: errors of {' and '.join(links)}; the motions of one link are estimated")
    link: AbstractStations = sensor[links[0]]
    for e in errors:
        _refuse(
            owner, e, link, others=any(e is not one and CONSTANT not in [one.memory[k] for k in one.acting] for one in errors)
        )
    free = tuple(any(e.free[k] for e in errors) for k in range(6))
    finite = tuple(e for e in errors if not any(e.free))
    sigma = [_together([s for e in finite for s in _along(e, k)]) for k in range(6)]
    if any(free[k] and not errs(sigma[k]) for k in range(6)):
        loose = [_LOOSE] * 3 + [_LOOSE * _distance(sensor, block)] * 3
        sigma = [loose[k] if free[k] and not errs(sigma[k]) else sigma[k] for k in range(6)]
    if not any(map(errs, sigma)):
        raise WhiskjaxError(f"{owner}: all sigmas are zero, so the trajectory would not change: leave errors out")
    return StationErrors(links[0], finite, arrays_of(sigma).stack(sigma), free, surface)


def has_stations(errors: FrameErrors, sensor: Sensor) -> bool:
    """Whether an adjustment can estimate the motions of which a statement speaks."""
    return errors.frame in sensor.names and isinstance(sensor[errors.frame], AbstractStations)


def _refuse(owner: str, e: FrameErrors, link: AbstractStations, others: bool) -> None:
    """**Raises:** `WhiskjaxError` for what the stations of a link cannot have; `others`: they err in other ways, too."""
    basis = link.basis if isinstance(link, Correction) else None
    whose = f"{owner}: errors of {e.frame}"
    if e.axes == "level" and any(e.free):
        raise WhiskjaxError(f'{whose} are infinite along level axes; poses that nobody recorded are free in all: axes="frame"')
    acting = [k for k in e.acting if errs(e.sigma[k])]
    per_image = not isinstance(link, Correction)
    for k in acting:
        sigma, known = e.sigma[k], np.ones(1) if is_traced(e.sigma[k]) else np.asarray(e.sigma[k])
        free = np.isinf(known)
        if np.ndim(sigma) and (np.shape(sigma)[0] != link.stations or free.any() != free.all() or not np.all(known > 0)):
            raise WhiskjaxError(
                f"{whose}: the sigma of {AXES[k]} has {np.shape(sigma)[0]} values; one positive number, or one for each of the "
                f"{link.stations} stations is expected"
            )
        if free.any() and not all(e.free[j] for j in acting):
            raise WhiskjaxError(f"{whose}: some sigmas are infinite and others are not; make two statements of them")
        if e.memory[k] == CONSTANT and not others and not (per_image and e.anew == "image"):
            raise WhiskjaxError(
                f"{whose}: {AXES[k]} errs by a constant, which is an unknown: motion_unknowns() of a Correction(Bias()) with "
                "that sigma, or an Unknown of a Mount there"
            )
    known = ("flight", "strip") if isinstance(basis, AbstractUniform) else ("flight", "image")
    if any(e.memory[k] != WHITE for k in acting) and e.anew not in known:
        raise WhiskjaxError(
            f'{whose} are drawn anew for each {e.anew}; nodes in time know anew="strip", their segments, or "flight", and images '
            '"image" or "flight"'
        )


def _along(e: FrameErrors, k: int) -> list[Any]:
    """The sigmas of a statement by which motions along one axis of the frame are counted: of level axes the mean one."""
    if e.axes == "frame":
        return [e.sigma[k]] if k in e.acting else []
    first = 3 * (k // 3)
    if not any(j in e.acting for j in range(first, first + 3)):
        return []
    math = arrays_of(e)
    return [math.sqrt(sum(math.mean(math.square(e.sigma[j])) for j in range(first, first + 3)) / 3)]


def _together(sigmas: list[Any]) -> Any:
    """The sigma of a sum, over the stations in the mean; of a single number to the last digit. Not differentiated."""
    if (math := arrays_of(sigmas)) is jnp:
        return jax.lax.stop_gradient(jnp.sqrt(sum(jnp.mean(jnp.square(s)) for s in sigmas)))
    if len(sigmas) == 1 and np.ndim(sigmas[0]) == 0:
        return float(sigmas[0])
    return float(math.sqrt(sum(math.mean(math.square(s)) for s in sigmas)))


def _distance(sensor: Sensor, block: Block | None) -> float:
    """How far the control points are from the images that see them, about: in metres, 1 where there is none."""
    rays = np.zeros(0, dtype=int) if block is None else np.flatnonzero((block.role == "control")[block.point])
    if block is None or not rays.size:
        return 1.0
    seen = block.keep(rays)
    camera = np.stack([np.broadcast_to(np.asarray(c), (len(rays),)) for c in sensor.pose(seen.shots()).translation], axis=-1)
    away = np.linalg.norm(block.position_m[seen.point] - camera, axis=1)
    return float(np.median(away)) or 1.0
