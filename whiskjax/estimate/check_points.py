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
    """

    chi_square: float
    freedom: int
    tail_probability: float
    worst: tuple[str, ...]
    worst_sigmas: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether chance explains the differences, by the bound of the model test."""
        return self.tail_probability > UNLIKELY

    @property
    def factor(self) -> float:
        """How many times as large as predicted the differences are; NaN without check points."""
        return math.sqrt(self.chi_square / self.freedom) if self.freedom else math.nan


UNTESTED = CheckTest(0.0, 0, 1.0, (), ())


def check_test(chi_square: float, own: Float[np.ndarray, " n"], each: int, label: Callable[[int], str]) -> CheckTest:
    """From the joint chi-square of n check points, and the chi-square of each by itself.

    **Arguments:** `each`: how many numbers are compared at a point; `label`: names the i-th of them.
    """
    freedom = each * len(own)
    tail = chi_square_tail(chi_square, freedom) if math.isfinite(chi_square) else math.nan
    order = np.argsort(-np.nan_to_num(own, nan=np.inf), kind="stable")[:_NAMED].tolist()
    return CheckTest(chi_square, freedom, tail, tuple(label(i) for i in order), tuple(float(np.sqrt(own[i])) for i in order))


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
