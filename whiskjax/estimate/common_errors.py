"""Whether errors that are stated as new at every exposure are one and the same in all of them.

They then leave residuals that are smaller than stated, and the mean of many exposures is no better than one. The residuals cannot
tell this from errors that are small: both leave too little. What differs is the answer.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from .evidence import Evidence, seen_by
from .model_test import NOTHING, UNLIKELY
from .reason import FAILURE, FINE, Check, Figures, Said, about, graded, several

_PART = 0.5  # of the stated variance: with less from the frames it is the pixels whose sigma is too large
_WIDENS = 2.0  # a factor on the sigmas of the answer


def _common(e: Evidence) -> Figures:
    """By how much sigmas would grow if the variance that is missing in the residuals were common to all of them.

    Of passing errors a (one sigma each, whitened) the part q is constant, and chi-square falls to f of what was stated: f = 1 - q
    a^T a / coordinates. Constant errors move the answer by C R^T a, whose covariance in units of C has the eigenvalues of
    a^T R C R^T a, and what is left of the others f C. The largest sum of the two is what some sigma grows by, squared.
    """
    if e.fit is None or e.seen is None or e.passing is None or not float(e.tail) >= 1 - UNLIKELY or e.variance_factor < NOTHING:
        return np.asarray(FINE), {}
    effects, frames = e.passing()
    if not frames:
        return np.asarray(FINE), {}
    gram = e.fit.gram(e.fit.whitened(np.asarray(effects).reshape(-1, len(frames))))
    each = gram.whole.diagonal() / (2 * np.count_nonzero(e.seen.used))
    share, factor = min(float(each.sum()), 1.0), float(e.variance_factor)
    common = min((1 - factor) / share, 1.0) if share > 0 else 0.0
    widens = math.sqrt(factor + common * max(float(np.linalg.eigvalsh(gram.taken)[-1]), 0.0))
    moves = common * gram.taken.diagonal()
    return graded(FAILURE, (share > _PART) & (widens > _WIDENS)), {"widens": widens, "share": share, "moves": moves}


def _say_common(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.passing is not None
    _, each = e.passing()
    moved: dict[str, float] = {}
    for frame, moves in zip(each, found["moves"], strict=True):
        moved[frame] = moved.get(frame, 0.0) + float(moves)
    frames = sorted((name for name in moved if moved[name] > 0), key=lambda name: -moved[name])
    factor, share, widens = float(np.sqrt(e.variance_factor)), float(found["share"]), float(found["widens"])
    yield (
        f"the {e.words.residuals} are {factor:.2g} times as large as stated, and {share:.0%} of what is stated are errors of "
        f"{several(frames)} that are said to be forgotten: were they the same in all {seen_by(e).used.sum()} {e.words.noun}, the "
        f"answer's sigmas would be up to {about(widens)} times as large; state them as constant (correlation_s=inf), or smaller",
        {"frame": frames[0], "frames": frames, "share": share, "sigma_factor": factor, "widens": widens},
    )


COMMON_ERRORS = Check("errors in common", _common, _say_common)
