"""Score tests of one family: which of them are beyond chance, whichever is found, and which were of consequence."""

import math
from typing import Any

import numpy as np

from .fitted import Score
from .model_test import FAMILY
from .reason import CAUTION, FAILURE, Figures, about, graded

MOVES = 1.0  # sigmas: of consequence


def judged_together(found: list[Score]) -> Figures:
    """Beyond chance for the best of all its members; a failure where it moved what was estimated."""
    tail, moves, statistic, freedom = (
        np.array([getattr(one, name) for one in found]) for name in ("tail", "moves", "statistic", "freedom")
    )
    beyond = tail * max((freedom > 0).sum(), 1) < FAMILY
    grade = graded(FAILURE, (beyond & (moves > MOVES)).any(), graded(CAUTION, beyond.any()))
    return grade, {
        "beyond": beyond,
        "moves": moves,
        "statistic": statistic,
        "freedom": freedom,
        "size": np.array([one.size for one in found]),
    }


def most_significant(found: dict[str, Any]) -> list[int]:
    """Members beyond chance, the most significant first."""
    order = np.argsort(-(found["statistic"] - found["freedom"]))
    return [int(i) for i in order if found["beyond"][i]]


def in_sigmas(found: dict[str, Any], i: int) -> str:
    """How significant one is, and what it did, in words."""
    said = f"{math.sqrt(float(found['statistic'][i])):.3g} sigma"
    return f"{said}, and moved the answer by {about(float(found['moves'][i]))}"
