"""What a record says of motions at stations: rows that whiten the covariance of its errors there."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...algebra.vectors import Mat3
from ...chain.correction import AbstractUniform, Correction
from ...chain.stations import AbstractStations
from ...rules import WhiskjaxError, arrays_of, is_traced, plain
from ..errors import FrameErrors
from ..memory import CONSTANT, FADING, WHITE, forgotten

_LEAST = 1e-12  # eigenvalue of a correlation of stations: below it is what rounding leaves of zero


@dataclasses.dataclass(frozen=True)
class Axes:
    """Turns about and shifts along the three axes of a link's frame, as `StationErrors` has them."""

    link: AbstractStations
    errors: tuple[FrameErrors, ...]
    sigma: Float[Any, " 6"]
    free: tuple[bool, ...]

    @property
    def rows(self) -> Float[np.ndarray, "n n"]:
        """Weights of the coefficients at the times at which the record observes."""
        basis = self.link.basis if isinstance(self.link, Correction) else None
        with jax.ensure_compile_time_eval():  # the nodes are the host's
            return dense(basis) if isinstance(basis, AbstractUniform) else np.eye(self.link.stations)

    def alone(self, k: int) -> Float[Any, "n n"]:
        """The rows of an axis that is independent of the others."""
        rows, size = self.rows, self.link.stations
        if self.free[k]:
            return np.zeros((size, size))
        said = [e for e in self.errors if k in e.acting and errs(e.sigma[k])]
        if not said:
            return rows
        if len(said) > 1 or said[0].memory[k] == CONSTANT or arrays_of(said) is jnp:
            # A traced sigma may turn out to be zero, and then holds the coefficients.
            none = self.sigma[k] == 0
            math = arrays_of(none)
            covariance = sum(self._covariance(e, k) for e in said) / math.where(none, 1.0, self.sigma[k]) ** 2
            covariance = covariance + math.where(none, 1.0, 0.0) * np.eye(size)
            return arrays_of(covariance).linalg.solve(self._root(covariance), rows)
        e = said[0]  # v_k, or (v_k - rho v_(k-1)) / sqrt(1 - rho^2), where rows give v
        if np.ndim(e.sigma[k]):
            rows = rows * (self.sigma[k] / np.asarray(e.sigma[k]))[:, None]
        return _forgetting(*_epochs(e, self.link), float(e.correlation_s[k])) @ rows if e.memory[k] == FADING else rows

    def together(self, first: int, into: Mat3) -> Float[Any, "rows rows"]:
        """The rows of three axes that hang together, one axis behind the other.

        **Arguments:** `first`: 0 for turns, 3 for shifts; `into`: the rotations from level axes into those of the frame.
        """
        size, three, math = self.link.stations, range(3), arrays_of((into, self.errors))
        turned = [[math.broadcast_to(plain(c), (size,)) for c in row] for row in into]
        total: Any = [[np.zeros((size, size)) for _ in three] for _ in three]
        for e in self.errors:
            for k in (k for k in three if first + k in e.acting):
                own = self._covariance(e, first + k)
                if e.axes == "frame":
                    total[k][k] = total[k][k] + own
                    continue
                for i in three:
                    for j in three:
                        total[i][j] = total[i][j] + turned[i][k][:, None] * own * turned[j][k][None, :]
        covariance = math.concatenate([math.concatenate(row, axis=1) for row in total], axis=0)
        # Axes of which nothing was recorded say nothing; those that stay hold their coefficients.
        scales = arrays_of(self.sigma)
        sigma, free = scales.repeat(self.sigma[first : first + 3], size), np.repeat(self.free[first : first + 3], size)
        apart = free | (sigma == 0)
        covariance = math.where(apart[:, None] | apart[None, :], scales.diag(apart.astype(float)), covariance)
        rows = np.kron(np.eye(3), self.rows) * scales.where(sigma > 0, sigma, 1.0)[None, :]
        return math.where(free[:, None], 0.0, math.linalg.solve(self._root(covariance), rows))

    def _covariance(self, e: FrameErrors, k: int) -> Float[Any, "n n"]:
        """Of one statement, between the times at which the record observes."""
        size, math = self.link.stations, arrays_of(e.sigma[k])
        sigma = math.broadcast_to(math.asarray(e.sigma[k], dtype=float), (size,))
        return sigma[:, None] * self._correlation(e, k, size) * sigma[None, :]

    def _correlation(self, e: FrameErrors, k: int, size: int) -> Float[Any, "n n"]:
        if e.memory[k] == WHITE or (e.memory[k] == CONSTANT and e.anew == "image"):
            return np.eye(size)
        if e.memory[k] == CONSTANT and e.anew == "flight":
            return np.ones((size, size))
        t, firsts = _epochs(e, self.link)
        segment = np.searchsorted(firsts, np.arange(size), side="right")
        kept = 1.0 if e.memory[k] == CONSTANT else forgotten(np.abs(t[:, None] - t[None, :]), e.correlation_s[k])
        return arrays_of(kept).where(segment[:, None] == segment[None, :], kept, 0.0)

    def _root(self, covariance: Any) -> Any:
        """Its Cholesky factor.

        **Raises:** `WhiskjaxError` where it has none.
        """
        if is_traced(covariance):
            return jnp.linalg.cholesky(covariance)
        variance = np.diag(covariance)
        size = np.sqrt(np.where(variance > 0, variance, 1.0))
        if np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance / np.outer(size, size))[0] > _LEAST:
            return np.linalg.cholesky(covariance)
        raise WhiskjaxError(
            f"errors of {self.errors[0].frame} are singular: some motion of its stations has no error at all, or the record does "
            "not reach them; say of every axis how it errs, and not by a constant alone"
        )


def errs(sigma: Any) -> bool:
    """Whether there is an error; one that is traced may be."""
    return is_traced(sigma) or bool(np.any(np.asarray(sigma) != 0))


def _epochs(e: FrameErrors, link: AbstractStations) -> tuple[np.ndarray, np.ndarray]:
    """Times at which the record observes, and the number of the first of each stretch for which errors are drawn anew.

    **Raises:** `WhiskjaxError` where the link has no nodes in time.
    """
    basis = getattr(link, "basis", None)
    if not isinstance(basis, AbstractUniform):
        raise WhiskjaxError(f"errors of {e.frame}: {e.frame} has no nodes in time, so its errors cannot be correlated in time")
    firsts = np.cumsum((0, *basis.nodes[:-1])) if e.anew == "strip" else np.zeros(1, dtype=int)
    with jax.ensure_compile_time_eval():
        return np.asarray(basis.epoch_s), firsts


def dense(basis: AbstractUniform) -> Float[np.ndarray, "epochs coefficients"]:
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
