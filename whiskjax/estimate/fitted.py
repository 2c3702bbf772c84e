"""What a fit left of its measurements, and how it would have shown an error that nobody modelled: the score test.

Measurements whose whitened errors are e have the residuals r = M e, M = 1 - R C R^T, with R the derivatives by all that was
estimated (priors are further measurements) and C its covariance. An error a, known but for its size s, leaves M a s. With
G = a^T M a its size would come out as s = G^-1 a^T r, of covariance G^-1, and s^T G s is chi-square where there is none (Rao
1948): by so much the sum of squares would fall were it estimated. What it did to all that was estimated instead is, in sigmas,
sqrt(s^T (a^T a - G) s): Baarda's external reliability (1968). An error that the fit takes whole, G = 0, cannot be seen.

One solve with what the adjustment already has answers for any number of patterns.
"""

import abc
import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import issparse

from .model_test import chi_square_tail

_AT_ONCE = 50  # groups of patterns
VISIBLE = 1e-4  # of a pattern's square: where the fit leaves less, the error of linearising decides


class Gram(NamedTuple):
    """Of patterns a, (2n, d): a^T a, and a^T R C R^T a, what the fit takes of it; (d, d) each."""

    whole: Float[np.ndarray, "d d"]
    taken: Float[np.ndarray, "d d"]


class AbstractFitted(abc.ABC):
    """Residuals of n measurements and the operator R C R^T of their fit; numpy.

    Rows are coordinates: x and y of the first measurement, then of the next. Patterns may be scipy's sparse arrays.
    """

    residual: Float[np.ndarray, "n 2"]
    visible: float = VISIBLE

    @abc.abstractmethod
    def whitened(self, pattern_px: Any) -> Any:
        """Errors of the pixels, (2n, d), over the sigmas; zero for measurements that took no part."""

    @abc.abstractmethod
    def gram(self, pattern: Any) -> Gram:
        """Of whitened patterns."""

    @property
    @abc.abstractmethod
    def taken(self) -> Float[np.ndarray, "n 2 2"]:
        """The blocks of R C R^T on its diagonal: what the fit takes of each measurement's own error."""

    @property
    def left(self) -> Float[np.ndarray, "n 2 2"]:
        """The covariance of each residual; the identity for one that took no part."""
        return np.eye(2) - self.taken


class Dense(AbstractFitted):
    """A fit of few numbers, whose rows are all at hand.

    **Arguments:** `residual`: whitened, (n, 2), at u; `rows`: its derivatives by k whitened numbers, (n, 2, k), zero where a
    measurement took no part; `information`: of their priors, (k, k), and `pull`, its product with u less the prior mean;
    `whitener`: from pixels (n, 2, d) to whitened (n, 2, d); `visible`: of a pattern's square what the fit has to leave.

    The residuals are those where all k numbers are at their optimum: numbers that were only considered are estimated here, so
    that what they explain is no sign of anything else.
    """

    def __init__(self, residual: Any, rows: Any, information: Any, pull: Any, whitener: Any, visible: float = VISIBLE):
        flat = np.asarray(rows).reshape(-1, np.shape(rows)[-1])
        normal = flat.T @ flat + information
        scale = 1 / np.sqrt(np.where(normal.diagonal() > 0, normal.diagonal(), 1.0))
        self._covariance = np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
        step = -self._covariance @ (flat.T @ np.ravel(residual) + pull)
        self.residual = (np.ravel(residual) + flat @ step).reshape(-1, 2)
        self._rows, self._whitener, self.visible = flat, whitener, visible

    def whitened(self, pattern_px: Any) -> Any:
        """Errors of the pixels over the sigmas."""
        dense = pattern_px.toarray() if issparse(pattern_px) else np.asarray(pattern_px)
        return self._whitener(dense.reshape(-1, 2, dense.shape[1])).reshape(dense.shape)

    def gram(self, pattern: Any) -> Gram:
        """Of whitened patterns."""
        along = self._rows.T @ pattern
        return Gram(pattern.T @ pattern, along.T @ self._covariance @ along)

    @property
    def taken(self) -> Float[np.ndarray, "n 2 2"]:
        """What the fit takes of each measurement's own error."""
        rows = self._rows.reshape(-1, 2, self._rows.shape[1])
        return rows @ self._covariance @ rows.swapaxes(1, 2)


class Score(NamedTuple):
    """Of a pattern of d numbers: what it would take off the sum of squares, and by chance does; its size, in the units of the
    pattern; and how far, in sigmas, it would have moved what was estimated."""

    statistic: float
    freedom: int
    tail: float
    size: Float[np.ndarray, " d"]
    sigma: Float[np.ndarray, " d"]
    moves: float


def scores(fit: AbstractFitted, pattern_px: Any, groups: list[slice]) -> list[Score]:
    """The score test of each group of columns of patterns in pixels, (2n, d), each beside nothing else.

    Groups follow one another. Some at a time: of thousands of images the products of all with all are never made.
    """
    pattern, found = fit.whitened(pattern_px), []
    for start in range(0, len(groups), _AT_ONCE):
        some = groups[start : start + _AT_ONCE]
        first = some[0].start
        part = pattern[:, first : some[-1].stop]
        slope, gram = np.asarray(part.T @ fit.residual.ravel()), fit.gram(part)
        own = [slice(g.start - first, g.stop - first) for g in some]
        found += [_score(slope[g], gram.whole[g, g], gram.taken[g, g], fit.visible) for g in own]
    return found


def _score(slope: Any, whole: Any, taken: Any, visible: float) -> Score:
    length = np.sqrt(np.where(whole.diagonal() > 0, whole.diagonal(), 1.0))
    values, vectors = np.linalg.eigh((whole - taken) / np.outer(length, length))
    seen = values > visible
    along = (vectors[:, seen] / np.sqrt(values[seen])) / length[:, None]
    size = along @ (along.T @ slope)
    statistic = float(np.sum((along.T @ slope) ** 2))
    moves = math.sqrt(max(float(size @ taken @ size), 0.0))
    # What cannot be seen at all has no sigma.
    hidden = (vectors[:, ~seen] ** 2).sum(axis=1) > visible
    sigma = np.where(hidden, np.inf, np.sqrt((along**2).sum(axis=1)))
    return Score(statistic, int(seen.sum()), chi_square_tail(statistic, int(seen.sum())), size, sigma, moves)
