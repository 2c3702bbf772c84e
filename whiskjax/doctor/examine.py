"""Examine a flight: try what people get wrong, one by one, and find what explains its measurements."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from ..flights.flight import Flight
from ..rules import FlightError, need, require_x64
from ..rules.progress import tell
from .conventions import conventions
from .diagnosis import ALIKE, NOISE, Diagnosis, Finding
from .point_remedies import chosen, wrong_ones
from .remedy import AS_GIVEN, Remedy
from .robust import loss
from .trial import LEFT_OUT, Trial, attempt, how_far

# Measurements that are looked at: more of them cost time, and tell no more of what is wrong with all.
MOST_OBSERVATIONS = 1200
_FIRST_STEPS, _LAST_STEPS = 12, 60
_REFINED, _SUSPECTS, _PAIRED = 12, 4, 3
_PRIOR_SIGMAS = 5.0


def examine(flight: Flight, *, told: int = 8) -> Diagnosis:
    """Find out what is wrong with a flight whose measurements do not fit.

    Everything that people get wrong (conventions.py) is undone, one at a time: signs and orders of angles, axes, image axes and
    units, clocks, heights, points, encoders. What the flight says is unknown is then fitted to the points with coordinates,
    robustly, so that no blunder hides the cure; no failure ends the examination. The remedies are ranked by their chi-square.
    Where none brings the residuals near the noise, pairs of the best are tried; images and points that alone disagree are named.

    **Arguments:**

    - `flight`: its control points decide; where there are none, its check points do. Ties take no part.
    - `told`: how many findings are kept, beside those that share the first place and the flight as given.

    **Returns:** `Diagnosis`. The flight is sound where nothing explains its measurements better than itself.

    **Raises:** `FlightError` where no measured point has coordinates; `RuntimeError` where float64 is off.
    """
    require_x64("examine")
    need("examine", "flight", flight, Flight)
    need("examine", "told", told, int)
    seen, remarks, available = _focus(flight)
    tell(f"doctor: {len(seen.measurements)} measurements; the flight as given (the first fit is compiled)")
    given = attempt(AS_GIVEN, seen, _LAST_STEPS)
    projected = _projected(given, seen)
    trials: list[Trial] = [] if isinstance(given, str) else [given]
    refused = {AS_GIVEN.name: given} if isinstance(given, str) else {}

    def tried(remedies: Iterable[Remedy]) -> None:
        every = list(remedies)
        for i, remedy in enumerate(every):
            tell(f"doctor: {remedy.name} ({i + 1} of {len(every)})")
            found = attempt(remedy, seen, _FIRST_STEPS, projected)
            if isinstance(found, str):
                refused[remedy.name] = found
            else:
                trials.append(found)

    catalogue = conventions(seen)
    tried(catalogue)
    if not isinstance(given, str):
        tried([*_suspects(given, seen, "image"), *_suspects(given, seen, "point")])
    trials = _refined(trials, seen)
    if trials and min(trials, key=_cost).factor > NOISE:
        tried(_pairs(trials, catalogue))
        trials = _refined(trials, seen)
    findings = _placed(trials, told)
    as_given = next((found for found in findings if found.remedy is AS_GIVEN), None)
    total = len(trials) + len(refused) - 1
    return Diagnosis(flight, findings, as_given, len(seen.measurements), available, total, refused, remarks)


def _focus(flight: Flight) -> tuple[Flight, list[str], int]:
    """The flight with those measurements that decide, and what to tell of the choice."""
    m, role = flight.measurements, np.asarray(flight.points.roles)
    known = np.isfinite(np.asarray(flight.points.position_m)).all(axis=1) & (role != "tie")
    remarks = []
    keep = (known & (role == "control"))[m.point]
    if not keep.any():
        keep = known[m.point]
        if keep.any():
            remarks.append("there are no control points: the check points' coordinates decide")
    if not keep.any():
        raise FlightError(
            "examine: no measured point has coordinates, by which conventions could be told apart; give at least one control or "
            "check point in points.csv"
        )
    available = int(keep.sum())
    seen = dataclasses.replace(flight, measurements=chosen(flight, keep))
    if available > MOST_OBSERVATIONS:
        points = np.unique(seen.measurements.point)
        some = np.append(points[:: int(np.ceil(available / MOST_OBSERVATIONS))], _worst(seen))
        seen = dataclasses.replace(seen, measurements=chosen(seen, np.isin(seen.measurements.point, some)))
        count = len(seen.measurements)
        remarks.append(
            f"{count} of {available} measurements were looked at: of every so many points, and of those that fit worst"
        )
    return seen, remarks, available


def _worst(flight: Flight) -> np.ndarray:
    """The points (indices) that fit worst in the flight as given, so that none that is wrong is passed over."""
    tell(f"doctor: all {len(flight.measurements)} measurements, to find those that fit worst")
    found = attempt(AS_GIVEN, flight, _LAST_STEPS)
    if isinstance(found, str):
        return np.zeros(0, dtype=int)
    cost = np.bincount(flight.measurements.point, loss(found.squared))
    return np.argsort(-cost)[:_SUSPECTS]


def _projected(given: Trial | str, flight: Flight) -> np.ndarray | None:
    """Where the points are imaged at the start values of the flight as given, (n, 2)."""
    if isinstance(given, str):
        return None
    m = flight.measurements
    measured = np.stack([m.sample_px, np.zeros(len(m)) if flight.is_line else m.line_px], axis=-1)
    return measured - given.start_px


def _suspects(given: Trial, flight: Flight, kind: str) -> Sequence[Remedy]:
    """The images or points whose measurements cost more than leaving them out would."""
    m = flight.measurements
    index = np.asarray(m.image if kind == "image" else m.point)
    names = [image.name for image in flight.images] if kind == "image" else list(flight.points.names)
    gain = np.bincount(index, loss(given.squared) - LEFT_OUT, len(names))
    count = np.bincount(index, minlength=len(names))
    if (count > 0).sum() < (2 if kind == "image" else 3):
        return []
    gain[count > len(index) / 2] = -np.inf
    worst = np.argsort(-gain)[:_SUSPECTS]
    return list(wrong_ones(kind, [names[i] for i in worst if gain[i] > ALIKE]))


def _pairs(trials: Sequence[Trial], catalogue: Sequence[Remedy]) -> list[Remedy]:
    """The best remedies, one of a group, each with all others that change conventions and estimate nothing."""
    first: dict[str, Remedy] = {}
    for trial in sorted(trials, key=_cost):
        if trial.remedy is not AS_GIVEN and trial.remedy.without is None:
            first.setdefault(trial.remedy.group, trial.remedy)
    best = list(first.values())[:_PAIRED]
    done, pairs = set(), []
    for one in best:
        for other in catalogue:
            names = frozenset((one.name, other.name))
            if other.group != one.group and other.pairs and other.amount is None and names not in done:
                done.add(names)
                pairs.append(one.also(other))
    return pairs


def _refined(trials: list[Trial], flight: Flight) -> list[Trial]:
    """The best ones fitted to the end."""
    ordered = sorted(trials, key=_cost)
    better = []
    for trial in ordered[:_REFINED]:
        again = attempt(trial.remedy, flight, _LAST_STEPS, None, trial.end)
        better.append(again if not isinstance(again, str) and again.cost < trial.cost else trial)
    return [*better, *ordered[_REFINED:]]


def _cost(trial: Trial) -> float:
    return trial.cost


def _placed(trials: Sequence[Trial], told: int) -> list[Finding]:
    """Findings in order. Chi-squares count in units of the noise: where even the best is beyond it, so are differences."""
    if not trials:
        return []
    ordered = sorted(trials, key=_cost)
    alike = ALIKE * max(1.0, ordered[0].factor ** 2)
    places, place, head = [], 1, ordered[0].cost
    for trial in ordered:
        if trial.cost - head >= alike:
            place, head = place + 1, trial.cost
        places.append(place)
    inside = sorted(zip(places, ordered, strict=True), key=lambda pair: (pair[0], pair[1].remedy.oddity, pair[1].cost))
    return [
        _finding(trial, place) for i, (place, trial) in enumerate(inside) if place == 1 or i < told or trial.remedy is AS_GIVEN
    ]


def _finding(trial: Trial, place: int) -> Finding:
    amount = trial.remedy.amount
    shown = sigma = None
    if amount is not None and trial.amount is not None and trial.amount_sigma is not None:
        shown = amount.shown(trial.amount)
        sigma = abs(amount.shown(trial.amount + amount.step) - shown) / amount.step * trial.amount_sigma
    return Finding(
        remedy=trial.remedy,
        place=place,
        advice=trial.remedy.advice(trial.amount),
        residual_before_px=trial.before_px,
        residual_after_px=trial.after_px,
        chi_square=trial.chi_square,
        freedom=trial.freedom,
        cost=trial.cost,
        value=shown,
        value_sigma=sigma,
        unit="" if amount is None else amount.unit,
        amount=trial.amount,
        strays=_strays(trial),
    )


def _strays(trial: Trial) -> list[str]:
    found = []
    for unknown, value, start, sigmas in zip(trial.flight.unknowns, trial.value, trial.start, trial.prior_sigmas, strict=False):
        moved = (value - start) * unknown.unit.factor
        if how_far(unknown, value, start) > 1:
            found.append(f"{unknown.name} ends {moved:+.4g} {unknown.unit.name} from its start")
        elif abs(sigmas) > _PRIOR_SIGMAS:
            found.append(f"{unknown.name} ends {abs(sigmas):.0f} prior sigmas from its mean ({moved:+.4g} {unknown.unit.name})")
    return found
