"""Checks of measurements: what was left out and where from, copies, and what lies far beside the detector."""

from collections.abc import Iterable
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..rules import arrays_of
from .evidence import Evidence, seen_by
from .reason import CAUTION, FAILURE, FINE, Check, Figures, Said, graded, several

_LOPSIDED = 0.3  # of an image's measurements
_MANY = 0.1  # of the measurements: as copies they make sigmas too small by a twentieth
_BESIDE = 32  # measurements, in the order of one coordinate, among which copies are looked for


def _left_out(e: Evidence) -> Figures:
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    count, there = (which.sum(dtype=float) for which in (seen.outlying, seen.candidate))
    return graded(FAILURE, count > seen.most * there, graded(CAUTION, count > 0)), {"count": count, "of": there}


def _say_left_out(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = seen_by(e)
    count, there = int(found["count"]), int(found["of"])
    named = [seen.label(int(i)) for i in np.flatnonzero(seen.outlying)]
    too_many = f": more than {seen.most:.0%}, so that the others may be the wrong ones" if count > seen.most * there else ""
    yield (
        f"{count} of {there} {e.words.outliers}{too_many}: {several(named)}",
        {"count": count, "of": there, "measurements": named},
    )


LEFT_OUT = Check("left out", _left_out, _say_left_out)


def _lopsided(e: Evidence) -> Figures:
    """Measurements of one image that were left out: if many agree with one another, the others may be the wrong ones."""
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    lost, there = (_count(which, seen.image, len(seen.images)) for which in (seen.outlying, seen.candidate))
    wrong = (lost > _LOPSIDED * there) & (len(seen.images) > 1)
    return graded(CAUTION, wrong.any()), {"lost": lost, "of": there}


def _count(which: Any, group: Any, groups: int) -> Any:
    """How many of each group."""
    if arrays_of(which) is np:
        return np.bincount(group, weights=which, minlength=groups)
    return jnp.bincount(group, weights=which.astype(float), length=groups)


def _say_lopsided(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = seen_by(e)
    for image in np.flatnonzero(found["lost"] > _LOPSIDED * found["of"]).tolist():
        lost, there, name = int(found["lost"][image]), int(found["of"][image]), seen.images[image]
        yield (
            f"{lost} of {there} {e.words.noun}{name and f' of image {name}'} were left out as wrong: if they agree with one "
            "another, the others may be the wrong ones",
            {"image": name, "count": lost, "of": there},
        )


LOPSIDED = Check("one image", _lopsided, _say_lopsided)


def _copies(e: Evidence) -> Figures:
    """Measurements that are copies, or as good as: sorted by the last entry of their records, each beside the next ones."""
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    math_ = arrays_of((seen.record, seen.used))
    order = math_.lexsort((seen.record[:, -1], ~seen.used))
    copies = math_.zeros(len(order), dtype=bool)
    rows, used = seen.record[order], seen.used[order]
    for away in range(1, min(_BESIDE, len(rows))):
        same = (abs(rows[away:] - rows[:-away]) < 1).all(axis=1) & used[away:]
        copies = copies | math_.concatenate([np.zeros(away, dtype=bool), same])
    count, whole = copies.sum(dtype=float), seen.used.sum(dtype=float)
    return graded(FAILURE, count > _MANY * whole, graded(CAUTION, count > 0)), {"copies": count, "of": whole}


def _say_copies(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = seen_by(e)
    index = np.flatnonzero(seen.used)
    index = index[np.argsort(seen.record[index, -1], kind="stable")]
    rows, copied = seen.record[index], np.zeros(len(index), dtype=bool)
    times: dict[int, int] = {}
    ends = np.searchsorted(rows[:, -1], rows[:, -1] + 1)
    for i, row in enumerate(rows):
        like = i + 1 + np.flatnonzero((abs(rows[i + 1 : ends[i]] - row) < 1).all(axis=1)) if not copied[i] else []
        copied[like] = True
        if len(like):
            times[int(index[i])] = 1 + len(like)
    groups = [(seen.label(i), times[i]) for i in sorted(times)]
    label, c = groups[0]
    more = f", and {len(groups) - 1} more have copies" if len(groups) > 1 else ""
    yield (
        f"{label} is given {c} times{more}: copies count as independent measurements, so sigmas come out too small",
        {"measurements": [name for name, _ in groups], "times": [c for _, c in groups]},
    )


COPIES = Check("copies", _copies, _say_copies)


def _beside(e: Evidence) -> Figures:
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    return graded(CAUTION, seen.beside.any()), {"count": seen.beside.sum(), "first": seen.beside.argmax()}


def _say_beside(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = seen_by(e)
    label, count = seen.label(int(found["first"])), int(found["count"])
    more = f" ({count} of {len(seen.used)} do)" if count > 1 else ""
    yield (
        f"{label} lies far beside the detector{more}: are line and sample exchanged, does a number stand for missing data, or "
        "has the detector another size?",
        {"measurement": label, "count": count},
    )


BESIDE = Check("beside the detector", _beside, _say_beside)
