"""What may contradict an answer though its own residuals do not: points that took no part.

Residuals are judged against the sigmas they were weighted by, which an error common to all control points passes, and which
weights from the data pass by construction. Check points must lie where the answer and its covariance say.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .model_test import UNLIKELY, chi_square_tail

_NAMED = 3


class CheckTest(NamedTuple):
    """Points that took no part, beside what the answer predicts of them.

    `chi_square` has `freedom` degrees where the answer and its covariance are right, all points together: the error of the answer
    is common to them. `tail_probability` is the chance of a larger one; `worst` names the points that are the most of their own
    sigmas off, `worst_sigmas` says how many. `freedom` is 0 where there are no check points: nothing was tested then.

    `shift_m` is the one shift of all check points (world frame) that fits the differences best, `shift_tail` the chance of one as
    large: three numbers tell a datum that is off where hundreds of differences would hide it.
    """

    chi_square: float
    freedom: int
    tail_probability: float
    worst: tuple[str, ...]
    worst_sigmas: tuple[float, ...]
    shift_m: tuple[float, ...] = ()
    shift_tail: float = 1.0

    @property
    def agrees(self) -> bool:
        """Whether chance explains the differences and their shift, by the bound of the model test."""
        return self.tail_probability > UNLIKELY and self.shift_tail > UNLIKELY

    @property
    def factor(self) -> float:
        """How many times as large as predicted the differences are; NaN without check points."""
        return math.sqrt(self.chi_square / self.freedom) if self.freedom else math.nan


UNTESTED = CheckTest(0.0, 0, 1.0, (), ())


class Shift(NamedTuple):
    """Of all check points in common: how much it takes off the joint chi-square, and how large it is, metres, world frame."""

    chi_square: float
    shift_m: Float[np.ndarray, "3"]


def check_test(
    chi_square: float, own: Float[np.ndarray, " n"], each: int, label: Callable[[int], str], shift: Shift
) -> CheckTest:
    """From the joint chi-square of n check points, the chi-square of each by itself, and their common shift.

    **Arguments:** `each`: how many numbers are compared at a point; `label`: names the i-th of them.
    """
    freedom = each * len(own)
    tail = chi_square_tail(chi_square, freedom) if math.isfinite(chi_square) else math.nan
    order = np.argsort(-np.nan_to_num(own, nan=np.inf), kind="stable")[:_NAMED].tolist()
    worst, sigmas = tuple(label(i) for i in order), tuple(float(np.sqrt(own[i])) for i in order)
    by_shift = chi_square_tail(shift.chi_square, 3) if math.isfinite(shift.chi_square) else 1.0
    return CheckTest(chi_square, freedom, tail, worst, sigmas, tuple(shift.shift_m.tolist()), by_shift)


def joint_chi_square(difference: Float[np.ndarray, " n"], spread: Float[np.ndarray, "n k"]) -> float:
    """v^T (I + B B^T)^-1 v of whitened differences v whose answer is common to them: B is a root of its covariance, seen by them.

    It is the least |v - B z|^2 + |z|^2 over z, k numbers however many differences there are (Woodbury 1950). NaN where a
    difference or the covariance is not a number.
    """
    k = spread.shape[1]
    rows, right = np.concatenate([spread, np.eye(k)]), np.concatenate([difference, np.zeros(k)])
    if not (np.isfinite(rows).all() and np.isfinite(right).all()):
        return math.nan
    z = np.linalg.lstsq(rows, right, rcond=None)[0]
    left = right - rows @ z
    return float(left @ left)


def common_shift(
    difference: Float[np.ndarray, " n"], spread: Float[np.ndarray, "n k"], by_shift: Float[np.ndarray, "n 3"]
) -> Shift:
    """The generalised least-squares shift of whitened differences with the covariance 1 + B B^T (`joint_chi_square`).

    **Arguments:** `by_shift`: what a metre along each axis does to the differences.
    """
    both = np.concatenate([difference[:, None], by_shift], axis=1)
    if not (np.isfinite(both).all() and np.isfinite(spread).all()):
        return Shift(math.nan, np.full(3, math.nan))
    weighed = both - spread @ np.linalg.solve(np.eye(spread.shape[1]) + spread.T @ spread, spread.T @ both)
    slope, normal = by_shift.T @ weighed[:, 0], by_shift.T @ weighed[:, 1:]
    size = np.linalg.lstsq(normal, slope, rcond=1e-9)[0]
    return Shift(float(slope @ size), size)
