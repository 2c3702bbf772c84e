"""What every verb lays before the checks of its verdict: the same fields, whichever verb it was."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..chain.address import node_at
from ..chain.link import AbstractLink
from ..chain.parameters import Parameters
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..rules import arrays_of
from .check_points import CheckTest
from .estimate import Estimate
from .variance_components import Components


class Words(NamedTuple):
    """What a verb calls things, in sentences for people.

    - `how` it converged; `noun`: measurements; `observed`: one that decides; `residuals`; `outliers`: what happened to outlying
      measurements; `remedy`: what to think of where residuals are too large; `hint`: and where measurements are impossible.
    """

    how: str
    noun: str
    observed: str
    residuals: str
    outliers: str
    remedy: str
    hint: str = ""


@dataclasses.dataclass(frozen=True)
class Seen:
    """n measurements, as the checks see them; arrays, (n,) each, may be traced.

    - `candidate`: which could take part; `used`: which decided; `outlying`: candidates that count as blunders; `most`: the
      largest share that may.
    - `code`: results of those that the sensor cannot have made where the answer ended; `beside`: used, and measured far beside
      the detector; `record`: numbers that tell one from another, (n, d); `image`: where each belongs, by its number in `images`.
    - `label`: names one for people.
    """

    candidate: Bool[Any, " n"]
    used: Bool[Any, " n"]
    outlying: Bool[Any, " n"]
    code: Int[Any, " n"]
    beside: Bool[Any, " n"]
    record: Float[Any, "n d"]
    image: Int[np.ndarray, " n"]
    most: float
    label: Callable[[int], str]
    images: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Evidence:
    """An answer of k numbers, as its checks see it; arrays may be traced.

    - `estimate`; `estimated`: which of its numbers were, and not only considered, (k,); `shift`: how many prior sigmas each lies
      from its prior mean, NaN without a prior, (k,).
    - `scale`: what one whitened unit of each number is, (k,); `rows`: a root of what the data alone know of the whitened numbers,
      priors left out, (m, k), None where it was not kept.
    - `variance_factor`, of `freedom` degrees, and its `tail` probability: of the residuals (model_test.py).
    - `words`: of the verb, for sentences; `seen`: the measurements, where they were kept.
    - `check`: the check points, None where there can be none; `components`: factors on the sigmas, where they were estimated.
    - `kinks`: unknowns and the links whose linear interpolation kinks their cost.
    """

    estimate: Estimate
    estimated: Bool[Any, " k"]
    shift: Float[Any, " k"]
    variance_factor: Float[Any, ""]
    freedom: Int[Any, ""] | int
    tail: Float[Any, ""]
    words: Words
    scale: Float[Any, " k"] | None = None
    rows: Float[Any, "m k"] | None = None
    seen: Seen | None = None
    check: CheckTest | None = None
    components: Components | None = None
    kinks: tuple[tuple[str, str], ...] = ()


def seen_by(e: Evidence) -> Seen:
    """The measurements, of which a check found something."""
    assert e.seen is not None
    return e.seen


def records(shot: Shot, *columns: Any) -> Float[Any, "n d"]:
    """Numbers that tell one measurement from another: time, keys and those given, (n,) or (n, m) each."""
    n = len(columns[0])
    keys = [value for key in ("time_s", *KEYS) if (value := getattr(shot, key)) is not None]
    math = arrays_of((keys, columns))
    wide = [math.broadcast_to(math.asarray(value, dtype=float), (n,)) for value in keys]
    parts = [part[:, None] if part.ndim == 1 else part for part in (*wide, *map(math.asarray, columns))]
    return math.nan_to_num(math.concatenate([part.astype(float) for part in parts], axis=1))


def kinks(sensor: Sensor, numbers: Estimate | Parameters) -> tuple[tuple[str, str], ...]:
    """Delays whose cost has a kink wherever the time of a shot passes a sample, and the links that interpolate so."""
    found: dict[tuple[str, str], None] = {}
    for name, places in zip(numbers.names, numbers.places, strict=True):
        for place in places:
            node = node_at(sensor, place._replace(path=place.path[:-1]))
            if isinstance(node, AbstractLink) and place.path[-1] in node.kinks:
                found[name, ".".join((place.link, *place.path[:-1]))] = None
    return tuple(found)


def numbered(names: Sequence[Any]) -> Int[np.ndarray, " n"]:
    """Numbers for names."""
    return np.unique(np.asarray(names), return_inverse=True)[1]
