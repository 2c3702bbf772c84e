"""The answers to what Jin et al. (2024) leave open, beside what was asked of them."""

import dataclasses
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from ...estimate.selection import Comparison
from ..figure import Figure
from .open_questions import (
    SHARED,
    Honesty,
    PosErrors,
    Spoilt,
    Weights,
    blunders,
    drift,
    honest_covariance,
    model_choice,
    pos_errors,
    weights,
)  # fmt: skip

QUESTIONS = ("weights", "drift", "blunders", "which model, shared truth", "which model, split truth", "POS errors", "covariance")
# Up to these shares of wrong points the bound is asked for; beyond, the figures say where the method ends: a cluster that is
# off by a few sigmas is explained better by a bent model than by the truth (its robust cost is lower).
_ASKED_SHARE = {"scattered": 0.20, "clustered": 0.05}
_UNSEEN = 100  # the search for blunders was tried on the seeds before this one while it was written


@dataclasses.dataclass(frozen=True)
class Sizes:
    """How many seeds or runs each question is asked of."""

    weights: int = 30
    drift: int = 30
    blunders: int = 40
    models: int = 200
    pos: int = 600
    honesty: int = 10_000


@dataclasses.dataclass(frozen=True)
class Answers:
    """Raw results of every question; `models` by truth: "shared" (both swings alike, no drift) and "split" (paper, drifting)."""

    weights: Weights
    drift: dict[str, dict[str, np.ndarray]]
    blunders: dict[tuple[str, float], Spoilt]
    models: dict[str, list[Comparison]]
    pos: PosErrors
    honesty: Honesty

    def figures(self) -> list[Figure]:
        """Every figure, asked and reached."""
        return [*self._weights(), *self._drift(), *self._blunders(), *self._models(), *self._pos(), *self._honesty()]

    def _weights(self) -> list[Figure]:
        w = self.weights
        mean, single, well = w.sigma_ratio.mean(axis=0), 100 * np.abs(w.sigma_ratio - 1).mean(), w.well.mean()
        rows = [
            ("image sigmas wrong by 3: estimated / true, mean over seeds, smallest of four", "1", 0.85, None, mean.min()),
            ("the same, largest of four", "1", None, 1.15, mean.max()),
            ("error of one sigma from one flight, mean", "%", None, 15.0, single),
            ("its predicted 1-sigma (65 points an image)", "%", None, None, 100 * w.sigma_predicted.mean()),
        ]
        cases = [("image sigmas wrong by 3", w.wrong, w.reweighed)]
        for k, how in enumerate(("priors 30 times too narrow", "priors 30 times too wide")):
            cases.append((how, w.prior_wrong[:, k], w.prior_reweighed[:, k]))
        for case, wrong, reweighed in cases:
            rows.append((f"{case}: prediction error over that of the right weights", "1", None, None, wrong.mean() / well))
            rows.append((f"{case}, reweighed: the same", "1", None, 1.10, reweighed.mean() / well))
        return _figures("weights from the data", rows)

    def _drift(self) -> list[Figure]:
        rows = []
        for kind, images in self.drift.items():
            for name, high in (("R3", 2.0), ("L3", 1.7)):
                how = "no drift in the model" if kind == "none" else f"drift as {kind}, 6 anchor points on L3 and on R3"
                asked = None if kind == "none" else high
                rows.append((f"{name}, {how}: prediction error", "px", None, asked, images[name].mean()))
        return _figures("drift", rows)

    def _blunders(self) -> list[Figure]:
        rows = []
        for (how, share), s in self.blunders.items():
            case, clean, wrong = f"{share:.0%} of the control points wrong, {how}", s.clean.mean(), s.found.sum() + s.missed.sum()
            asked = 1.10 if share <= _ASKED_SHARE[how] else None
            rows += [
                (f"{case}: prediction error over the clean one", "1", None, asked, s.found_px.mean() / clean),
                (f"{case}: the same, were the wrong points known", "1", None, None, s.oracle.mean() / clean),
                (f"{case}: the same, median over the flights", "1", None, None, np.median(s.found_px / s.clean)),
                (f"{case}: flights where it is over 1.5 times that of known points", "%", None, None, 100 * _lost(s)),
                (f"{case}: prediction error of least squares over the clean one", "1", None, None, s.plain.mean() / clean),
                (f"{case}: wrong points named", "%", None, None, 100 * s.found.sum() / wrong),
                (f"{case}: good points named, a flight", "1", None, None, s.false.mean()),
            ]
        return _figures("blunders", rows)

    def _models(self) -> list[Figure]:
        rows = []
        for truth, right, asked in (("shared", "12 shared", 1.0), ("split", "15 split, drifting", None)):
            comparisons = self.models[truth]
            wrong = 1 - Counter(c.recommended for c in comparisons)[right] / len(comparisons)
            rows.append((f"{truth} truth: another model than {right!r} recommended", "%", None, asked, 100 * wrong))
        return _figures("which model", rows)

    def _pos(self) -> list[Figure]:
        rows = [
            ("NEES of the 15 unknowns, POS bias ignored", "1", None, None, self.pos.ignored.mean()),
            ("NEES, POS bias estimated at the joint body", "1", 13.5, 16.6, self.pos.estimated.mean()),
            ("NEES, POS bias considered at the joint body", "1", 13.5, 16.6, self.pos.considered.mean()),
        ]
        return _figures("POS errors", rows)

    def _honesty(self) -> list[Figure]:
        h = self.honesty
        rows = [
            (f"spread over {len(h.nees)} runs / predicted sigma, smallest of 15", "1", 0.95, None, h.spread.min()),
            ("the same, largest of 15", "1", None, 1.05, h.spread.max()),
            ("runs that ended well", "%", 100.0, None, 100 * h.is_successful.mean()),
        ]
        return _figures("honest covariance", rows)


def _lost(s: Spoilt) -> float:
    return float(np.mean(s.found_px > 1.5 * s.oracle))


def _figures(question: str, rows: list[tuple[str, str, float | None, float | None, Any]]) -> list[Figure]:
    return [Figure(question, figure, unit, "", low, high, float(reached)) for figure, unit, low, high, reached in rows]


def ask(sizes: Sizes, on_question: Callable[[str], None] = lambda question: None) -> Answers:
    """Ask all of it; with the default sizes about six minutes on one core.

    **Arguments:** `on_question`: called with its name before each question.
    """

    def asked(k: int, answer: Callable):
        on_question(QUESTIONS[k])
        return answer()

    return Answers(
        asked(0, lambda: weights(range(sizes.weights))),
        asked(1, lambda: drift(range(sizes.drift))),
        asked(2, lambda: blunders(range(_UNSEEN, _UNSEEN + sizes.blunders))),
        {
            "shared": asked(3, lambda: model_choice(range(sizes.models), truth=SHARED, drift=False)),
            "split": asked(4, lambda: model_choice(range(-(-sizes.models // 5)), drift=True)),
        },
        asked(5, lambda: pos_errors(sizes.pos)),
        asked(6, lambda: honest_covariance(sizes.honesty)),
    )
