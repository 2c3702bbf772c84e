"""What speaks for and against an answer, and the form of a check that finds it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np

from ..rules import arrays_of

Grade = Literal["failure", "caution", "note"]

# What a check returns, as numbers that can be traced: 0 has nothing to say.
FINE, NOTE, CAUTION, FAILURE = range(4)
_NAMED = 10
_LINES = 5
_GRADES: tuple[Grade, ...] = ("note", "note", "caution", "failure")


class Reason(NamedTuple):
    """One thing that a careful person would say of an answer.

    - `kind`: which check says it, as "check points" or "copies".
    - `grade`: "failure": the answer is not sound; "caution": look here before you believe it; "note": what was tested and found
      in order.
    - `text`: one sentence for people.
    - `figures`: what the sentence is made of, by name: numbers, and names of unknowns, groups, images or points.
    """

    kind: str
    grade: Grade
    text: str
    figures: Mapping[str, Any]


Said = tuple[str, Mapping[str, Any]]
Figures = tuple[Any, dict[str, Any]]
Evidence = TypeVar("Evidence")


class Check(NamedTuple, Generic[Evidence]):
    """A question asked of every answer: `figures` can be traced, `sentences` is for people.

    - `figures`: the grade and the numbers that it was found by, arrays without or with leading axes of a batch.
    - `sentences`: from those numbers, of one answer and not traced: what to say, each with its own figures. Asked only where the
      grade is not `FINE`.
    """

    kind: str
    figures: Callable[[Evidence], Figures]
    sentences: Callable[[dict[str, Any], Evidence], Iterable[Said]]


def judged(checks: Sequence[Check[Evidence]], evidence: Evidence) -> list[Reason]:
    """What the checks say of one answer, in their order."""
    found = []
    for check in checks:
        grade, figures = check.figures(evidence)
        if int(grade) != FINE:
            known = {name: np.asarray(value) for name, value in figures.items()}
            found += [Reason(check.kind, _GRADES[int(grade)], text, of) for text, of in check.sentences(known, evidence)]
    return found


def grades(checks: Sequence[Check[Evidence]], evidence: Evidence) -> dict[str, Any]:
    """By the kind of each check the grade that it gives: 0 nothing to say, 1 note, 2 caution, 3 failure. Traceable."""
    return {check.kind: check.figures(evidence)[0] for check in checks}


def by_weight(reasons: Iterable[Reason]) -> tuple[Reason, ...]:
    """Failures first, then cautions, then notes; else in their order."""
    return tuple(sorted(reasons, key=lambda reason: -_GRADES.index(reason.grade)))


def is_sound(reasons: Iterable[Reason]) -> bool:
    """Whether nothing fails the answer."""
    return all(reason.grade != "failure" for reason in reasons)


def warnings(reasons: Iterable[Reason]) -> tuple[str, ...]:
    """The sentences of failures and cautions; where there are more than anybody reads, the kinds of the others in the last line.

    Failures are often what one cause does to everything, and the first caution may be the cause: it keeps its line.
    """
    told = [reason for reason in reasons if reason.grade != "note"]
    if len(told) <= _LINES:
        return tuple(reason.text for reason in told)
    failures, cautions = ([i for i, reason in enumerate(told) if (reason.grade == "failure") == fails] for fails in (True, False))
    kept = [*failures[: _LINES - 1 - bool(cautions)], *cautions][: _LINES - 1]
    kinds = dict.fromkeys(reason.kind for i, reason in enumerate(told) if i not in kept)
    return *(told[i].text for i in kept), f"and, in .reasons: {', '.join(kinds)}"


def graded(grade: int, where: Any, otherwise: Any = FINE) -> Any:
    """A grade where a condition holds."""
    return arrays_of((where, otherwise)).where(where, grade, otherwise)


def several(names: Sequence[str]) -> str:
    """Names in a row: the first ten, and how many there are."""
    return ", ".join(names[:_NAMED]) + (f", ... ({len(names)})" if len(names) > _NAMED else "")


def about(x: float) -> str:
    """Two digits, without an exponent up to a million."""
    return f"{float(f'{x:.2g}'):g}"


def probability(p: float) -> str:
    """A probability for people: below a millionth its exact size says nothing."""
    return f"{p:.2g}" if p >= 1e-6 else "below 1e-6"
