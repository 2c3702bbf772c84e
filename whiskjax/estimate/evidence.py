"""What every verb lays before the checks of its verdict: the same fields, whichever verb it was."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..chain.address import node_at
from ..chain.by import By
from ..chain.link import AbstractLink
from ..chain.parameters import Parameters
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..rules import arrays_of
from .check_points import CheckTest
from .estimate import Estimate
from .far_turns import FarTurn
from .fitted import AbstractFitted
from .suspects import Suspects, Suspicions, tested
from .variance_components import Components

_SAME_S, _SAME_SIGMAS = 1e-7, 0.01  # times, and pixels in their sigmas, that are the same


class Grouping(NamedTuple):
    """Which measurements belong together, by a number each (n,), and what the groups are called: "image", "strip" and so on."""

    kind: str
    index: Int[np.ndarray, " n"]
    names: tuple[str, ...]


class Held(NamedTuple):
    """Observations of one kind, as recorded poses or surveyed coordinates: their whitened sum of squares and redundancy."""

    name: str
    squares: float
    freedom: float


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
      the detector; `record`: what tells one from another, (n, d), in units below which it is the same; `image`: where each
      belongs, by its number in `images`.
    - `label`: names one for people.
    - `groups`: what may have an error in common; `along`: what errors may change with, (n,) each, by name.
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
    groups: tuple[Grouping, ...] = ()
    along: Mapping[str, Float[np.ndarray, " n"]] = dataclasses.field(default_factory=dict)


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
    - `widened`: how much of each prior's variance what is considered adds to the answer's, (k,).
    - `held`: kinds of observations, of which some are no measurements in the image.
    - `suspects`: what numbers that nobody estimated do to the pixels, and every image's own pose.
    - `fit`: the residuals and what the fit took of them; None while tracing, and of batches; `everything`: the same of a fit
      that knows the check points too, where these are measurements like the others.
    - `passing`: gives what errors that are not stated as constant do to the pixels, (n, 2, k), and their frames; asked only where
      it matters.
    - `kinks`: unknowns and the links whose linear interpolation kinks their cost.
    - `turned`: angles that ended far from their start, and the axes that would keep them small; none while tracing.
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
    turned: tuple[FarTurn, ...] = ()
    widened: Float[Any, " k"] | float = 0.0
    held: tuple[Held, ...] = ()
    suspects: Suspects | None = None
    fit: AbstractFitted | None = None
    everything: AbstractFitted | None = None
    passing: Callable[[], tuple[Any, tuple[str, ...]]] | None = None

    @cached_property
    def suspicions(self) -> Suspicions | None:
        """The score tests of the suspects; None where there are none."""
        if self.fit is None or self.suspects is None or not self.suspects.names:
            return None
        return tested(self.fit, self.suspects, self.everything)


def seen_by(e: Evidence) -> Seen:
    """The measurements, of which a check found something."""
    assert e.seen is not None
    return e.seen


def records(shot: Shot, pixel_px: Float[Any, "n 2"], sigma_px: Float[Any, "n 2"]) -> Float[Any, "n d"]:
    """What tells one measurement from another: keys, time, and the pixel, in units below which two are the same.

    Whichever point it is said to be: two rays through one pixel are one ray.
    """
    n = len(pixel_px)
    told = [(key, value) for key in (*KEYS, "time_s") if (value := getattr(shot, key)) is not None]
    math = arrays_of((told, pixel_px, sigma_px))
    columns = [math.broadcast_to(math.asarray(v, dtype=float), (n,)) / (_SAME_S if key == "time_s" else 0.5) for key, v in told]
    sigma_px = math.broadcast_to(math.asarray(sigma_px), (n, 2))
    columns += list((math.asarray(pixel_px) / (_SAME_SIGMAS * sigma_px)).T[::-1])  # the sample last
    return math.nan_to_num(math.stack(columns, axis=1), nan=0.0)


def kinks(sensor: Sensor, numbers: Estimate | Parameters) -> tuple[tuple[str, str], ...]:
    """Delays whose cost has a kink wherever the time of a shot passes a sample, and the links that interpolate so."""
    found: dict[tuple[str, str], None] = {}
    for name, places in zip(numbers.names, numbers.places, strict=True):
        for place in places:
            node = node_at(sensor, place._replace(path=place.path[:-1]))
            if isinstance(node, AbstractLink) and place.path[-1] in node.kinks:
                found[name, ".".join((place.link, *place.path[:-1]))] = None
    return tuple(found)


def courses(sensor: Sensor, shot: Shot, pixel_px: Float[np.ndarray, "n 2"]) -> dict[str, Float[np.ndarray, " n"]]:
    """What errors may change with: time and the place in the image, of a detector line the sample alone."""
    time = {} if shot.time_s is None else {"time": np.broadcast_to(np.asarray(shot.time_s, dtype=float), (len(pixel_px),))}
    names = ("the sample",) if sensor.is_line else ("the column", "the row")
    return time | dict(zip(names, np.asarray(pixel_px).T, strict=False))


def groupings(
    sensor: Sensor, key: Callable[[str], Any], images: Sequence[str], strips: Sequence[str] = ()
) -> tuple[Grouping, ...]:
    """By image, and by every key that is recorded; names of views and swings are those of the sensor's options.

    **Arguments:** `key`: gives a key of the shots, (n,), or None.
    """
    found = []
    if len(images):
        names, index = np.unique(np.asarray(images), return_inverse=True)
        found.append(Grouping("image", index, tuple(map(str, names))))
    options = {node.key: node.names for node in (*sensor.links, sensor.camera) if isinstance(node, By)} | (
        {"strip": tuple(strips)} if len(strips) else {}
    )
    for name in KEYS:
        value = key(name)
        if value is None or (name == "image" and len(images)):
            continue
        number, names = np.asarray(value), options.get(name)
        if names is None:  # numbers that may be anything, as days
            there, number = np.unique(number, return_inverse=True)
            names = tuple(map(str, there.tolist()))
        found.append(Grouping(name, number, names))
    return tuple(found)


def numbered(names: Sequence[Any]) -> Int[np.ndarray, " n"]:
    """Numbers for names."""
    return np.unique(np.asarray(names), return_inverse=True)[1]
