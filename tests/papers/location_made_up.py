"""Everything that `measure` returns, without a filter: its own figures and names, from trials that are random numbers."""

import math

import numpy as np
import pytest

from whiskjax.papers.figure import Figure
from whiskjax.papers.location import runs
from whiskjax.papers.location.open_questions import Bent, HandedOn, Offset
from whiskjax.papers.location.runs import Measured, Sizes, measure
from whiskjax.papers.location.study import Trial

SIZES = Sizes(runs=20, circle=30, calibrations=20, offsets=5)


def made(inside: bool = True, sections: list[str] | None = None) -> Measured:
    """A study in which every figure with a band lies inside, or those of OUTSIDE do not.

    **Arguments:** `sections`: gets the names of the sections as they begin.
    """
    rng = np.random.default_rng(12)
    identity = np.broadcast_to(25 * np.eye(3), (SIZES.runs, 3, 3))

    def trial(scene, runs, seed, *_, **__):
        track = rng.normal(0, 1, (runs, scene.looks, 3)) * 40 / np.sqrt(np.arange(1, scene.looks + 1))[:, None]
        return Trial(track, np.broadcast_to(25 * np.eye(3), (runs, 3, 3)), rng.integers(0, 2, runs))

    fakes = {
        "trial": trial,
        "single_look": lambda scene, runs, seed, height_sigma_m: rng.normal(0, 60, (runs, 3)),
        "bound": lambda *_: 17.0 * np.eye(3),
        "refraction": lambda scene: Bent(1.25, 1.0),
        "handed_on": lambda runs, seed: HandedOn(
            dict.fromkeys(("ignored", "considered"), rng.normal(0, 5, (runs, 3))),
            dict.fromkeys(("ignored", "considered"), identity),
        ),
        "time_offset": lambda runs, seed: Offset(90.0, 9.0, 40.0, 3.0, 0.004),
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, fake in fakes.items():
            patch.setattr(runs, name, fake)
        found = measure(SIZES, 1, (lambda section: None) if sections is None else sections.append)
    figures = [_within(figure) for figure in found.figures]
    return found._replace(figures=figures if inside else [_moved_out(figure) for figure in figures])


OUTSIDE = {"straight flight, 78 deg: mean error": 99.0, "iterated, full R: NEES of 3 states": 2.5e7}


def _within(figure: Figure) -> Figure:
    ends = [end for end in (figure.low, figure.high) if end is not None]
    return figure._replace(reached=math.fsum(ends) / len(ends)) if ends else figure


def _moved_out(figure: Figure) -> Figure:
    return figure._replace(reached=OUTSIDE.get(figure.what, figure.reached))
