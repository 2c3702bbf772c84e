"""The checks that every answer passes through, whichever verb gave it; each is `figures` (traceable) and `sentences` (people).

A new check stands here once, and serves calibrations, blocks and targets alike.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..rules import arrays_of
from ..rules.results import codes_of, message_of
from .evidence import Evidence, Seen
from .model_test import UNLIKELY
from .posterior import directions, rank_of
from .reason import CAUTION, FAILURE, FINE, NOTE, Check, Said, judged
from .variance_components import STRETCHED

PRIOR_ONLY = 0.05  # of the prior variance: data that took less of it away said nothing new
CORRELATED, INSEPARABLE = 0.9, 0.95
_MOSTLY_DATA, _FAR, _LOPSIDED, _SMALL = 0.5, 3.0, 0.3, 0.5
_NAMED = 10

Figures = tuple[Any, dict[str, Any]]


def graded(grade: int, where: Any, otherwise: Any = FINE) -> Any:
    """A grade where a condition holds."""
    return arrays_of((where, otherwise)).where(where, grade, otherwise)


def several(names: Sequence[str]) -> str:
    """Names in a row: the first ten, and how many there are."""
    return ", ".join(names[:_NAMED]) + (f", ... ({len(names)})" if len(names) > _NAMED else "")


def probability(p: float) -> str:
    """A probability for people: below a millionth its exact size says nothing."""
    return f"{p:.2g}" if p >= 1e-6 else "below 1e-6"


def _seen(e: Evidence) -> Seen:
    """The measurements, of which a check found something."""
    assert e.seen is not None
    return e.seen


def _ended(e: Evidence) -> Figures:
    code, where = codes_of(e.estimate.result), np.zeros(1, dtype=int) if e.seen is None else codes_of(e.seen.code)
    grade = graded(FAILURE, (code != 0) | (where != 0).any(), NOTE)
    return grade, {"code": code, "fail": (where != 0).sum(), "first": (where != 0).argmax()}


def _say_ended(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    code, where = int(found["code"]), codes_of(_seen(e).code)
    if code and code not in where:
        lost = [n for n, s in zip(e.estimate.names, e.estimate.sigma, strict=True) if not np.isfinite(s)]
        yield f"{message_of(code)}{': ' * bool(lost)}{several(lost)}", {"code": code, "unknowns": lost}
    if (count := int(found["fail"])) > 0:
        i, label = int(found["first"]), _seen(e).label(int(found["first"]))
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
    if freedom <= 0:
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
    tail = e.check.tail_probability
    return graded(FAILURE, not tail > UNLIKELY, NOTE), {"chi_square": e.check.chi_square, "tail_probability": tail}


def _say_checked(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.check is not None
    if not e.check.freedom:
        yield "there are no check points: nothing tests the answer from outside", {}
        return
    if not math.isfinite(e.check.chi_square):
        yield "the check points could not be compared: a difference is not a number", {}
        return
    tail = float(found["tail_probability"])
    figures = {"factor": e.check.factor, "degrees_of_freedom": e.check.freedom, "tail_probability": tail}
    times = f"{e.check.factor:.3g} times as large as the covariance of the answer, their own and their measurements' say"
    if e.check.agrees:
        chance = f"which is consistent (probability of more by chance: {probability(tail)})"
        yield f"the differences at the check points are {times}, {chance}", figures
        return
    pairs = list(zip(e.check.worst, e.check.worst_sigmas, strict=True))
    worst = ", ".join(f"{name} ({sigmas:.3g} sigma)" for name, sigmas in pairs)
    yield (
        f"the check points contradict the answer: their differences are {times} (probability: {probability(tail)}); the worst "
        f"are {worst}",
        figures | {"points": dict(pairs)},
    )


CHECK_POINTS = Check("check points", _checked, _say_checked)


def _stretched(e: Evidence) -> Figures:
    if e.components is None:
        return np.asarray(FINE), {}
    return graded(FAILURE, e.components.is_stretched.any()), {"factor": e.components.factor}


def _say_stretched(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.components is not None
    for g in np.flatnonzero(e.components.is_stretched).tolist():
        factor, name = float(e.components.factor[g]), e.components.names[g]
        large = factor > 1
        times, why = (factor, "look for blunders, or an error that many share, or state") if large else (1 / factor, "state")
        yield (
            f"the errors of {name} are {times:.3g} times {'larger' if large else 'smaller'} than their sigmas say: beyond a "
            f"factor of {STRETCHED:g} that is a finding, not a weight; {why} the sigma anew",
            {"group": name, "sigma_factor": factor},
        )


SIGMAS = Check("sigmas", _stretched, _say_stretched)


def _left_out(e: Evidence) -> Figures:
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    count, there = (which.sum(dtype=float) for which in (seen.outlying, seen.candidate))
    return graded(FAILURE, count > seen.most * there, graded(CAUTION, count > 0)), {"count": count, "of": there}


def _say_left_out(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = _seen(e)
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
    seen = _seen(e)
    for image in np.flatnonzero(found["lost"] > _LOPSIDED * found["of"]).tolist():
        lost, there, name = int(found["lost"][image]), int(found["of"][image]), seen.images[image]
        yield (
            f"{lost} of {there} {e.words.noun}{name and f' of image {name}'} were left out as wrong: if they agree with one "
            "another, the others may be the wrong ones",
            {"image": name, "count": lost, "of": there},
        )


LOPSIDED = Check("one image", _lopsided, _say_lopsided)


def _copies(e: Evidence) -> Figures:
    """Measurements that are copies: sorted, each equals the one before."""
    if (seen := e.seen) is None:
        return np.asarray(FINE), {}
    math_ = arrays_of((seen.record, seen.used))
    order = math_.lexsort((*seen.record.T, ~seen.used))
    rows, used = seen.record[order], seen.used[order]
    copies = ((rows[1:] == rows[:-1]).all(axis=1) & used[1:]).sum()
    return graded(CAUTION, copies > 0), {"copies": copies}


def _say_copies(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    seen = _seen(e)
    index = np.flatnonzero(seen.used)
    _, first, count = np.unique(seen.record[index], axis=0, return_index=True, return_counts=True)
    groups = [(seen.label(int(index[i])), int(c)) for i, c in zip(first, count, strict=True) if c > 1]
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
    seen = _seen(e)
    label, count = seen.label(int(found["first"])), int(found["count"])
    more = f" ({count} of {len(seen.used)} do)" if count > 1 else ""
    yield (
        f"{label} lies far beside the detector{more}: are line and sample exchanged, does a number stand for missing data, or "
        "has the detector another size?",
        {"measurement": label, "count": count},
    )


BESIDE = Check("beside the detector", _beside, _say_beside)


def _rank(e: Evidence) -> Figures:
    """What the data alone determine: structural rank, and unknowns on which nothing depends."""
    if e.rows is None or not e.estimate.names:
        return np.asarray(FINE), {}
    found = rank_of(e.rows)
    return graded(CAUTION, found.rank < len(found.length)), {"rank": found.rank, "untouched": (e.rows == 0).all(axis=0)}


def _say_rank(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    assert e.rows is not None
    names, rank = e.estimate.names, int(found["rank"])
    untouched = [names[i] for i in np.flatnonzero(found["untouched"])]
    if untouched:
        yield f"no {e.words.observed} depends on {', '.join(untouched)}", {"unknowns": untouched}
    unit = dict(zip(names, e.estimate.units, strict=True))
    for move in directions(rank_of(e.rows), np.asarray(e.scale), names):
        if not set(move) <= set(untouched):
            parts = ", ".join(f"{value * unit[name].factor:+.2g} {unit[name].name} {name}" for name, value in move.items())
            yield (
                f"the data alone do not determine {', '.join(move)}: moving by {parts} together changes no residual",
                {"unknowns": list(move), "move": move},
            )
    well = [name for name, share in zip(names, e.estimate.prior_share, strict=True) if share < 1 - _MOSTLY_DATA]
    which = f"mostly from the data come {', '.join(well)}" if well else "no unknown comes mostly from the data"
    yield (
        f"the data alone determine {rank} of {len(names)} combinations of the unknowns; {which}",
        {"rank": rank, "from_data": well},
    )


RANK = Check("rank", _rank, _say_rank)


def _prior_only(e: Evidence) -> Figures:
    held = e.estimated & (e.estimate.prior_share > 1 - PRIOR_ONLY)
    return graded(CAUTION, held.any()), {"held": held}


def _say_prior_only(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    named = [e.estimate.names[i] for i in np.flatnonzero(found["held"])]
    yield (
        f"fixed by {'their priors' if len(named) > 1 else 'its prior'} alone, as the data took less than {PRIOR_ONLY:.0%} of the "
        f"prior variance away: {', '.join(named)}",
        {"unknowns": named},
    )


PRIORS = Check("prior alone", _prior_only, _say_prior_only)


def _far(e: Evidence) -> Figures:
    far = e.estimated & (abs(e.shift) > _FAR)
    return graded(CAUTION, far.any()), {"shift": e.shift}


def _say_far(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    index = np.flatnonzero(np.asarray(e.estimated) & (np.abs(found["shift"]) > _FAR))
    shift = {e.estimate.names[i]: float(found["shift"][i]) for i in index}
    parts = ", ".join(f"{name} {abs(value):.1f}" for name, value in shift.items())
    yield f"ended far from the prior mean, in prior sigmas: {parts}", {"sigmas": shift}


FAR = Check("far from the prior", _far, _say_far)


def _correlated(e: Evidence) -> Figures:
    math_, estimated = arrays_of(e.estimate.covariance), np.asarray(e.estimated)
    known = e.estimate.sigma > 0
    sigma = math_.where(known, math_.where(known, e.estimate.sigma, 1.0), math.inf)
    both = np.outer(estimated, estimated) & ~np.eye(len(estimated), dtype=bool)
    rho = math_.where(both, math_.nan_to_num(e.estimate.covariance) / math_.outer(sigma, sigma), 0.0)
    return graded(CAUTION, (abs(rho) > CORRELATED).any()), {"correlation": rho}


def _say_correlated(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    """Groups that hang together by strong correlations, the strongest first."""
    rho, names = found["correlation"], e.estimate.names
    for group in _groups(abs(rho) > CORRELATED):
        within = rho[np.ix_(group, group)]
        most = float(within.ravel()[np.abs(within).argmax()])
        named = [names[i] for i in group]
        kind = "cannot be told apart" if abs(most) > INSEPARABLE else "are strongly correlated"
        upto = "correlation" if len(group) == 2 else "correlations up to"
        yield f"{', '.join(named[:-1])} and {named[-1]} {kind}: {upto} {most:+.3f}", {"unknowns": named, "correlation": most}


def _groups(tied: Any) -> list[list[int]]:
    """Sets of two or more that are tied to one another, directly or by others."""
    reach = tied | np.eye(len(tied), dtype=bool)
    for _ in range(len(tied)):
        reach = reach @ reach
    sets = dict.fromkeys(tuple(np.flatnonzero(row).tolist()) for row in reach)
    return [list(members) for members in sets if len(members) > 1]


CORRELATION = Check("correlation", _correlated, _say_correlated)


def _kinked(e: Evidence) -> Figures:
    return np.asarray(CAUTION if e.kinks else FINE), {}


def _say_kinked(_: dict[str, Any], e: Evidence) -> Iterable[Said]:
    for name, where in e.kinks:
        yield (
            f"{name}: {where} is interpolated linearly, so the cost has a kink wherever a shot passes a sample, and noise of the "
            'record pulls on the delay; give it interpolation = "cubic"',
            {"unknown": name, "link": where},
        )


KINKS = Check("kinks", _kinked, _say_kinked)

CHECKS = (
    ENDED, CHECK_POINTS, SIGMAS, COPIES, AGREEMENT, LEFT_OUT, BESIDE, LOPSIDED, KINKS, RANK, CORRELATION, PRIORS, FAR,
)  # fmt: skip
