"""Gross errors: found by a robust start and data snooping, left out, and named.

Snooping alone fails where blunders mask each other: they pull the solution until good points look bad. A descent through
redescending weights (graduated: the bound starts wide and narrows) first finds where most points agree; from there the points
that disagree are rejected, and taken back where they do not (Baarda 1968; Black and Rangarajan 1996 for the graduation).

The descents are a search for the right valley. They run in the linear model, all of them side by side, and of many observations
look at some only: what they cost does not grow with the observations.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..rules import Arrays, WhiskjaxError
from ..rules.progress import tell
from .linearised import LeastSquares, Linearised, linearise, refine
from .reliability import foreseen, squared_residuals, whitened_covariance

_NARROWING, _STARTS, _SOME, _LAST_STEPS = 2.0, 60, (0.1, 0.5), 20
_SAME = 1e-4  # of a prior sigma: the descent only has to find the right points
_ROUNDS = 30
# Observations that the descents look at, at least so many and so many for each unknown; and entries of their products at a time.
_ENOUGH, _ENOUGH_EACH, _AT_ONCE = 1000, 10, 2_000_000
_SINGULAR = 1e-14  # of the largest eigenvalue: what a direction has to weigh to be moved along


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


def data_snooping(
    ready: LeastSquares, here: Linearised, control: Bool[np.ndarray, " n"], rule: Blunders
) -> tuple[Linearised, Bool[np.ndarray, " n"]]:
    """The solution without blunders, and which observations it keeps.

    The descents take every ray by itself, its point's survey error counted in each: a blunder then spoils no other ray. What they
    find is judged with the rays of a point weighed together.

    **Arguments:** `here`: the least-squares solution with them; `control`: observations that may take part.
    """
    here = _robust(ready, here, control, rule.bound)
    kept, seen = control & (here.squared <= rule.bound), []
    for i in range(_ROUNDS):
        tell(f"blunders: round {i + 1}, {int((control & ~kept).sum())} of {int(control.sum())} observations left out")
        here = refine(ready, here, kept.astype(float), steps=10)
        share = kept.astype(float)
        squared = squared_residuals(foreseen(ready, here, share), whitened_covariance(ready, here, share), share)
        seen.append(kept)
        kept = control & (squared <= rule.bound)
        if any((kept == before).all() for before in seen):
            break
    if not (kept == seen[-1]).all():  # a point on the edge comes and goes: without it
        kept = np.logical_and.reduce([kept, seen[-1]])
        here = refine(ready, here, kept.astype(float), steps=10)
    return here, kept


def _robust(ready: LeastSquares, here: Linearised, control: Bool[np.ndarray, " n"], bound: float) -> Linearised:
    """Where most points agree: the lowest of the Geman-McClure minima reached from all points and from some, at random.

    Blunders in a cluster all pull one way, and hold the descent from all points; among some of the points they may be few. The
    candidates are compared in the linear model, the best one is then followed through the chain.
    """
    draw = np.random.default_rng(0)
    seen = sample(control, len(here.u), draw)
    linear = Linear(here.whitened[seen] - here.rows[seen] @ here.u, here.rows[seen], ready.prior)
    some = [draw.random(len(seen)) < draw.uniform(*_SOME) for _ in range(_STARTS)]
    starts = np.concatenate([here.u[None], linear.settled(here.u[None], np.array(some, dtype=float))])
    reached = descend(linear, starts, bound)
    # All observations are asked once, which of the candidates they agree with.
    everything = Linear(here.whitened[control] - here.rows[control] @ here.u, here.rows[control], ready.prior)
    best = min(reached, key=lambda u: _cost(everything, u[None], bound))
    return _follow(ready, linearise(ready, best), control, bound)


def sample(control: Bool[np.ndarray, " n"], k: int, draw: np.random.Generator) -> Int[np.ndarray, " m"]:
    """The observations that descents look at: all where they are few, else some, drawn alike from all."""
    index, enough = np.flatnonzero(control), max(_ENOUGH, _ENOUGH_EACH * k)
    return index if len(index) <= enough else np.sort(draw.choice(index, enough, replace=False))


class Linear(NamedTuple):
    """Whitened residuals at u = 0 and their derivatives, and the root of the priors."""

    residual: Float[np.ndarray, "m 2"]
    rows: Float[np.ndarray, "m 2 k"]
    prior: Float[np.ndarray, "k k"]

    def at(self, u: Float[np.ndarray, "starts k"]) -> Float[np.ndarray, "starts m 2"]:
        """Residuals."""
        m, _, k = self.rows.shape
        return self.residual + (u @ self.rows.reshape(2 * m, k).T).reshape(len(u), m, 2)

    def settled(self, u: Float[np.ndarray, "#starts k"], share: Float[np.ndarray, "starts m"]) -> Float[np.ndarray, "starts k"]:
        """The minimum of the observations weighted by each start's `share`, and the priors.

        By normal equations scaled to unit diagonal; u stays along directions that hardly weigh. Exact to 1e-8 of a sigma or so,
        which is enough to choose among valleys.
        """
        m, _, k = self.rows.shape
        normal = np.zeros((len(share), k * k))
        for i in range(0, m, most := max(1, _AT_ONCE // (k * k))):
            part = self.rows[i : i + most]
            normal += share[:, i : i + most] @ (part.swapaxes(1, 2) @ part).reshape(len(part), k * k)
        pull = self.prior.T @ self.prior
        normal = normal.reshape(-1, k, k) + pull
        slope = (share[:, :, None] * self.at(u)).reshape(len(share), 2 * m) @ self.rows.reshape(2 * m, k) + u @ pull
        size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-300))
        values, vectors = np.linalg.eigh(normal / size[:, :, None] / size[:, None, :])
        along = np.einsum("ski,sk->si", vectors, slope / size)
        weighs = values > _SINGULAR * values[:, -1:]
        step = np.einsum("ski,si->sk", vectors, np.where(weighs, along, 0.0) / np.where(weighs, values, 1.0))
        return u - step / size


def descend(linear: Linear, u: Float[np.ndarray, "starts k"], bound: float) -> Float[np.ndarray, "starts k"]:
    """Minima of the Geman-McClure cost from many starts.

    Its weight (c / (c + r^2))^2 forgets what is far; c starts where nine in ten are near, and narrows to `bound`.
    """
    u, c = u.copy(), np.maximum(bound, np.quantile(_squared(linear, u), 0.9, axis=1))
    left, moves = np.full(len(u), _LAST_STEPS), np.arange(len(u))
    while moves.size:
        tell(f"blunders: {len(moves)} of {len(u)} descents")
        last = u[moves]
        share = (c[moves, None] / (c[moves, None] + _squared(linear, last))) ** 2
        u[moves] = linear.settled(last, share)
        narrow = c[moves] <= bound
        left[moves] -= narrow
        ended = narrow & ((np.abs(u[moves] - last).max(axis=1) < _SAME) | (left[moves] == 0))
        c[moves] = np.maximum(bound, c[moves] / _NARROWING)
        moves = moves[~ended]
    return u


def _squared(linear: Linear, u: Float[np.ndarray, "starts k"]) -> Float[np.ndarray, "starts m"]:
    return (linear.at(u) ** 2).sum(axis=2)


def _cost(linear: Linear, u: Float[np.ndarray, "1 k"], bound: float) -> float:
    squared = _squared(linear, u)
    return float((squared / (bound + squared)).sum())


def _follow(ready: LeastSquares, here: Linearised, control: Bool[np.ndarray, " n"], bound: float) -> Linearised:
    """The minimum of the narrow cost through the chain, all observations taking part."""
    for i in range(_LAST_STEPS):
        tell(f"blunders: step {i + 1} from the best of the descents")
        last = here.u
        share = np.where(control, (bound / (bound + here.squared)) ** 2, 0.0)
        here = refine(ready, here, share, steps=1)
        if np.abs(here.u - last).max() < _SAME:
            break
    return here
