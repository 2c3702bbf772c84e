"""What may contradict an answer though its own residuals do not: check points, and sigmas stretched beyond reason.

Residuals are judged against the sigmas they were weighted by (`consistency`), which an error common to all control points passes,
and which weights from the data pass by construction. Two further checks, the same for every verb: points that took no part must
lie where the answer and its covariance say, and a factor on a sigma must stay one that a careless sigma explains.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .diagnosis import UNLIKELY, chi_square_tail
from .variance_components import Components

# Sigmas that are only guessed are wrong by 2 or 3; beyond this factor the errors are of another kind than was said.
_STRETCHED, _SURE = 5.0, 2.0
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


def stretched(found: Components | None) -> tuple[int, ...]:
    """Groups whose sigma would have to be another by more than five times, either way, and surely so: 2 of its own log sigmas."""
    if found is None:
        return ()
    beyond = np.abs(np.log(found.factor)) - _SURE * found.log_sigma > math.log(_STRETCHED)
    return tuple(np.flatnonzero(beyond).tolist())


def contradictions(check: CheckTest, found: Components | None) -> list[str]:
    """What to say of an answer that its check points, or the weights it needed, contradict."""
    said = []
    if not check.agrees and math.isfinite(check.chi_square):
        chance = f"{check.tail_probability:.0e}" if check.tail_probability >= 1e-6 else "below 1e-6"
        named = ", ".join(f"{w} ({s:.3g} sigma)" for w, s in zip(check.worst, check.worst_sigmas, strict=True))
        said.append(
            f"the check points contradict the answer: their differences are {check.factor:.3g} times as large as the answer's "
            f"covariance, their own and their measurements' say (chance: {chance}); the worst are {named}"
        )
    for g in stretched(found):
        assert found is not None
        factor = float(found.factor[g])
        times, why = (factor, "look for blunders, or an error that many share, or state") if factor > 1 else (1 / factor, "state")
        said.append(
            f"the errors of {found.names[g]} are {times:.3g} times {'larger' if factor > 1 else 'smaller'} than their sigmas "
            f"say: beyond a factor of {_STRETCHED:g} that is a finding, not a weight; {why} the sigma anew"
        )
    return said
