"""Which numbers of a block its rays do not determine, and what they know of the unknowns without priors."""

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular

from ...rules import arrays_of, plain
from ..errors import AXES
from .station_errors import StationErrors

_DEFINITE = 1e-9  # of a unit diagonal: pivots from which on a matrix is far from singular
_ROUNDING = 1e-13  # of the largest eigenvalue of a normal matrix


def weak(matrix: Float[np.ndarray, "m m"], stations: int, unknowns: Sequence[str], motions: StationErrors | None) -> str:
    """Which unknowns take part in the weakest combination of a singular system."""
    if not np.isfinite(matrix).all():
        return ": the normal equations hold values that are no numbers"
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > 1e-12 * values[-1]:
        return ""
    share = np.abs(vectors[:, 0])
    names = [f"{axis} of station {k}" for axis in AXES for k in range(stations)] + list(unknowns)
    order = np.argsort(-share)[:6]
    named = ", ".join(names[i] for i in order if share[i] > 0.1 * share[order[0]])
    hint = "" if motions is None or motions.observed else "; without POS a block needs three control points or more"
    return f": {named}. Give priors, or leave some of them out{hint}"


def data_rows(matrix: Any, size: int, information: Any) -> Float[Any, "q q"]:
    """A root of what rays, control and POS know of the whitened unknowns, their priors left out and motions integrated out.

    **Arguments:** `matrix`: the reduced normal matrix, motions first; `size`: how many numbers they are; `information`: of the
    priors. Eigenvalues that are zero but for rounding are zero.
    """
    math, matrix = arrays_of((matrix, information)), plain(matrix)
    own, border, inner = matrix[size:, size:] - information, matrix[size:, :size], matrix[:size, :size]
    if size:
        own = own - _explained(inner, border)
    if not len(own):
        return own
    known = own.diagonal() > _ROUNDING * matrix.diagonal()[size:]
    length = math.where(known, math.sqrt(math.where(known, own.diagonal(), 1.0)), 1.0)
    values, vectors = math.linalg.eigh(own * math.outer(known, known) / math.outer(length, length))
    values = math.where(values > _ROUNDING * values[-1], values, 0.0)
    return math.sqrt(values)[:, None] * vectors.T * math.where(known, length, 0.0)


def _explained(inner: Any, border: Any) -> Any:
    """B A^-1 B^T; by eigenvalues, fifty times as long, where A is singular or traced."""
    math = arrays_of((inner, border))
    if math is np:
        scale = 1 / np.sqrt(np.where(inner.diagonal() > 0, inner.diagonal(), 1.0))
        with contextlib.suppress(np.linalg.LinAlgError):
            lower = np.linalg.cholesky(inner * np.outer(scale, scale))
            if lower.diagonal().min() ** 2 > _DEFINITE:
                half = solve_triangular(lower, (border * scale).T, lower=True)
                return half.T @ half
    return border @ math.linalg.pinv(inner, rcond=_ROUNDING, hermitian=True) @ border.T
