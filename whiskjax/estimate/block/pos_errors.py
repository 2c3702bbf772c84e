"""What is known of the POS errors before the adjustment: their size, and how fast they are forgotten."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...chain.correction import AbstractUniform, Correction
from ...chain.sensor import Sensor
from ...chain.stations import AbstractStations
from ...rules import Arrays, WhiskjaxError, need, need_flags
from ...rules.spread import LEAST_SIGMA, MOST_SIGMA, refuse_sigmas

AXES = ("turn x", "turn y", "turn z", "shift x", "shift y", "shift z")


@dataclasses.dataclass(frozen=True)
class PosErrors:
    """The unknown motions of a link with stations, observed by POS as zero: what `adjust` estimates of the trajectory.

    POS observes each axis at as many times as there are coefficients. Its errors there are independent (white), or an
    Ornstein-Uhlenbeck process with covariance sigma^2 exp(-|dt| / correlation), new in each segment (strip).

    **Arguments:**

    - `link`: a `Correction` with orientation images or a spline, or a `PosePerImage`.
    - `turn_sigma_rad`, `shift_sigma_m`: 1-sigma about and along each axis of the frame; 0 keeps the axis as it is.
    - `turn_correlation_s`, `shift_correlation_s`: for each axis; None is white.
    - `observed`: False where nothing was recorded: the poses are free, and the sigmas only say how far the start may be off.
    """

    link: str
    turn_sigma_rad: Sequence[float]
    shift_sigma_m: Sequence[float]
    turn_correlation_s: Sequence[float | None] | None = None
    shift_correlation_s: Sequence[float | None] | None = None
    observed: bool = True

    def __post_init__(self):
        need("PosErrors", "link", self.link, str)
        arrays, axes = Arrays("PosErrors"), "x, y, z of the frame"
        arrays.take("turn_sigma_rad", self.turn_sigma_rad, "3", finite=True, least=0.0, within_rad=2 * np.pi, meaning=axes)
        arrays.take("shift_sigma_m", self.shift_sigma_m, "3", finite=True, least=0.0, meaning=axes)
        for name in ("turn_correlation_s", "shift_correlation_s"):
            given = getattr(self, name)
            if isinstance(given, list | tuple):
                arrays.fit(name, (len(given),), "3", axes)
                given = [1.0 if seconds is None else seconds for seconds in given]
            arrays.take(name, given, "3", optional=True, finite=True, above=0.0, meaning=axes)
        need_flags("PosErrors", observed=self.observed)
        refuse_sigmas(self.sigma, lambda i: f"PosErrors: the sigma of {AXES[i]}", zero=True)
        for axis, c in zip(AXES, self.correlation_s, strict=True):
            if c is not None and not LEAST_SIGMA < c < MOST_SIGMA:
                raise WhiskjaxError(
                    f"PosErrors: the correlation time of {axis} is {c:g} s: None is white noise, and a constant is an unknown"
                )
        if not self.sigma.any():
            raise WhiskjaxError("PosErrors: all sigmas are zero, so the trajectory would not change: leave pos_errors out")

    @property
    def sigma(self) -> Float[np.ndarray, " 6"]:
        """Sigmas of turns (rad) and shifts (m)."""
        return np.array([*self.turn_sigma_rad, *self.shift_sigma_m], dtype=float)

    @property
    def correlation_s(self) -> tuple[float | None, ...]:
        """Correlation times of turns and shifts."""
        given = self.turn_correlation_s, self.shift_correlation_s
        return tuple(c for three in given for c in ((None,) * 3 if three is None else three))

    def stations(self, sensor: Sensor) -> AbstractStations:
        """The link that holds the motions.

        **Raises:** `WhiskjaxError` where the link has no stations.
        """
        link = sensor[self.link]
        if not isinstance(link, AbstractStations):
            raise WhiskjaxError(f"PosErrors: {self.link} is a {type(link).__name__}; a Correction or a PosePerImage is needed")
        return link

    def roots(self, sensor: Sensor) -> Float[np.ndarray, "6 stations stations"]:
        """For each axis the rows that turn whitened coefficients (unit: one sigma) into whitened residuals of POS.

        Axes with sigma 0 hold their coefficients at zero; zero rows where nothing was observed.
        """
        link = self.stations(sensor)
        size = link.stations
        if not self.observed:
            return np.stack([np.zeros((size, size)) if s > 0 else np.eye(size) for s in self.sigma])
        basis = link.basis if isinstance(link, Correction) else None
        if isinstance(basis, AbstractUniform):
            rows = _dense(basis)
            return np.stack([rows if c is None else _forgetting(basis, c) @ rows for c in self.correlation_s])
        if any(c is not None for c in self.correlation_s):
            raise WhiskjaxError(f"PosErrors: {self.link} has no nodes in time, so its errors cannot be correlated in time")
        return np.stack([np.eye(size)] * 6)


def _dense(basis: AbstractUniform) -> Float[np.ndarray, "epochs coefficients"]:
    """Weights of the coefficients at the basis' epochs."""
    rows = np.zeros((basis.size, basis.size))
    for i, weight in basis.weights(basis.epoch_s):
        rows[np.arange(basis.size), np.asarray(i)] += np.asarray(weight)
    return rows


def _forgetting(basis: AbstractUniform, correlation_s: float) -> Float[np.ndarray, "epochs epochs"]:
    """Inverse Cholesky factor of the process at the epochs: (v_k - rho v_(k-1)) / sqrt(1 - rho^2), anew in each segment."""
    t, last = basis.epoch_s, np.cumsum(basis.nodes)
    factor = np.eye(basis.size)
    for first, stop in zip(last - np.array(basis.nodes), last, strict=True):
        rho = np.exp(-np.diff(t[first:stop]) / correlation_s)
        k = np.arange(first + 1, stop)
        factor[k, k] = 1 / np.sqrt(1 - rho**2)
        factor[k, k - 1] = -rho / np.sqrt(1 - rho**2)
    return factor
