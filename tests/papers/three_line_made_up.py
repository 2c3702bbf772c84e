"""Everything that `measure` returns, without an adjustment: its own figures and names, from blocks that are random numbers."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from whiskjax.estimate.block.adjustment import Statistics
from whiskjax.estimate.block.direct import Direct
from whiskjax.papers.figure import Figure
from whiskjax.papers.three_line import runs
from whiskjax.papers.three_line.printed import Row, band
from whiskjax.papers.three_line.runs import Measured, Sizes, measure
from whiskjax.papers.three_line.study import TRUE_MOUNTS, Followed, Honest, Loop, Spoilt, Weighed

SIZES = Sizes(ties=200, few_ties=200, seeds=2, few_seeds=1, rounds=5)
OUTSIDE = {"wrong tie points found": 12.5}
OUTSIDE_ROW = Row(1, "A", "adjusted")


def made(inside: bool = True, sections: list[str] | None = None) -> Measured:
    """A study in which every figure with a band lies inside, or those of OUTSIDE and OUTSIDE_ROW's heights do not.

    **Arguments:** `sections`: gets the names of the sections as they begin.
    """
    rng = np.random.default_rng(8)
    points = 30
    block = SimpleNamespace(
        position_m=rng.uniform(-3900, 3900, (points, 3)), role=np.array(["control"] * 20 + ["check"] * 6 + ["tie"] * 4)
    )

    def direct(*_):
        error = rng.normal(0, 0.2, (26, 3))
        return Direct(np.arange(26), np.zeros(26, dtype=int), block.position_m[:26], error, 0, 0)

    def adjusted(*_):
        error = rng.normal(0, 0.05, (points, 3))
        return SimpleNamespace(
            point_m=block.position_m + error,
            trust=SimpleNamespace(sigma=np.r_[np.full(3, 0.03), np.full(3, 3e-5), np.ones(4)]),
            statistics=lambda: tuple(Statistics.of(e) for e in error[20:26].T),
        )

    def calibrated(*_):
        value = np.r_[TRUE_MOUNTS * rng.uniform(0.9, 1.1, 6), np.zeros(4)]
        drawn = SimpleNamespace(block=block, sensor=None)
        return SimpleNamespace(
            drawn=drawn,
            unknowns=(),
            value=value,
            adjusted=adjusted(),
            direct=direct(),
            second=direct(),
            third=direct(),
        )

    loop: Any = SimpleNamespace(rate=0.5, observed_rate=0.51, early=3, rounds_needed=lambda share: 20)
    fakes = {
        "calibrated": calibrated,
        "readjusted": adjusted,
        "direct_positioning": direct,
        "assign": lambda *_: None,
        "run": lambda scene, seed, white=False, reweigh=False: SimpleNamespace(
            scene=scene, seed=seed, mount_errors=np.stack([rng.normal(0, 0.03, 6), np.full(6, 0.03)])
        ),
        "followed": lambda *_, **__: Followed(*rng.uniform(1e-5, 1e-4, 3)),
        "wrong_ties": lambda *_: Spoilt(np.arange(100) < 5, np.arange(100) < 5, *np.full((3, 3), 0.1)),
        "honest": lambda *_: Honest(1.0, 1.0),
        "weights": lambda *_: Weighed(("tie rays", "points"), np.array([3.0, 1 / 3]), np.ones(2), np.array([0.01, 0.1])),
        "two_steps": lambda *_: Loop(loop, 0.5 ** np.arange(6.0)),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, fake in fakes.items():
            patch.setattr(runs, name, fake)
        found = measure(SIZES, 0, (lambda section: None) if sections is None else sections.append)
    figures = [_within(figure) for figure in found.figures]
    rows = {key: tuple(_in_band(key[0], k, s) for k, s in enumerate(axes)) for key, axes in found.rows.items()}
    if not inside:
        figures = [f._replace(reached=OUTSIDE.get(f.what, f.reached)) for f in figures]
        axes = rows[OUTSIDE_ROW, "nominal"]
        rows[OUTSIDE_ROW, "nominal"] = (*axes[:2], axes[2]._replace(rmse=0.5))
    return found._replace(figures=figures, rows=rows)


def _within(figure: Figure) -> Figure:
    ends = [end for end in (figure.low, figure.high) if end is not None]
    return figure._replace(reached=math.fsum(ends) / len(ends)) if ends else figure


def _in_band(row: Row, axis: int, found: Statistics) -> Statistics:
    asked = band(row, axis)
    if asked.low is None or asked.high is None:
        return found
    return found._replace(rmse=(asked.low + asked.high) / 2)
