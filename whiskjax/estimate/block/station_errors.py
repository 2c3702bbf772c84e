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
from ...rules import WhiskjaxError, arrays_of, is_traced, plain
from ..errors import AXES, FrameErrors, need_errors
from ..level import frame_from_level
from ..memory import CONSTANT, FADING, WHITE
from .block import Block

# Of a start about which nothing was said: a tenth of a radian, and of the distance to the points.
_LOOSE = 0.1
_LEAST = 1e-12  # eigenvalue of a correlation of stations: below it is what rounding leaves of zero


@dataclasses.dataclass(frozen=True)
class StationErrors:
    """The unknown motions of a link with stations: what `adjust` estimates of the trajectory.

    The record observes each axis at as many times as there are coefficients. Its errors there are independent (white), or
    Ornstein-Uhlenbeck processes with covariance sigma^2 exp(-|dt| / correlation); covariances of several statements add. Those
    in level axes are turned into the frame's axes where the frame is at that time, which hang together then.

    - `link`: a `Correction` with orientation images or a spline, or a `PosePerImage`.
    - `errors`: all statements of it with finite sigmas.
    - `sigma`: (6,) turns (rad) and shifts (m), by which the motions are whitened; 0 keeps the axis as it is.
    - `free`: (6,) axes of which nothing was recorded; there `sigma` says how far the start may be off.
    - `surface`: what is level; the ellipsoid by default.
    """

    link: str
    errors: tuple[FrameErrors, ...]
    sigma: Float[np.ndarray, " 6"]
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
            times = tuple(float(e.correlation_s[k]) for e in self.errors if k in e.acting and e.memory[k] == FADING)
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
        with jax.ensure_compile_time_eval():  # the nodes are the host's
            basis = link.basis if isinstance(link, Correction) else None
            rows = _dense(basis) if isinstance(basis, AbstractUniform) else np.eye(link.stations)
            if all(e.axes == "frame" for e in self.errors):
                return np.stack([self._root(k, link, rows) for k in range(6)])
            epochs = Shot(image=np.arange(len(rows))) if link.epoch_s is None else Shot(time_s=jnp.asarray(link.epoch_s))
        # A node may lie behind the end of the record: what is level there is what the last samples lead to.
        into = frame_from_level(self.link, sensor.pose(epochs, self.link), self.surface)
        math = arrays_of(into)
        shape = (len(rows),)
        turned = [[math.broadcast_to(plain(c), shape) for c in row] for row in into]
        return math.stack([self._joint(first, link, rows, turned) for first in (0, 3)])

    def _joint(self, first: int, link: AbstractStations, rows: Float[np.ndarray, "n n"], turned: list[list[Any]]) -> Any:
        """The rows of three axes together."""
        size, axes = len(rows), range(3)
        math: Any = arrays_of(turned)
        total = [[np.zeros((size, size)) for _ in axes] for _ in axes]
        for e in self.errors:
            for k in (k for k in e.acting if first <= k < first + 3):
                with jax.ensure_compile_time_eval():
                    of_axis = _scaled(self._covariance(e, k, link, size), _at(e, k, size))
                for i in axes:
                    for j in axes:
                        if e.axes == "level":
                            c, d = turned[i][k - first], turned[j][k - first]
                            total[i][j] = total[i][j] + c[:, None] * of_axis * d[None, :]
                        elif i == j == k - first:
                            total[i][j] = total[i][j] + of_axis
        whole = math.concatenate([math.concatenate(row, axis=1) for row in total], axis=0)
        # Axes of which nothing was recorded say nothing; those that stay hold their coefficients.
        free = np.repeat(self.free[first : first + 3], size)
        still = np.repeat(self.sigma[first : first + 3] == 0, size) & ~free
        apart = (free | still)[:, None] | (free | still)[None, :]
        whole = math.where(apart, np.diag((free | still).astype(float)), whole)
        whitened = np.kron(np.eye(3), rows) * np.repeat(
            np.where(self.sigma[first : first + 3] > 0, self.sigma[first : first + 3], 1.0), size
        )
        found = math.linalg.solve(self._cholesky(whole), whitened)
        return math.where(free[:, None], 0.0, found)

    def _cholesky(self, covariance: Any) -> Any:
        """Its root.

        **Raises:** `WhiskjaxError` where it has none.
        """
        if is_traced(covariance):
            return jnp.linalg.cholesky(covariance)
        variance = np.diag(covariance)
        size = np.sqrt(np.where(variance > 0, variance, 1.0))
        if np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance / np.outer(size, size))[0] > _LEAST:
            return np.linalg.cholesky(covariance)
        raise WhiskjaxError(
            f"errors of {self.link} are singular: some motion of its stations has no error at all, or the record does not reach "
            "them; say of every axis how it errs, and not by a constant alone"
        )

    def _root(self, k: int, link: AbstractStations, rows: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
        size = len(rows)
        if self.free[k]:
            return np.zeros((size, size))
        said = [e for e in self.errors if k in e.acting and np.any(np.asarray(e.sigma[k]) != 0)]
        if len(said) == 1 and said[0].memory[k] != CONSTANT:
            return self._whitened(said[0], k, link, rows)
        if not said:
            return rows
        covariance = sum(_scaled(self._covariance(e, k, link, size), _at(e, k, size) / self.sigma[k]) for e in said)
        return np.linalg.solve(self._cholesky(covariance), rows)

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
        if e.memory[k] == WHITE or (e.memory[k] == CONSTANT and e.anew == "image"):
            return np.eye(size)
        if e.memory[k] == CONSTANT and e.anew == "flight":
            return np.ones((size, size))
        t, firsts = self._epochs(e, link)
        segment = np.searchsorted(firsts, np.arange(size), side="right")
        same = segment[:, None] == segment[None, :]
        away = np.abs(t[:, None] - t[None, :])
        return np.where(same, 1.0 if e.memory[k] == CONSTANT else np.exp(-away / float(e.correlation_s[k])), 0.0)

    def _epochs(self, e: FrameErrors, link: AbstractStations) -> tuple[np.ndarray, np.ndarray]:
        """Times at which the record observes, and the number of the first of each stretch for which errors are drawn anew."""
        basis = getattr(link, "basis", None)
        if not isinstance(basis, AbstractUniform):
            raise WhiskjaxError(
                f"errors of {self.link}: {self.link} has no nodes in time, so its errors cannot be correlated in time"
            )
        firsts = np.cumsum((0, *basis.nodes[:-1])) if e.anew == "strip" else np.zeros(1, dtype=int)
        return basis.epoch_s, firsts


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
    sigma = np.array([_together([s for e in finite for s in _along(e, k)]) for k in range(6)])
    if any(free[k] and sigma[k] == 0 for k in range(6)):
        away = _LOOSE * _distance(sensor, block)
        sigma = np.where(np.array(free) & (sigma == 0), [_LOOSE] * 3 + [away] * 3, sigma)
    if not sigma.any():
        raise WhiskjaxError(f"{owner}: all sigmas are zero, so the trajectory would not change: leave errors out")
    return StationErrors(links[0], finite, sigma, free, surface)


def has_stations(errors: FrameErrors, sensor: Sensor) -> bool:
    """Whether an adjustment can estimate the motions of which a statement speaks."""
    return errors.frame in sensor.names and isinstance(sensor[errors.frame], AbstractStations)


def _refuse(owner: str, e: FrameErrors, link: AbstractStations, others: bool) -> None:
    """**Raises:** `WhiskjaxError` for what the stations of a link cannot have; `others`: they err in other ways, too."""
    basis = link.basis if isinstance(link, Correction) else None
    whose = f"{owner}: errors of {e.frame}"
    if any(is_traced(s) for s in (*e.sigma, *e.correlation_s)):
        raise WhiskjaxError(f"{whose} are traced; an adjustment is solved on the host")
    if e.axes == "level" and any(e.free):
        raise WhiskjaxError(f'{whose} are infinite along level axes; poses that nobody recorded are free in all: axes="frame"')
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
    return [np.sqrt(sum(np.mean(np.square(e.sigma[j])) for j in range(first, first + 3)) / 3)]


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
