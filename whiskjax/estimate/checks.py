"""The checks that every answer passes through, whichever verb gave it; each is `figures` (traceable) and `sentences` (people).

A new check joins `CHECKS` once, and serves calibrations, blocks and targets alike. Here stand those of the answer as a whole: how
it ended, its residuals, its check points and the weights it needed.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..rules import arrays_of
from ..rules.results import codes_of, message_of
from .common_errors import COMMON_ERRORS
from .evidence import Evidence, seen_by
from .measurement_checks import BESIDE, COPIES, LEFT_OUT, LOPSIDED
from .model_test import NOTHING, UNLIKELY
from .number_checks import CORRELATION, FAR, KINKS, PRIORS, RANK, TURNED
from .pattern_checks import PATTERN_CHECKS, UNTESTED
from .reason import CAUTION, FAILURE, FINE, NOTE, Check, Figures, Said, graded, judged, probability, several
from .suspect_checks import SUSPECT_CHECKS
from .variance_components import STRETCHED

_SMALL = 0.5  # of the variance factor: below it sigmas are called too large


def _ended(e: Evidence) -> Figures:
    code, where = codes_of(e.estimate.result), np.zeros(1, dtype=int) if e.seen is None else codes_of(e.seen.code)
    grade = graded(FAILURE, (code != 0) | (where != 0).any(), NOTE)
    return grade, {"code": code, "fail": (where != 0).sum(), "first": (where != 0).argmax()}


def _say_ended(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    code, where = int(found["code"]), codes_of(seen_by(e).code)
    if code and code not in where:
        lost = [n for n, s in zip(e.estimate.names, e.estimate.sigma, strict=True) if not np.isfinite(s)]
        yield f"{message_of(code)}{': ' * bool(lost)}{several(lost)}", {"code": code, "unknowns": lost}
    if (count := int(found["fail"])) > 0:
        i, label = int(found["first"]), seen_by(e).label(int(found["first"]))
        more = f" ({count} of {len(where)} {e.words.noun} fail)" if count > 1 else ""
        hint = f"; {e.words.hint}" if e.words.hint else ""
        yield f"where the iteration ended, {label}: {message_of(int(where[i]))}{more}{hint}", {"measurement": label}
    elif not code:
        yield f"{e.words.how}, and measurements and priors determine everything", {}


ENDED = Check("solution", _ended, _say_ended)


def ended(e: Evidence) -> str:
    """How it ended, in words."""
    return "; ".join(reason.text for reason in judged((ENDED,), e))


def _agreement(e: Evidence) -> Figures:
    """The model test: the sum of squares against chi-square."""
    math_ = arrays_of((e.variance_factor, e.tail))
    factor, tail = math_.asarray(e.variance_factor), math_.asarray(e.tail)
    grade = graded(FAILURE, tail <= UNLIKELY, graded(CAUTION, (tail >= 1 - UNLIKELY) | ~(factor >= _SMALL), NOTE))
    return grade, {"factor": factor, "freedom": e.freedom, "tail_probability": tail}


def _say_agreement(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    factor, freedom, tail = float(np.sqrt(found["factor"])), int(found["freedom"]), float(found["tail_probability"])
    figures = {"sigma_factor": factor, "degrees_of_freedom": freedom, "tail_probability": tail}
    times = f"the {e.words.residuals} are {factor:.3g} times as large as their sigmas say"
    if found["factor"] < NOTHING and freedom > 0:
        made = f"the {e.words.noun} were made with the model itself"
        yield f"the {e.words.residuals} are all zero: {made}, and test nothing", figures
    elif freedom <= 0:
        yield "there are no more measurements and priors than unknowns: nothing checks the fit", {"degrees_of_freedom": freedom}
    elif tail <= UNLIKELY:
        yield f"{times}, more than chance explains (probability: {probability(tail)}): {e.words.remedy}", figures
    elif tail >= 1 - UNLIKELY or found["factor"] < _SMALL:
        yield f"{times}: the sigmas given are too large, and so are those of the answer", figures
    else:
        yield f"{times}, which is consistent (probability of more by chance: {probability(tail)})", figures


AGREEMENT = Check("consistency", _agreement, _say_agreement)


def _checked(e: Evidence) -> Figures:
    if e.check is None:
        return np.asarray(FINE), {}
    figures = {"chi_square": e.check.chi_square, "tail_probability": e.check.tail_probability, "shift_tail": e.check.shift_tail}
    return graded(FAILURE, not e.check.agrees, NOTE), figures


def _say_checked(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.check is not None
    if not e.check.freedom:
        yield "there are no check points: what all control has in common, its datum above all, was not tested", {}
        return
    if not math.isfinite(e.check.chi_square):
        yield "the check points could not be compared: a difference is not a number", {}
        return
    tail = float(found["tail_probability"])
    figures = {"factor": e.check.factor, "degrees_of_freedom": e.check.freedom, "tail_probability": tail}
    times = f"{e.check.factor:.3g} times as large as the covariances of the answer, the points and their measurements predict"
    if e.check.agrees:
        chance = f"which is consistent (probability of more by chance: {probability(tail)})"
        yield f"the differences at the check points are {times}, {chance}", figures
        return
    pairs = list(zip(e.check.worst, e.check.worst_sigmas, strict=True))
    worst = ", ".join(f"{name} ({sigmas:.3g} sigma)" for name, sigmas in pairs)
    shifted = ""
    if e.check.shift_tail <= UNLIKELY:
        x, y, z = e.check.shift_m
        shifted = f"; a shift of all of them by {x:+.3g}, {y:+.3g}, {z:+.3g} m (world frame) would explain the most of it"
    yield (
        f"the check points contradict the answer: their differences are {times} (probability: {probability(tail)}); the worst "
        f"are {worst}{shifted}",
        figures | {"points": dict(pairs), "shift_m": list(e.check.shift_m)},
    )


CHECK_POINTS = Check("check points", _checked, _say_checked)


def _stretched(e: Evidence) -> Figures:
    if e.components is None:
        return np.asarray(FINE), {}
    doubtful = graded(CAUTION, e.components.is_doubtful.any())
    return graded(FAILURE, e.components.is_stretched.any(), doubtful), {"factor": e.components.factor}


def _say_stretched(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.components is not None
    stretched = e.components.is_stretched
    for g in np.flatnonzero(stretched if stretched.any() else e.components.is_doubtful).tolist():
        factor, name = float(e.components.factor[g]), e.components.names[g]
        large = factor > 1
        times, why = (factor, "look for blunders, or an error that many share, or state") if large else (1 / factor, "state")
        yield (
            f"the errors of {name} are {times:.3g} times {'larger' if large else 'smaller'} than their sigmas say: "
            + (
                f"beyond a factor of {STRETCHED:g} that is a finding, not a weight; {why} the sigma anew"
                if stretched[g]
                else "look why"
            ),
            {"group": name, "sigma_factor": factor},
        )


SIGMAS = Check("sigmas", _stretched, _say_stretched)


CHECKS = (
    ENDED, CHECK_POINTS, SIGMAS, COPIES, BESIDE, AGREEMENT, COMMON_ERRORS, *PATTERN_CHECKS, *SUSPECT_CHECKS, LEFT_OUT, LOPSIDED,
    KINKS, RANK, CORRELATION, PRIORS, FAR, TURNED, UNTESTED,
)  # fmt: skip
