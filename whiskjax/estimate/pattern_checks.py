"""Checks of residuals: what errors that nobody modelled would leave in them.

The sum of squares of all residuals says little of a few of them, and nothing once their sigmas were estimated. Here each
measurement, each group of them (image, strip, view, swing) and their course along time and over the image is asked by itself.
A finding is beyond chance, whichever of a family is found; it fails the answer where it also is of consequence: where it moved
what was estimated by more than a sigma, or sigmas by more than a tenth.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csc_array

from .evidence import Evidence, Grouping, Seen, seen_by
from .fitted import AbstractFitted, scores
from .model_test import FAMILY, chi_square_tail
from .reason import CAUTION, FAILURE, FINE, NOTE, Check, Figures, Said, about, graded, probability, several
from .score_family import MOVES, in_sigmas, judged_together, most_significant
from .wander import memories

_STRETCHES = 1.1  # a factor on sigmas
_FEWEST, _ORDERED = 3, 20  # measurements that make a group, and an order
_SMALL = 0.2  # of a sigma: residuals below that do no harm however they hang together
_DEGREES, _LAGS = 3, 3  # of polynomials; neighbours on either side
_CONTROLLED = 0.05  # of a measurement's redundancy: below it the others do not control it (Baarda), and it is not tested
_AXES = ("sample", "line")


def _single(e: Evidence) -> Figures:
    """The measurement that is the farthest from where the others put it, by its own covariance."""
    if e.fit is None or e.seen is None or not (used := _used(e.seen, e.fit)).any():
        return np.asarray(FINE), {}
    values, vectors = np.linalg.eigh(e.fit.left)
    seen = values > _CONTROLLED
    along = np.where(seen, np.einsum("nij,ni->nj", vectors, e.fit.residual), 0.0) / np.sqrt(np.where(seen, values, 1.0))
    squared = np.where(used, (along**2).sum(axis=1), 0.0)
    worst, count = int(squared.argmax()), int(used.sum())
    chance = count * chi_square_tail(squared[worst], 2)
    # External reliability: the part of its size that the fit took.
    size = vectors[worst] @ (along[worst] / np.sqrt(np.where(seen[worst], values[worst], 1.0)))
    moves = math.sqrt(max(float(size @ (np.eye(2) - e.fit.left[worst]) @ size), 0.0))
    grade = graded(FAILURE, (chance < FAMILY) & (moves > MOVES), graded(CAUTION, chance < FAMILY))
    return grade, {"measurement": worst, "sigmas": math.sqrt(squared[worst]), "moves": moves, "chance": chance}


def _say_single(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    label, sigmas, moves = seen_by(e).label(int(found["measurement"])), float(found["sigmas"]), float(found["moves"])
    yield (
        f"{label} lies {sigmas:.3g} sigma from where all else puts it, and moved the answer by {about(moves)} sigma: is it the "
        "right point?",
        {"measurement": label, "sigmas": sigmas, "moves": moves},
    )


SINGLE = Check("one measurement", _single, _say_single)


def _shifted(e: Evidence) -> Figures:
    """Groups whose residuals have a mean."""
    if e.fit is None or e.seen is None or not (found := list(_groups(e.seen, e.fit))):
        return np.asarray(FINE), {}
    return judged_together(scores(e.fit, *_constants([members for _, _, members in found])))


def _say_shifted(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.fit is not None
    groups = list(_groups(seen_by(e), e.fit))
    worst, *others = most_significant(found)
    kind, name, _ = groups[worst]
    x, y = found["size"][worst][:2]
    named = [f"{groups[i][0]} {groups[i][1]}" for i in others]
    more = f"; so are those of {several(named)}" if named else ""
    yield (
        f"the residuals of {kind} {name} are shifted by {x:+.2g} and {y:+.2g} px ({in_sigmas(found, worst)}): an error that all "
        f"of it shares{more}",
        {kind: name, "groups": [groups[i][1] for i in (worst, *others)], "shift_px": (float(x), float(y))},
    )


SHIFTED = Check("a group shifted", _shifted, _say_shifted)


def _sized(e: Evidence) -> Figures:
    """Groups whose residuals are larger than their sigmas say, and by more than a tenth."""
    if e.fit is None or e.seen is None:
        return np.asarray(FINE), {}
    members = [of for _, _, of in _groups(e.seen, e.fit, whole=True)]
    squares, freedom = (
        np.concatenate([*(of[group].sum(axis=0) for group in members), [getattr(held, name) for held in e.held]])
        for of, name in ((e.fit.residual**2, "squares"), (np.einsum("naa->na", e.fit.left), "freedom"))
    )
    if not len(squares):
        return np.asarray(FINE), {}
    asked = freedom > _FEWEST
    tail = np.array([chi_square_tail(s, f) if a else 1.0 for s, f, a in zip(squares, freedom, asked, strict=True)])
    factor = np.sqrt(np.where(asked, squares, 1.0) / np.where(asked, freedom, 1.0))
    bad = (tail * max(asked.sum(), 1) < FAMILY) & (factor > _STRETCHES)
    return graded(FAILURE, bad.any()), {"bad": bad, "factor": factor, "tail": tail}


def _say_sized(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.fit is not None
    groups = [(kind, name) for kind, name, _ in _groups(seen_by(e), e.fit, whole=True) for _ in _AXES]
    parts = [f"{kind} {name} along the {_AXES[i % 2]}" for i, (kind, name) in enumerate(groups)]
    groups, parts = groups + [("group", held.name) for held in e.held], parts + [held.name for held in e.held]
    order = [int(i) for i in np.argsort(-found["factor"]) if found["bad"][i]]
    kind, name = groups[order[0]]
    sizes = [f"{parts[i]} {found['factor'][i]:.3g}" for i in order]
    yield (
        f"residuals are larger than their sigmas say, more than chance explains (probability: "
        f"{probability(float(found['tail'][order[0]]))}), in some groups, by a factor: "
        f"{several(sizes)}",
        {kind: name, "groups": [groups[i][1] for i in order], "factor": float(found["factor"][order[0]])},
    )


SIZED = Check("a group too large", _sized, _say_sized)


def _bent(e: Evidence) -> Figures:
    """Whether residuals follow a polynomial along time or over the image."""
    if e.fit is None or e.seen is None or not (found := _courses(e.seen, e.fit)):
        return np.asarray(FINE), {}
    patterns = [_polynomials(value, members) for _, value, members in found]
    width = patterns[0].shape[1]
    return judged_together(
        scores(e.fit, np.concatenate(patterns, axis=1), [slice(i, i + width) for i in range(0, width * len(found), width)])
    )


def _say_bent(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.fit is not None
    along = [name for name, *_ in _courses(seen_by(e), e.fit)]
    worst, *others = most_significant(found)
    more = f", as along {several([along[i] for i in others])}" if others else ""
    yield (
        f"the residuals follow a curve along {along[worst]} ({in_sigmas(found, worst)}){more}: the model lacks something that "
        "changes with it",
        {"along": along[worst]},
    )


BENT = Check("a curve in the residuals", _bent, _say_bent)


def _wandering(e: Evidence) -> Figures:
    """Correlation of each residual with the next ones, along time and over the image."""
    if e.fit is None or e.seen is None or not (found := _courses(e.seen, e.fit)):
        return np.asarray(FINE), {}
    tail, correlation = (np.array(of) for of in zip(*(_neighbours(e.fit, v, m) for _, v, m in found), strict=True))
    bad = (tail.size * tail < FAMILY) & (_inflation(correlation) > _STRETCHES)
    return graded(FAILURE, bad.any()), {"bad": bad, "correlation": correlation}


def _neighbours(fit: AbstractFitted, value: Any, members: Any) -> tuple[list[float], list[float]]:
    """Of each axis and of both the chance of so much correlation of neighbours, and its size.

    Products of independent residuals have the mean 0 and the variance 1, whichever pairs they are made of; the fit makes their
    mean a little negative. What lasts shows between the next ones too: their products are added.
    """
    index = np.flatnonzero(members)[np.argsort(value[members], kind="stable")]
    scale = np.sqrt(np.maximum(np.einsum("naa->na", fit.left[index]), 1e-6))
    r = fit.residual[index] / scale
    r = r / np.maximum(np.sqrt((r**2).mean(axis=0)), _SMALL)
    by_lag = np.array([(r[lag:] * r[:-lag]).sum(axis=0) for lag in range(1, _LAGS + 1)])
    pairs = sum(len(index) - lag for lag in range(1, _LAGS + 1))
    x, y = by_lag.sum(axis=0) / math.sqrt(pairs)
    z = (x, y, (x + y) / math.sqrt(2))
    first, second = by_lag[0] / (len(index) - 1)
    tail = [0.5 * math.erfc(float(each) / math.sqrt(2)) for each in z]
    return tail, [first, second, (first + second) / 2]


def _inflation(correlation: Any) -> Any:
    """How much too small sigmas are where neighbours are correlated so, and farther ones by its powers."""
    rho = np.clip(correlation, -0.99, 0.99)
    return np.sqrt((1 + rho) / (1 - rho))


def _say_wandering(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.fit is not None
    names = [name for name, *_ in _courses(seen_by(e), e.fit)]
    rho = np.where(found["bad"], found["correlation"], -1.0)
    course, axis = np.unravel_index(int(rho.argmax()), rho.shape)
    most, name = float(rho.max()), names[course]
    figures: dict[str, Any] = {"along": name, "correlation": most}
    stated = _stated(e) if any(one == "time" and bad.any() for one, bad in zip(names, found["bad"], strict=True)) else []
    cure = ""
    if stated:
        figures |= {"frame": stated[0]["frame"], "correlation_s": stated[0]["correlation_s"], "errors": stated}
        parts = [
            f'FrameErrors("{one["frame"]}", ({", ".join(f"{s:.2g}" for s in one["turn_sigma_rad"])}), '
            f"correlation_s={one['correlation_s']:.2g})"
            for one in stated
        ]
        cure = f"; state them: errors=[{', '.join(parts)}]"
    which = ("of the sample", "of the line", "of both coordinates")[axis]
    yield (
        f"neighbours along {name} err alike (correlation {most:.2f} {which}): there are fewer independent {e.words.noun} than "
        f"counted, and sigmas come out too small by {float(_inflation(most)):.2g}{cure}",
        figures,
    )


def _stated(e: Evidence) -> list[dict[str, Any]]:
    """What `FrameErrors` takes, of each statement that would cure it: errors=[FrameErrors(**one) for one in these]."""
    if e.fit is None or e.suspects is None:
        return []
    time = np.asarray(seen_by(e).along["time"])
    found = memories(e.fit, e.suspects.motion_px[:, :, :3], time, _used(seen_by(e), e.fit) & np.isfinite(time))
    return [
        {"frame": e.suspects.frame, "turn_sigma_rad": (one.sigma_rad,) * 3, "correlation_s": one.correlation_s} for one in found
    ]


WANDERING = Check("residuals hang together", _wandering, _say_wandering)

PATTERN_CHECKS = (SINGLE, SHIFTED, SIZED, BENT, WANDERING)


def _untested(e: Evidence) -> Figures:
    """What the checks above could not look at."""
    if e.fit is None or e.seen is None:
        return np.asarray(FINE), {}
    used = _used(e.seen, e.fit)
    alone = used & (np.linalg.eigvalsh(e.fit.left)[:, 0] < _CONTROLLED)
    return graded(NOTE, bool(_not_followed(e.seen, e.fit) or _small(e.seen, used) or alone.any())), {"alone": alone}


def _not_followed(seen: Seen, fit: AbstractFitted) -> list[str]:
    """What residuals were not followed along: it is not known, or there are too few of them."""
    names = ["time"] * ("time" not in seen.along) + list(seen.along)
    known = {name for name, *_ in _courses(seen, fit)}
    return [name for name in names if name not in known]


def _small(seen: Seen, used: Bool[np.ndarray, " n"]) -> list[str]:
    """Groups of too few measurements, and kinds of which there is one group only."""
    found = []
    for grouping in seen.groups:
        count = np.bincount(grouping.index[used], minlength=len(grouping.names))
        there = np.flatnonzero(count)
        alone = len(there) == 1 and grouping.kind == "image"  # one strip is no strip
        found += [f"{grouping.kind} {grouping.names[i]}" for i in there if alone or count[i] < _FEWEST]
    return found


def _say_untested(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.fit is not None
    seen, alone = seen_by(e), [seen_by(e).label(int(i)) for i in np.flatnonzero(found["alone"])]
    along, groups = _not_followed(seen, e.fit), _small(seen, _used(seen, e.fit))
    parts = [f"residuals along {several(along)} (not known, or fewer than {_ORDERED} {e.words.noun})"] if along else []
    parts += [f"groups that are alone or have fewer than {_FEWEST} {e.words.noun} ({several(groups)})"] if groups else []
    parts += [f"{len(alone)} {e.words.noun} that no other controls ({several(alone)})"] if alone else []
    yield f"could not be tested: {'; '.join(parts)}", {"along": along, "groups": groups, "measurements": alone}


UNTESTED = Check("not tested", _untested, _say_untested)


def _used(seen: Seen, fit: AbstractFitted) -> Bool[np.ndarray, " n"]:
    """Measurements that decided and have a residual."""
    return np.asarray(seen.used) & np.isfinite(fit.residual).all(axis=1)


def _groups(seen: Seen, fit: AbstractFitted, whole: bool = False) -> Iterable[tuple[str, str, Bool[np.ndarray, " n"]]]:
    """Kind, name and members of each group; groups that are all of the measurements only where `whole` ones are asked for."""
    used = _used(seen, fit)
    told = set()
    for grouping in (*seen.groups, *((Grouping("all", np.zeros(len(used), dtype=int), ("measurements",)),) if whole else ())):
        for i, name in enumerate(grouping.names):
            members = used & (grouping.index == i)
            key = members.tobytes()
            if _FEWEST <= members.sum() and (whole or members.sum() < used.sum()) and key not in told:
                told.add(key)  # a strip of one image is that image
                yield grouping.kind, name, members


def _courses(seen: Seen, fit: AbstractFitted) -> list[tuple[str, Any, Bool[np.ndarray, " n"]]]:
    """What residuals may change with, and the measurements of which it is known."""
    used, found = _used(seen, fit), []
    for name, value in seen.along.items():
        members = used & np.isfinite(value)
        if members.sum() >= _ORDERED and len(np.unique(value[members])) > 2 * _DEGREES:
            found.append((name, np.asarray(value), members))
    return found


def _constants(groups: list[Bool[np.ndarray, " n"]]) -> tuple[Any, list[slice]]:
    """One pixel along either axis, of each group."""
    index = [np.flatnonzero(members) for members in groups]
    rows = np.concatenate([part for i in index for part in (2 * i, 2 * i + 1)])
    columns = np.concatenate([np.full(len(i), 2 * g + a) for g, i in enumerate(index) for a in range(2)])
    pattern = csc_array((np.ones(len(rows)), (rows, columns)), (2 * len(groups[0]), 2 * len(groups)))
    return pattern, [slice(2 * g, 2 * g + 2) for g in range(len(groups))]


def _polynomials(value: Float[np.ndarray, " n"], members: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "coordinates d"]:
    """Legendre's, from the first degree on, of a value scaled to -1 to 1; along either axis."""
    low, high = value[members].min(), value[members].max()
    scaled = np.where(members, 2 * (value - low) / (high - low) - 1, 0.0)
    each = np.polynomial.legendre.legvander(scaled, _DEGREES)[:, 1:] * members[:, None]
    return np.einsum("nd,ab->nadb", each, np.eye(2)).reshape(2 * len(value), -1)
