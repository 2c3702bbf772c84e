"""Five thousand points with gross errors, against the plain calibration of the same points.

The plain one solves, settles and judges every point; finding the wrong ones has to try some places besides. The search must find
what was spoilt, or its time counts for nothing.
"""

import dataclasses
from functools import cache

import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from .suite import benchmark
from .timing import Measured, race
from .whiskbroom import calibrated, recorded

POINTS, WRONG, CHECK = 5000, 500, 500
SIGMA_PX = 2.0


@cache
def many_points() -> tuple[wj.Observations, np.ndarray]:
    """Points all over both swings of the first pair, the last of them check points; which of the others are 10 to 150 px off."""
    rng = np.random.default_rng(3)
    swing = rng.integers(0, 2, POINTS)
    start = np.array([haian.SCENES[name][0] for name in ("L1", "R1")])[swing]
    shot = wj.Shot(time_s=start + rng.uniform(0.001, 0.999, POINTS) * haian.SWING_S, swing=swing)
    exact = np.stack([rng.uniform(-0.95, 0.95, POINTS) * haian.HALF_LINE_PX, np.zeros(POINTS)], -1)
    point = np.asarray(wj.image_to_ground(calibrated(), shot, exact, wj.HeightSurface(haian.GROUND_M)).point_m)
    wrong = rng.choice(POINTS - CHECK, WRONG, replace=False)
    pixel = exact + SIGMA_PX * rng.normal(size=exact.shape)
    angle, size = rng.uniform(0, 2 * np.pi, WRONG), rng.uniform(10, 150, WRONG)
    pixel[wrong] += size[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    images = np.array(["L1", "R1"])[swing].tolist()
    is_control = np.arange(POINTS) < POINTS - CHECK
    return wj.Observations(shot, point, pixel, np.full_like(pixel, SIGMA_PX), is_control, images=images), wrong


@benchmark(
    "blunders.5000",
    what="a calibration of 5,000 points with `Blunders()` over one without",
    peer="calibrate without blunders",
    asked=10.0,
)
def of_five_thousand_points() -> Measured:
    flight, (seen, wrong) = recorded(), many_points()
    right = dataclasses.replace(seen, is_control=seen.is_control & ~np.isin(np.arange(POINTS), wrong))
    found = wj.calibrate(flight.sensor, seen, flight.unknowns, blunders=wj.Blunders())
    missed = found.used[wrong]
    # An error of 10 px in an unlucky direction is 4 sigma, beside a bound of 3.7.
    if missed.mean() > 0.01 or (right.is_control & ~found.used).mean() > 0.005:
        raise AssertionError(f"{missed.sum()} of {WRONG} blunders are missed, {(right.is_control & ~found.used).sum()} are none")
    return race(
        lambda: wj.calibrate(flight.sensor, seen, flight.unknowns, blunders=wj.Blunders()).value,
        lambda: wj.calibrate(flight.sensor, seen, flight.unknowns, throw=False).value,
        note=f"{WRONG} of {POINTS - CHECK} control points wrong",
    )
