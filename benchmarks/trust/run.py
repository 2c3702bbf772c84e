"""A way to be wrong, tried on many seeds."""

import dataclasses
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

import whiskjax as wj

from .score import NOTICEABLE, is_sound, is_wrong, who
from .way import Judged, Way

# Of the power curve: from weak alternatives to those that are scored.
STEPS = (0.0, 9.0, 16.0, 25.0, NOTICEABLE, 100.0, np.inf)


class Run(NamedTuple):
    """One seed: what the verdict said, what it should have, and who was named."""

    sound: bool
    wrong: bool
    named: bool
    noncentrality: float
    said: tuple[str, ...]
    error_sigmas: tuple[float, ...] = ()
    refusal: str = ""

    @property
    def fooled(self) -> bool:
        """Whether the answer is wrong and the verdict content."""
        return self.sound and self.wrong

    @property
    def counts(self) -> bool:
        """Whether a test exists that would have noticed."""
        return self.noncentrality >= NOTICEABLE


@dataclasses.dataclass(frozen=True)
class Row:
    """All runs of a way."""

    way: Way
    names: tuple[str, ...]
    runs: tuple[Run, ...]

    @property
    def scored(self) -> tuple[Run, ...]:
        """Runs that a verdict answers for: of spoiled data those of which a witness exists."""
        return tuple(run for run in self.runs if run.counts) if self.way.kind == "scored" else self.runs

    def share(self, what: str) -> float:
        """Of the runs that count those that are `sound`, `wrong`, `fooled` or `named`; NaN without any."""
        return float(np.mean([getattr(run, what) for run in self.scored])) if self.scored else float("nan")

    @property
    def noncentrality(self) -> float:
        """Of the witness, the median over all runs."""
        return float(np.median([run.noncentrality for run in self.runs]))

    @property
    def said(self) -> tuple[tuple[str, float], ...]:
        """Kinds of failing reasons and in what share of the runs each was given, the most frequent first."""
        counted = Counter(kind for run in self.scored for kind in run.said)
        return tuple((kind, count / len(self.scored)) for kind, count in counted.most_common())

    @property
    def rms(self) -> tuple[tuple[str, float], ...]:
        """Of each unknown the root mean square of error over predicted sigma."""
        off = np.array([run.error_sigmas for run in self.runs if run.error_sigmas])
        return tuple(zip(self.names, np.sqrt((off**2).mean(axis=0)).tolist(), strict=True)) if off.size else ()


class Power(NamedTuple):
    """How often alternatives between two noncentralities were noticed."""

    least: float
    most: float
    runs: int
    noticed: float


def power(rows: Iterable[Row]) -> list[Power]:
    """The share noticed against noncentrality, over all ways that are scored."""
    runs = [run for row in rows if row.way.kind == "scored" for run in row.runs]
    found = []
    for least, most in pairwise(STEPS):
        within = [run for run in runs if least <= run.noncentrality < most or run.noncentrality == most == np.inf]
        noticed = float(np.mean([not run.sound for run in within])) if within else float("nan")
        found.append(Power(least, most, len(within), noticed))
    return found


class Bench:
    """Runs ways; answers to data that are not spoiled are kept, since every way is compared with them."""

    def __init__(self) -> None:
        self._clean: dict[tuple[object, int], Judged] = {}

    def row(self, way: Way, seeds: Sequence[int]) -> Row:
        """The way on these seeds."""
        runs, names = [], ()
        for seed in seeds:
            judged, run = self._run(way, seed)
            runs.append(run)
            names = names or judged.names
        return Row(way, names, tuple(runs))

    def _run(self, way: Way, seed: int) -> tuple[Judged, Run]:
        scene = way.scene
        culprits: tuple[str, ...] = ()
        try:
            case, culprits = way.spoil(scene.draw(seed, True), _generator(way, seed))
            judged = scene.judged(case)
        except wj.WhiskjaxError as refusal:  # the data are refused, with a message
            judged = Judged(None, refusal=str(refusal))
        except np.linalg.LinAlgError as error:  # nobody is fooled by a foreign error, and nobody is helped
            judged = Judged(None, refusal=str(error), crashed=True)
        few, named = way.kind == "blind", False
        if culprits:
            found = who(judged.reasons, culprits, few=few)
            # What nothing in the data can show is named on data that are not spoiled, too: with the same words.
            named = bool(found if few else found - who(self._unspoiled(way, seed).reasons, culprits, few=few))
        failing = sorted({reason.kind for reason in judged.reasons or () if reason.grade == "failure"})
        said = tuple(failing) if judged.reasons is not None else ("crashed" if judged.crashed else "refused",)
        noncentrality = 0.0 if way.kind == "clean" else self._noncentrality(way, seed)
        return judged, Run(is_sound(judged), is_wrong(judged), named, noncentrality, said, judged.error_sigmas, judged.refusal)

    def _unspoiled(self, way: Way, seed: int) -> Judged:
        key = way.scene, seed
        if key not in self._clean:
            self._clean[key] = way.scene.judged(way.scene.draw(seed, True))
        return self._clean[key]

    def _noncentrality(self, way: Way, seed: int) -> float:
        """Of the best test that knows what was done: by how much it moves means, and what it does to the spread."""
        exact = way.scene.draw(seed, False)
        if way.witness is not None and not way.shifts:
            return way.witness(exact)
        try:
            moved = way.scene.misfit(way.spoil(exact, _generator(way, seed)).case)
        except (wj.WhiskjaxError, np.linalg.LinAlgError):
            return float("inf")
        return moved + (0.0 if way.witness is None else way.witness(exact))


def _generator(way: Way, seed: int) -> np.random.Generator:
    """The same for the same way and seed, with noise and without."""
    return np.random.default_rng([zlib.crc32(f"{way.verb} {way.name}".encode()), seed])
