"""Checks of what was taken as known: numbers that nobody estimated, the pose of an image, and errors that stay silent."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from .evidence import Evidence, seen_by
from .fitted import Score, scores
from .model_test import FAMILY
from .reason import CAUTION, FAILURE, FINE, Check, Figures, Said, about, graded, several
from .score_family import MOVES, judged_together, most_significant

_LIKE = 0.9  # correlation of what two suspects leave in the residuals: the data cannot tell them apart
_NOTICED = 4.13  # sigmas: what a test at 0.1 % finds four times in five (Baarda)
_SILENT = 3  # numbers that are named
_FEWEST = 4  # measurements of an image whose pose is asked


def _suspected(e: Evidence) -> Figures:
    if (found := e.suspicions) is None:
        return np.asarray(FINE), {}
    beyond, moves = found.chance < FAMILY, np.abs(found.size) * found.taken
    grade = graded(FAILURE, (beyond & (moves > MOVES)).any(), graded(CAUTION, beyond.any()))
    return grade, {
        "sigmas": found.sigmas, "size": found.size, "sigma": found.sigma, "moves": moves, "found": beyond, "like": found.like,
    }  # fmt: skip


def _say_suspected(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.suspects is not None
    of = e.suspects
    order = [int(i) for i in np.argsort(-np.abs(found["sigmas"])) if found["found"][i]]
    first = order[0]
    alike = [i for i in order if found["like"][first, i] > _LIKE]
    others = [of.names[i] for i in order if i not in alike]
    parts = [
        f"{of.names[i]} off by {found['size'][i] * of.usual[i] * of.units[i].factor:+.3g} +- "
        f"{found['sigma'][i] * of.usual[i] * of.units[i].factor:.2g} {of.units[i].name}"
        for i in alike[:4]
    ]
    more = f"; or, less well, {several(others[:5])}" if others else ""
    yield (
        f"the residuals would be explained by {' or '.join(parts)} ({abs(float(found['sigmas'][first])):.3g} sigma), which moved "
        f"the answer by {about(float(found['moves'][first]))}{more}",
        {"numbers": [of.names[i] for i in alike], "others": others, "sigmas": float(found["sigmas"][first])},
    )


SUSPECTS = Check("a number taken as known", _suspected, _say_suspected)


def _silent(e: Evidence) -> Figures:
    """Errors of usual size that move the answer, and of which the residuals would say nothing."""
    if (found := e.suspicions) is None:
        return np.asarray(FINE), {}
    is_silent = (found.taken > MOVES) & (1 / found.sigma < _NOTICED)
    return graded(CAUTION, is_silent.any()), {"silent": np.where(is_silent, found.taken, 0.0)}


def _say_silent(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.suspects is not None
    of = e.suspects
    told = np.array([float(f"{moves:.2g}") for moves in found["silent"]])  # as it is told: what is the same stays in its order
    order = [int(i) for i in np.argsort(-told, kind="stable")[:_SILENT] if told[i] > 0]
    parts = [
        f"{of.usual[i] * of.units[i].factor:.2g} {of.units[i].name} of {of.names[i]} by {about(float(found['silent'][i]))} sigma"
        for i in order
    ]
    yield (
        f"errors that the data could not show would move the answer: {', '.join(parts)}",
        {"numbers": [of.names[i] for i in order], "moves": [float(found["silent"][i]) for i in order]},
    )


SILENT = Check("silent errors", _silent, _say_silent)


def _posed(e: Evidence) -> Figures:
    """Whether one image's pose, freed, would explain the residuals."""
    if e.fit is None or e.suspects is None or not (members := _images(e)):
        return np.asarray(FINE), {}
    return judged_together(_poses(e, members))


def _poses(e: Evidence, members: list[tuple[str, np.ndarray]]) -> list[Score]:
    assert e.fit is not None and e.suspects is not None
    motion = e.suspects.motion_px
    index = [np.flatnonzero(of) for _, of in members]
    rows = np.concatenate([np.repeat(2 * i[:, None] + np.arange(2), 6) for i in index])
    columns = np.concatenate([np.tile(6 * g + np.arange(6), 2 * len(i)) for g, i in enumerate(index)])
    values = np.concatenate([motion[i].ravel() for i in index])
    pattern = csc_array((values, (rows, columns)), (2 * len(motion), 6 * len(index)))
    return scores(e.fit, pattern, [slice(6 * g, 6 * g + 6) for g in range(len(index))])


def _images(e: Evidence) -> list[tuple[str, np.ndarray]]:
    """Images with enough measurements, of two or more."""
    seen, found = seen_by(e), []
    grouping = next((one for one in seen.groups if one.kind == "image"), None)
    if grouping is None:
        return []
    used = np.asarray(seen.used)
    for i, name in enumerate(grouping.names):
        members = used & (grouping.index == i)
        if _FEWEST <= members.sum() < used.sum():
            found.append((name, members))
    return found


def _say_posed(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    names = [name for name, _ in _images(e)]
    order = most_significant(found)
    worst = order[0]
    turn, shift = np.degrees(found["size"][worst][:3]), found["size"][worst][3:]
    others = [names[i] for i in order[1:]]
    more = f"; next {several(others)}" if others else ""
    yield (
        f"image {names[worst]}: a pose of its own would explain its residuals ({math.sqrt(float(found['statistic'][worst])):.3g} "
        f"sigma; turned by {turn[0]:+.2g}, {turn[1]:+.2g}, {turn[2]:+.2g} deg, shifted by {shift[0]:+.2g}, {shift[1]:+.2g}, "
        f"{shift[2]:+.2g} m){more}",
        {"image": names[worst], "images": [names[i] for i in order]},
    )


POSED = Check("one pose", _posed, _say_posed)

SUSPECT_CHECKS = (SUSPECTS, POSED, SILENT)
