"""Checks of what was taken as known: numbers that nobody estimated, the pose of an image, and errors that stay silent."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool
from scipy.sparse import csc_array

from .evidence import Evidence, seen_by
from .fitted import Score, scores
from .model_test import FAMILY
from .reason import CAUTION, FAILURE, FINE, Check, Figures, Said, about, graded, several
from .score_family import MOVES, judged_together, most_significant
from .suspects import DATUM, Suspects
from .unknown import Unit

_LIKE = 0.9  # correlation of what two suspects leave in the residuals: the data cannot tell them apart
_NOTICED = 4.13  # sigmas: what a test at 0.1 % finds four times in five (Baarda)
_SILENT, _ALIKE = 3, 2  # things that are named, and numbers of each
_FEWEST = 4  # measurements of an image whose pose is asked
_POSED, _ALL = ("image", "strip"), "frame"  # kinds of groups


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
        + _shown(found["sigma"][i] * of.usual[i], of.units[i])
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
    """Errors of usual size, of what was taken as exact, that move the answer, and of which the residuals would say nothing."""
    if (found := e.suspicions) is None:
        return np.asarray(FINE), {}
    is_silent = (found.taken > MOVES) & (1 / found.sigma < _NOTICED)
    return graded(CAUTION, is_silent.any()), {"silent": np.where(is_silent, found.taken, 0.0), "same": found.same}


def _say_silent(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.suspects is not None
    of, parts, told = e.suspects, [], _together(found, e.suspects)
    for members in told:
        kin = of.kin[members[0]]
        # Of what has components, the largest of each unit; of numbers of a link, or that do the same to the answer, each.
        shown = [next(i for i in members if of.units[i] is unit) for unit in dict.fromkeys(of.units[i] for i in members)]
        sizes = [_shown(of.usual[i], of.units[i]) for i in (shown if kin else members)]
        each = [f"{size} of {of.names[i]}" for size, i in zip(sizes, members, strict=not kin)]
        named = f"{' or '.join(sizes)} of the {kin}" if kin else " or ".join(each[:_ALIKE])
        parts.append(f"{named} by {about(float(found['silent'][members[0]]))} sigma")
    yield (
        f"taken as exact, though errors of it would not show and would move the answer: {'; '.join(parts)}",
        {
            "numbers": [of.names[members[0]] for members in told],
            "moves": [float(found["silent"][members[0]]) for members in told],
            "alike": [[of.names[i] for i in members] for members in told],
        },
    )


def _shown(size: float, unit: Unit) -> str:
    """With its unit, if it has one."""
    return f"{size * unit.factor:.2g}{'' if unit.name == '1' else f' {unit.name}'}"


def _together(found: dict[str, Any], of: Suspects) -> list[list[int]]:
    """Suspects that do the same to the answer, or are numbers of one thing, what moves it the most first; three at most.

    The datum is one of them wherever it counts: of all numbers it alone is none of the instrument, and no check point tells it.
    """
    silent = np.array([float(f"{moves:.2g}") for moves in found["silent"]])  # as it is told: what is the same stays in its order
    left, groups = [int(i) for i in np.argsort(-silent, kind="stable") if silent[i] > 0], []
    while left:
        first, whole = left[0], [of.kin[i] or of.names[i].split(".")[0] for i in range(len(of.names))]
        alike = found["same"][first] > _LIKE if not of.kin[first] else np.zeros(len(whole), dtype=bool)
        group = [i for i in left if whole[i] == whole[first] or (alike[i] and not of.kin[i])]
        groups.append(group)
        left = [i for i in left if i not in group]
    datum = [group for group in groups[_SILENT:] if of.kin[group[0]] == DATUM]
    return groups[: _SILENT - len(datum)] + datum


SILENT = Check("silent errors", _silent, _say_silent)


class Group(NamedTuple):
    """Measurements that may have an error of the pose in common."""

    kind: str
    name: str
    members: Bool[np.ndarray, " n"]


def _posed(e: Evidence) -> Figures:
    """Whether the pose of an image, a strip or all, freed, would explain the residuals."""
    if e.fit is None or e.suspects is None or not (members := _posed_together(e)):
        return np.asarray(FINE), {}
    return judged_together(_poses(e, members))


def _poses(e: Evidence, members: list[Group]) -> list[Score]:
    assert e.fit is not None and e.suspects is not None
    of, index = e.suspects, [np.flatnonzero(group.members) for group in members]
    # A shift that images with other headings share is one of the world's axes.
    everywhere = np.concatenate([of.motion_px[:, :, :3], -of.place_px], axis=2)
    rows = np.concatenate([np.repeat(2 * i[:, None] + np.arange(2), 6) for i in index])
    columns = np.concatenate([np.tile(6 * g + np.arange(6), 2 * len(i)) for g, i in enumerate(index)])
    moved = [everywhere if group.kind == _ALL else of.motion_px for group in members]
    values = np.concatenate([motion[i].ravel() for i, motion in zip(index, moved, strict=True)])
    pattern = csc_array((values, (rows, columns)), (2 * len(of.motion_px), 6 * len(index)))
    return scores(e.fit, pattern, [slice(6 * g, 6 * g + 6) for g in range(len(index))])


def _posed_together(e: Evidence) -> list[Group]:
    """Images and strips with enough measurements, of two or more, and all measurements."""
    seen, found, told = seen_by(e), [], set()
    used = np.asarray(seen.used)
    for grouping in seen.groups:
        for i, name in enumerate(grouping.names if grouping.kind in _POSED else ()):
            members = used & (grouping.index == i)
            if _FEWEST <= members.sum() < used.sum() and members.tobytes() not in told:
                told.add(members.tobytes())  # a strip of one image is that image
                found.append(Group(grouping.kind, name, members))
    return [*found, Group(_ALL, e.suspects.frame, used)] if e.suspects is not None and used.sum() >= _FEWEST else found


def _say_posed(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    groups, order = _posed_together(e), most_significant(found)
    kind, name, _ = groups[order[0]]
    turn, shift = np.degrees(found["size"][order[0]][:3]), found["size"][order[0]][3:]
    others = [f"{groups[i].kind} {groups[i].name}" for i in order[1:]]
    more = f"; next {several(others)}" if others else ""
    sizes = f"turned by {turn[0]:+.2g}, {turn[1]:+.2g}, {turn[2]:+.2g} deg, shifted by {shift[0]:+.2g}, {shift[1]:+.2g}, "
    sizes += f"{shift[2]:+.2g} m{' (world frame)' if kind == _ALL else ''}"
    whose = f"one error of all poses of {name}" if kind == _ALL else f"{kind} {name}: a pose of its own"
    yield (
        f"{whose} would explain {'the' if kind == _ALL else 'its'} residuals "
        f"({math.sqrt(float(found['statistic'][order[0]])):.3g} sigma; {sizes}){more}",
        {kind: name, "groups": [groups[i].name for i in order]},
    )


POSED = Check("one pose", _posed, _say_posed)

SUSPECT_CHECKS = (SUSPECTS, POSED, SILENT)
