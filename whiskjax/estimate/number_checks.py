"""Checks of the numbers: what the data alone determine, what only priors hold, what cannot be told apart, and kinks of delays."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..rules import arrays_of
from .evidence import Evidence
from .far_turns import FarTurn
from .model_test import FAMILY, chi_square_bound
from .posterior import directions, rank_of
from .reason import CAUTION, FAILURE, FINE, Check, Figures, Said, about, graded, several

PRIOR_ONLY = 0.05  # of the prior variance: data that took less of it away said nothing new
CORRELATED, INSEPARABLE = 0.9, 0.95
_MOSTLY_DATA, _FAR = 0.5, 3.0  # of the prior variance; prior sigmas
# Of the prior variance: a number that the data move by less than a tenth of its prior sigma is moved as much by what is of second
# order, and says nothing of its prior (looks at a target whose distance is hardly observable).
_MOVABLE = 1e-2
_LISTED = 6  # names


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
    """Numbers that ended where their prior hardly lets them.

    Where the prior is right the answer lies by N(0, 1 - C) off its mean, C what the data left of its variance. What is considered
    adds to that. A prior that is wrong moved its number by C / (1 - C) of the distance, and others by fewer of their sigmas.
    """
    math_ = arrays_of((e.shift, e.estimate.prior_share))
    share = math_.asarray(e.estimate.prior_share)
    spread = 1 - share + e.widened
    there = e.estimated & math_.isfinite(e.shift) & (spread > _MOVABLE)
    spread, shift = math_.where(there, spread, 1.0), math_.where(there, e.shift, 0.0)
    far = e.estimated & (abs(e.shift) > _FAR)
    beyond = (shift**2 / spread > chi_square_bound(FAMILY / max(len(e.estimate.names), 1), 1)) & there
    moves = math_.sqrt(math_.where(there, share, 0.0)) * abs(shift) / spread
    grade = graded(FAILURE, (beyond & (moves > 1)).any(), graded(CAUTION, far.any()))
    return grade, {"shift": e.shift, "contradicted": beyond & (moves > 1), "moves": moves}


def _say_far(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    names, wrong = e.estimate.names, np.flatnonzero(found["contradicted"])
    if wrong.size:
        of = {names[i]: float(found["shift"][i]) for i in wrong}
        parts = ", ".join(
            f"{names[i]} (by {abs(of[names[i]]):.3g} prior sigmas; it moved it by {about(float(found['moves'][i]))} of its)"
            for i in wrong
        )
        yield f"the data contradict the prior of {parts}: one of the two is wrong", {"sigmas": of}
        return
    index = np.flatnonzero(np.asarray(e.estimated) & (np.abs(found["shift"]) > _FAR))
    shift = {e.estimate.names[i]: float(found["shift"][i]) for i in index}
    parts = ", ".join(f"{name} {abs(value):.1f}" for name, value in shift.items())
    yield f"ended far from the prior mean, in prior sigmas: {parts}", {"sigmas": shift}


FAR = Check("far from the prior", _far, _say_far)


def _turned(e: Evidence) -> Figures:
    return np.asarray(CAUTION if e.turned else FINE), {}


def _say_turned(_: dict[str, Any], e: Evidence) -> Iterable[Said]:
    """All in one line, and of each mount the axes that would leave it small."""
    parts = [f"{turn.name} by {math.degrees(turn.angle_rad):+.4g} deg" for turn in e.turned]
    cures = list(dict.fromkeys(_cure(turn) for turn in e.turned if turn.axes is not None))
    more = f"; {' and '.join(cures)} would leave {'it' if len(parts) == 1 else 'them'} small" if cures else ""
    yield (
        f"ended far from where it started: {several(parts)}{more}: do the axes lie as the sensor says?",
        {
            "numbers": [turn.name for turn in e.turned],
            "angle_deg": [math.degrees(turn.angle_rad) for turn in e.turned],
            "axes": {turn.frame: turn.axes for turn in e.turned if turn.axes is not None},
        },
    )


def _cure(turn: FarTurn) -> str:
    if turn.is_new:
        return f'a link of axes = "{turn.axes}" before {turn.frame}'
    return f'axes = "{turn.axes}" of {turn.frame}'


TURNED = Check("far from the start", _turned, _say_turned)


def _correlated(e: Evidence) -> Figures:
    math_, estimated = arrays_of(e.estimate.covariance), np.asarray(e.estimated)
    known = e.estimate.sigma > 0
    sigma = math_.where(known, math_.where(known, e.estimate.sigma, 1.0), math.inf)
    both = np.outer(estimated, estimated) & ~np.eye(len(estimated), dtype=bool)
    rho = math_.where(both, math_.nan_to_num(e.estimate.covariance) / math_.outer(sigma, sigma), 0.0)
    return graded(CAUTION, (abs(rho) > CORRELATED).any()), {"correlation": rho}


def _say_correlated(found: dict[str, Any], e: Evidence) -> Iterable[Said]:
    """Groups that hang together by strong correlations, in one line, the strongest first."""
    rho, names = found["correlation"], e.estimate.names
    told = []
    for group in _groups(abs(rho) > CORRELATED):
        within = rho[np.ix_(group, group)]
        told.append((float(within.ravel()[np.abs(within).argmax()]), [names[i] for i in group]))
    told.sort(key=lambda one: -abs(one[0]))
    parts = []
    for most, named in told:
        kind = "cannot be told apart" if abs(most) > INSEPARABLE else "are strongly correlated"
        listed = several(named) if len(named) > _LISTED else f"{', '.join(named[:-1])} and {named[-1]}"
        parts.append(f"{listed} {kind}: {'correlation' if len(named) == 2 else 'correlations up to'} {most:+.3f}")
    most, named = told[0]
    yield "; ".join(parts), {"unknowns": named, "correlation": most, "groups": [members for _, members in told]}


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
