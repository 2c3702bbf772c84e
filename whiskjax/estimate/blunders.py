"""Gross errors: found by a robust start and data snooping, left out, and named.

Snooping alone fails where blunders mask each other: they pull the solution until good points look bad. A descent through
redescending weights (graduated: the bound starts wide and narrows) first finds where most points agree; from there the points
that disagree are rejected, and taken back where they do not (Baarda 1968; Black and Rangarajan 1996 for the graduation).
"""

import dataclasses

import numpy as np
from jaxtyping import Bool

from ..rules import Arrays, WhiskjaxError
from .adjustment import Here, Ready, linearise, settle
from .reliability import squared_residuals, whitened_covariance

_NARROWING, _STARTS, _SOME = 2.0, 60, (0.1, 0.5)
_SAME = 1e-4  # of a prior sigma: the descent only has to find the right points
_ROUNDS = 30


@dataclasses.dataclass(frozen=True)
class Blunders:
    """How to tell gross errors.

    **Arguments:**

    - `level`: the chance that a good observation is called a blunder.
    - `most`: the largest share of the control observations that may be; more, and the result is not sound.
    """

    level: float = 1e-3
    most: float = 0.35

    def __post_init__(self):
        for name in ("level", "most"):
            Arrays("Blunders").take(name, getattr(self, name), "")
        if not 0 < self.level < 0.5 or not 0 < self.most < 0.5:
            raise WhiskjaxError(f"Blunders: level and most lie between 0 and 0.5, not {self.level} and {self.most}")

    @property
    def bound(self) -> float:
        """The squared length that a good residual exceeds with probability `level`: chi-square, two degrees of freedom."""
        return -2 * np.log(self.level)


def snoop(ready: Ready, here: Here, control: Bool[np.ndarray, " n"], rule: Blunders) -> tuple[Here, Bool[np.ndarray, " n"]]:
    """The solution without blunders, and which observations it keeps.

    **Arguments:** `here`: the least-squares solution with them; `control`: observations that may take part.
    """
    here = _robust(ready, here, control, rule.bound)
    kept, seen = control & (here.squared <= rule.bound), []
    for _ in range(_ROUNDS):
        here = settle(ready, here, kept.astype(float), steps=10)
        share = kept.astype(float)
        squared = squared_residuals(here, whitened_covariance(ready, here, share), share)
        seen.append(kept)
        kept = control & (squared <= rule.bound)
        if any((kept == before).all() for before in seen):
            break
    if not (kept == seen[-1]).all():  # a point on the edge comes and goes: without it
        kept = np.logical_and.reduce([kept, seen[-1]])
        here = settle(ready, here, kept.astype(float), steps=10)
    return here, kept


def _robust(ready: Ready, here: Here, control: Bool[np.ndarray, " n"], bound: float) -> Here:
    """Where most points agree: the lowest of the Geman-McClure minima reached from all points and from some, at random.

    Blunders in a cluster all pull one way, and hold the descent from all points; among some of the points they may be few. The
    candidates are compared in the linear model, the best one is then followed through the chain.
    """
    draw = np.random.default_rng(0)
    starts = [here]
    for _ in range(_STARTS):
        some = control & (draw.random(len(control)) < draw.uniform(*_SOME))
        starts.append(settle(ready, here, some.astype(float), steps=1, frozen=True))
    reached = [_descend(ready, start, control, bound, frozen=True) for start in starts]
    best = min(reached, key=lambda end: float((end.squared[control] / (bound + end.squared[control])).sum()))
    return _descend(ready, linearise(ready, best.u), control, bound, frozen=False)


def _descend(ready: Ready, here: Here, control: Bool[np.ndarray, " n"], bound: float, frozen: bool) -> Here:
    """Minimum of the Geman-McClure cost, whose weight (c / (c + r^2))^2 forgets what is far; c narrows down to `bound`."""
    c = bound if not frozen else max(bound, float(np.quantile(here.squared[control], 0.9)))
    while True:
        for _ in range(1 if c > bound else 20):
            last = here.u
            share = np.where(control, (c / (c + here.squared)) ** 2, 0.0)
            here = settle(ready, here, share, steps=1, frozen=frozen)
            if np.abs(here.u - last).max() < _SAME:
                break
        if c <= bound:
            return here
        c = max(bound, c / _NARROWING)
