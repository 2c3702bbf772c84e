"""Statements of errors as an adjustment takes them: motions of a link at its stations, which the record observed as zero."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ...chain.correction import AbstractUniform, Correction
from ...chain.sensor import Sensor
from ...chain.stations import AbstractStations
from ...rules import WhiskjaxError, is_traced
from ..errors import AXES, FrameErrors, need_errors
from ..memory import CONSTANT, FADING
from .block import Block

# Of a start about which nothing was said: a tenth of a radian, and of the distance to the points.
_LOOSE = 0.1


@dataclasses.dataclass(frozen=True)
class StationErrors:
    """The unknown motions of a link with stations: what `adjust` estimates of the trajectory.

    The record observes each axis at as many times as there are coefficients. Its errors there are independent (white), or
    Ornstein-Uhlenbeck processes with covariance sigma^2 exp(-|dt| / correlation), those of several statements added.

    - `link`: a `Correction` with orientation images or a spline, or a `PosePerImage`.
    - `errors`: all statements of it with finite sigmas.
    - `sigma`: (6,) turns (rad) and shifts (m), by which the motions are whitened; 0 keeps the axis as it is.
    - `free`: (6,) axes of which nothing was recorded; there `sigma` says how far the start may be off.
    """

    link: str
    errors: tuple[FrameErrors, ...]
    sigma: Float[np.ndarray, " 6"]
    free: tuple[bool, ...]

    @property
    def observed(self) -> bool:
        """Whether all motions were recorded."""
        return not any(self.free)

    @property
    def correlation_s(self) -> tuple[float | tuple[float, ...] | None, ...]:
        """Of each axis the time after which its errors are forgotten; None where they are white, all where there are several."""
        found = []
        for k in range(6):
            times = tuple(float(e.correlation_s[k]) for e in self.errors if k in e.acting and e.memory[k] == FADING)
            found.append(None if not times else times[0] if len(times) == 1 else times)
        return tuple(found)

    def known(self) -> "StationErrors":
        """The same as if the start had been recorded as well as it is known."""
        return dataclasses.replace(self, free=(False,) * 6)

    def stations(self, sensor: Sensor) -> AbstractStations:
        """The link that holds the motions."""
        return sensor[self.link]

    def roots(self, sensor: Sensor) -> Float[np.ndarray, "6 stations stations"]:
        """For each axis the rows that turn whitened coefficients (unit: one sigma) into whitened residuals of the record.

        Axes with sigma 0 hold their coefficients at zero; zero rows where nothing was observed.

        **Raises:** `WhiskjaxError` where errors wander in time, and the link has no nodes in time.
        """
        link = self.stations(sensor)
        basis = link.basis if isinstance(link, Correction) else None
        rows = _dense(basis) if isinstance(basis, AbstractUniform) else np.eye(link.stations)
        return np.stack([self._root(k, link, rows) for k in range(6)])

    def _root(self, k: int, link: AbstractStations, rows: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        size = len(rows)
        if self.free[k]:
            return np.zeros((size, size))
        said = [e for e in self.errors if k in e.acting and np.any(np.asarray(e.sigma[k]) != 0)]
        for e in said:
            if e.memory[k] == FADING and not isinstance(getattr(link, "basis", None), AbstractUniform):
                raise WhiskjaxError(
                    f"errors of {self.link}: {self.link} has no nodes in time, so its errors cannot be correlated in time"
                )
        if len(said) == 1:
            return self._whitened(said[0], k, link, rows)
        if not said:
            return rows
        covariance = sum(_scaled(self._covariance(e, k, link, size), _at(e, k, size) / self.sigma[k]) for e in said)
        return np.linalg.solve(np.linalg.cholesky(covariance), rows)

    def _whitened(self, e: FrameErrors, k: int, link: AbstractStations, rows: np.ndarray) -> np.ndarray:
        """Of one statement: v_k, or (v_k - rho v_(k-1)) / sqrt(1 - rho^2), where rows give v."""
        if np.ndim(e.sigma[k]):
            rows = rows * (self.sigma[k] / _at(e, k, len(rows)))[:, None]
        if e.memory[k] != FADING:
            return rows
        t, firsts = self._epochs(e, link)
        return _forgetting(t, firsts, float(e.correlation_s[k])) @ rows

    def _covariance(self, e: FrameErrors, k: int, link: AbstractStations, size: int) -> np.ndarray:
        """The correlation of one statement between the epochs at which the record observes."""
        if e.memory[k] != FADING:
            return np.eye(size)
        t, firsts = self._epochs(e, link)
        segment = np.searchsorted(firsts, np.arange(size), side="right")
        same = segment[:, None] == segment[None, :]
        return np.where(same, np.exp(-np.abs(t[:, None] - t[None, :]) / float(e.correlation_s[k])), 0.0)

    def _epochs(self, e: FrameErrors, link: AbstractStations) -> tuple[np.ndarray, np.ndarray]:
        """Times at which the record observes, and the number of the first of each stretch for which errors are drawn anew."""
        assert isinstance(link, Correction) and isinstance(link.basis, AbstractUniform)
        basis = link.basis
        firsts = np.cumsum((0, *basis.nodes[:-1])) if e.anew == "strip" else np.zeros(1, dtype=int)
        return basis.epoch_s, firsts


def at_stations(owner: str, errors: Sequence[FrameErrors], sensor: Sensor, block: Block | None = None) -> StationErrors | None:
    """What the statements say of the motions of one link; None where there is no statement.

    **Arguments:** `block`: by whose control points the size of a free start is guessed, where nobody told it.

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
        _refuse(owner, e, link)
    free = tuple(any(e.free[k] for e in errors) for k in range(6))
    finite = tuple(e for e in errors if not any(e.free))
    sigma = np.array([_together([e.sigma[k] for e in finite if k in e.acting]) for k in range(6)])
    if any(free[k] and sigma[k] == 0 for k in range(6)):
        away = _LOOSE * _distance(sensor, block)
        sigma = np.where(np.array(free) & (sigma == 0), [_LOOSE] * 3 + [away] * 3, sigma)
    if not sigma.any():
        raise WhiskjaxError(f"{owner}: all sigmas are zero, so the trajectory would not change: leave errors out")
    return StationErrors(links[0], finite, sigma, free)


def has_stations(errors: FrameErrors, sensor: Sensor) -> bool:
    """Whether an adjustment can estimate the motions of which a statement speaks."""
    return errors.frame in sensor.names and isinstance(sensor[errors.frame], AbstractStations)


def _refuse(owner: str, e: FrameErrors, link: AbstractStations) -> None:
    """**Raises:** `WhiskjaxError` for what the stations of a link cannot have."""
    basis = link.basis if isinstance(link, Correction) else None
    whose = f"{owner}: errors of {e.frame}"
    if any(is_traced(s) for s in (*e.sigma, *e.correlation_s)):
        raise WhiskjaxError(f"{whose} are traced; an adjustment is solved on the host")
    if e.axes == "level":
        raise WhiskjaxError(f'{whose} are in level axes; motions at stations are in those of the frame: axes="frame"')
    acting = [k for k in e.acting if np.any(np.asarray(e.sigma[k]) != 0)]
    per_image = not isinstance(link, Correction)
    for k in acting:
        free, sigma = np.isinf(np.asarray(e.sigma[k])), e.sigma[k]
        if np.ndim(sigma) and (len(sigma) != link.stations or free.any() != free.all() or not np.all(np.asarray(sigma) > 0)):
            raise WhiskjaxError(
                f"{whose}: the sigma of {AXES[k]} has {len(sigma)} values; one positive number, or one for each of the "
                f"{link.stations} stations is expected"
            )
        if free.any() and not all(np.isinf(np.asarray(e.sigma[j])).all() for j in acting):
            raise WhiskjaxError(f"{whose}: some sigmas are infinite and others are not; make two statements of them")
        if e.memory[k] == CONSTANT and not (per_image and e.anew == "image"):
            raise WhiskjaxError(
                f"{whose}: {AXES[k]} errs by a constant, which is an unknown: motion_unknowns() of a Correction(Bias()) with "
                "that sigma, or an Unknown of a Mount there"
            )
    if any(e.memory[k] == FADING for k in acting) and isinstance(basis, AbstractUniform) and e.anew not in ("flight", "strip"):
        raise WhiskjaxError(
            f'{whose} are drawn anew for each {e.anew}; nodes in time know anew="strip", their segments, or "flight"'
        )


def _at(e: FrameErrors, k: int, size: int) -> Float[np.ndarray, " stations"]:
    """The sigma of one axis at every station."""
    return np.broadcast_to(np.asarray(e.sigma[k], dtype=float), (size,))


def _together(sigmas: list[Any]) -> float:
    """The sigma of a sum, over the stations in the mean; of a single number to the last digit."""
    if len(sigmas) == 1 and np.ndim(sigmas[0]) == 0:
        return float(sigmas[0])
    return float(np.sqrt(sum(np.mean(np.square(s)) for s in sigmas)))


def _scaled(correlation: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    return sigma[:, None] * correlation * sigma[None, :]


def _distance(sensor: Sensor, block: Block | None) -> float:
    """How far the control points are from the images that see them, about: in metres, 1 where there is none."""
    rays = np.zeros(0, dtype=int) if block is None else np.flatnonzero((block.role == "control")[block.point])
    if block is None or not rays.size:
        return 1.0
    seen = block.keep(rays)
    camera = np.stack([np.broadcast_to(np.asarray(c), (len(rays),)) for c in sensor.pose(seen.shots()).translation], axis=-1)
    away = np.linalg.norm(block.position_m[seen.point] - camera, axis=1)
    return float(np.median(away)) or 1.0


def _dense(basis: AbstractUniform) -> Float[np.ndarray, "epochs coefficients"]:
    """Weights of the coefficients at the basis' epochs."""
    rows = np.zeros((basis.size, basis.size))
    for i, weight in basis.weights(basis.epoch_s):
        rows[np.arange(basis.size), np.asarray(i)] += np.asarray(weight)
    return rows


def _forgetting(t: np.ndarray, firsts: np.ndarray, correlation_s: float) -> Float[np.ndarray, "epochs epochs"]:
    """Inverse Cholesky factor of the process at the epochs: (v_k - rho v_(k-1)) / sqrt(1 - rho^2), anew in each stretch.

    **Raises:** `WhiskjaxError` where two epochs of one stretch are the same moment.
    """
    factor = np.eye(len(t))
    for first, stop in zip(firsts, (*firsts[1:], len(t)), strict=True):
        rho = np.exp(-np.diff(t[first:stop]) / correlation_s)
        if (rho >= 1).any():
            raise WhiskjaxError(
                f"two nodes lie {np.diff(t[first:stop]).min():g} s apart, where errors of {correlation_s:g} s are the same: "
                'segments that touch are joined by anew="strip" only'
            )
        k = np.arange(first + 1, stop)
        factor[k, k] = 1 / np.sqrt(1 - rho**2)
        factor[k, k - 1] = -rho / np.sqrt(1 - rho**2)
    return factor
