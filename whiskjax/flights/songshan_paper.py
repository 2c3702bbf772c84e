"""What paper 001 prints (Wang et al. 2018, Tables 1 to 6), the bands of the scenario, and the runs that stand beside them."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..estimate.block.adjustment import Statistics
from ..estimate.block.direct import Direct, direct_positioning
from ..estimate.unknown import assign
from .songshan import PROFILE, Scene
from .songshan_study import (
    MOUNTS,
    Calibrated,
    Loop,
    Run,
    Weighed,
    calibrated,
    followed,
    honest,
    readjusted,
    run,
    two_steps,
    weights,
    wrong_ties,
)

NOISES = ("nominal", "paper-like")
STAGES = ("direct", "adjusted", "second direct", "third direct")
CONTROL_POINTS = (3, 5, 7, 9, 11)
SCALE, TERRAIN = 1000, "hilly"
SPACINGS_S, SCAN_SEED = (4.0, 2.0, 1.0), 100
_LOOP_TIES = 1000
SECTIONS = (
    "A, nominal", "B, nominal", "A, paper-like", "B, paper-like", "lever arm and boresight", "spline", "wrong ties",
    "honest covariance", "weights", "two-step",
)  # fmt: skip

Axes3 = tuple[Statistics, Statistics, Statistics]


class Row(NamedTuple):
    """A row of the paper's Tables 1, 2, 4, 5 and 6: table, data set, and the trial or the number of control points."""

    table: int
    data: str
    trial: str


def _printed(*rows: tuple[float, ...]) -> dict[str, tuple[tuple[float, ...], ...]]:
    """Max, min, mean and RMSE along X, Y and Z, by trial."""
    return {trial: (r[:4], r[4:8], r[8:]) for trial, r in zip(STAGES, rows, strict=True)}


_TABLE_1 = _printed(
    (6.340, -4.739, 1.402, 3.897, 5.073, -4.980, 1.438, 3.654, -2.803, -8.932, -6.930, 6.487),
    (0.643, -0.503, -0.018, 0.224, 0.408, -0.586, -0.015, 0.234, 1.392, -1.767, 0.076, 0.579),
    (4.763, -4.003, 1.409, 3.311, 4.475, -3.833, 1.264, 3.211, 2.788, -1.721, 0.301, 0.992),
    (0.560, -0.856, -0.002, 0.320, 0.740, -0.744, 0.001, 0.302, 1.513, -1.545, -0.116, 0.664),
)
_TABLE_2 = _printed(
    (4.625, -3.186, 0.880, 3.256, 4.634, -4.020, 0.369, 3.344, -3.777, -7.806, -6.386, 6.218),
    (0.531, -0.654, 0.024, 0.189, 0.345, -0.246, 0.037, 0.146, 1.3057, -0.877, 0.046, 0.420),
    (3.560, -2.292, 0.882, 2.675, 2.807, -2.529, 0.278, 2.394, 2.331, -1.727, 0.449, 1.061),
    (0.836, -0.167, 0.187, 0.428, 0.587, -0.225, 0.143, 0.253, 1.137, -1.529, -0.019, 0.551),
)
_TABLE_4 = {
    "A": (0.712, -0.957, -0.015, 0.367, 0.839, -0.943, 0.032, 0.467, 1.613, -1.557, -0.136, 0.765),
    "B": (0.903, -0.206, 0.205, 0.513, 0.624, -0.406, 0.189, 0.392, 1.567, -1.722, -0.092, 0.732),
}
_TABLE_5 = (
    (0.672, -0.827, -0.010, 0.337, 0.789, -0.953, 0.027, 0.432, 1.526, -1.425, -0.121, 0.689),
    (0.654, -0.669, -0.008, 0.301, 0.618, -0.678, 0.008, 0.348, 1.423, -1.520, 0.080, 0.632),
    (0.642, -0.513, -0.008, 0.256, 0.423, -0.552, 0.008, 0.247, 1.396, -1.489, 0.078, 0.598),
    (0.643, -0.512, -0.007, 0.223, 0.411, -0.523, 0.007, 0.234, 1.385, -1.490, 0.070, 0.587),
    (0.641, -0.511, -0.007, 0.221, 0.401, -0.521, 0.007, 0.223, 1.390, -1.467, 0.069, 0.581),
)
_TABLE_6 = (
    (0.901, -0.189, 0.185, 0.478, 0.609, -0.386, 0.181, 0.347, 1.426, -1.567, -0.068, 0.652),
    (0.680, -0.167, 0.112, 0.389, 0.467, -0.312, 0.121, 0.264, 1.320, -1.212, -0.045, 0.517),
    (0.668, -0.152, 0.078, 0.292, 0.361, -0.289, 0.082, 0.173, 1.239, -0.921, 0.042, 0.469),
    (0.589, -0.149, 0.032, 0.230, 0.356, -0.223, 0.032, 0.151, 1.238, -0.822, 0.040, 0.422),
    (0.529, -0.145, 0.022, 0.209, 0.343, -0.214, 0.033, 0.143, 1.235, -0.815, 0.041, 0.418),
)
PRINTED: dict[Row, tuple[tuple[float, ...], ...]] = {
    **{Row(1, "A", trial): values for trial, values in _TABLE_1.items()},
    **{Row(2, "B", trial): values for trial, values in _TABLE_2.items()},
    **{Row(4, data, "third direct, mean of A and B"): (r[:4], r[4:8], r[8:]) for data, r in _TABLE_4.items()},
    **{Row(5, "A", f"{n} control"): (r[:4], r[4:8], r[8:]) for n, r in zip(CONTROL_POINTS, _TABLE_5, strict=True)},
    **{Row(6, "B", f"{n} control"): (r[:4], r[4:8], r[8:]) for n, r in zip(CONTROL_POINTS, _TABLE_6, strict=True)},
}
# Metres and degrees, u, v, w, ex, ey, ez.
TABLE_3 = {
    "A": (0.00893445433, 0.00723273239, -0.02865977941, -0.08002270187, -0.05307554749, -0.01646119989),
    "B": (0.0061857732, 0.00464960461, -0.00387804895, -0.0722768518, -0.07785861804, -0.01873454298),
}
# RMSE of X, Y, Z that an independent implementation got, nominal; and where ours is accepted.
_SCENARIO = {
    Row(1, "A", "direct"): (2.78, 2.75, 8.05),
    Row(1, "A", "adjusted"): (0.047, 0.032, 0.107),
    Row(1, "A", "second direct"): (2.57, 2.63, 0.89),
    Row(1, "A", "third direct"): (0.235, 0.197, 0.378),
    Row(2, "B", "adjusted"): (0.031, 0.040, 0.138),
    Row(2, "B", "third direct"): (0.175, 0.174, 0.290),
    Row(4, "A", "third direct, mean of A and B"): (0.253, 0.177, 0.376),
    Row(4, "B", "third direct, mean of A and B"): (0.172, 0.179, 0.277),
    Row(5, "A", "3 control"): (0.037, 0.038, 0.134),
    Row(5, "A", "11 control"): (0.032, 0.035, 0.091),
}
_BANDS = {
    Row(1, "A", "adjusted"): ((0.0, 0.06), (0.0, 0.06), (0.0, 0.14)),
    Row(1, "A", "third direct"): ((0.11, 0.26), (0.14, 0.25), (0.17, 0.40)),
}


class Band(NamedTuple):
    """RMSE along one axis: what an independent implementation got (None: not said), and from where to where it is accepted."""

    independent: float | None
    low: float | None
    high: float | None


def band(row: Row, axis: int) -> Band:
    """Of a row's nominal RMSE."""
    low, high = _BANDS.get(row, ((None, None),) * 3)[axis]
    return Band(_SCENARIO.get(row, (None,) * 3)[axis], low, high)


class Figure(NamedTuple):
    """One figure beyond the tables: bounds (None: none; it stands for comparison) and what was reached, in its unit."""

    section: str
    what: str
    unit: str
    low: float | None
    high: float | None
    reached: float

    @property
    def has_band(self) -> bool:
        """Whether something was asked."""
        return self.low is not None or self.high is not None

    @property
    def is_inside(self) -> bool:
        """Whether the figure lies in its bounds."""
        low, high = -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high
        return low <= self.reached <= high


class Sizes(NamedTuple):
    """Tie points of the tables (None: as many as the paper has) and of what is beyond, seeds, and rounds of the two-step loop."""

    ties: int | None = None
    few_ties: int = 3000
    seeds: int = 4
    rounds: int = 100


class Vectors(NamedTuple):
    """Residual vectors of one trial: where (n, 2), found less given coordinates (n, 3), metres, and which are check points."""

    plan_m: Float[np.ndarray, "n 2"]
    error_m: Float[np.ndarray, "n 3"]
    is_check: np.ndarray


class Mounts(NamedTuple):
    """Lever arm and boresight as found in one block, and their predicted sigmas (m, rad)."""

    value: Float[np.ndarray, " 6"]
    sigma: Float[np.ndarray, " 6"]


class Measured(NamedTuple):
    """Everything found.

    - `rows`: statistics by row of a table and noise; `mounts`, `vectors`: by data set and noise (and trial).
    - `figures`: beyond the tables; `loops`: two-step loops by how POS errors are taken; `weighed`: groups of weights.
    """

    rows: dict[tuple[Row, str], Axes3]
    mounts: dict[tuple[str, str], Mounts]
    vectors: dict[tuple[str, str, str], Vectors]
    figures: list[Figure]
    loops: dict[str, Loop]
    weighed: Weighed


def measure(sizes: Sizes, seed: int, on_section: Callable[[str], None] = lambda section: None) -> Measured:
    """Tables 1 to 6 of both data sets and noises, and what is beyond. **Arguments:** `on_section`: called when one begins."""
    rows: dict[tuple[Row, str], Axes3] = {}
    mounts: dict[tuple[str, str], Mounts] = {}
    vectors: dict[tuple[str, str, str], Vectors] = {}
    for noise in NOISES:
        found: dict[str, Calibrated] = {}
        for table, data in ((1, "A"), (2, "B")):
            on_section(f"{data}, {noise}")
            found[data] = c = calibrated(Scene(data, noise, ties=sizes.ties), seed)
            mounts[data, noise] = Mounts(c.value[:6], c.adjusted.trust.sigma[:6])
            trials = zip(STAGES, (c.direct, c.adjusted, c.second, c.third), strict=True)
            for trial, what in trials:
                rows[Row(table, data, trial), noise] = what.statistics()
                vectors[data, trial, noise] = _vectors(c, what if isinstance(what, Direct) else None)
        mean = (found["A"].value + found["B"].value) / 2
        for data, c in found.items():
            _with_mean(rows, Scene(data, noise, ties=sizes.ties), c, mean)
    on_section("lever arm and boresight")
    runs = {data: [run(Scene(data, ties=sizes.few_ties), s) for s in range(sizes.seeds)] for data in "AB"}
    few = sizes.seeds // 2
    figures = [Figure("lever arm and boresight", *figure) for figure in _mounts(runs)]
    on_section("spline")
    figures += [Figure("spline", *figure) for figure in _spline(runs["B"][:few])]
    on_section("wrong ties")
    figures += [Figure("wrong ties", *figure) for figure in _wrong(runs["A"][:few])]
    on_section("honest covariance")
    figures += [Figure("honest covariance", *figure) for figure in _honest(runs["A"][:few])]
    on_section("weights")
    weighed = weights(Scene("A", ties=sizes.few_ties, truth="matching"), seed)
    figures += [Figure("weights", *figure) for figure in _weighed(weighed)]
    on_section("two-step")
    scene = Scene("B", ties=min(sizes.few_ties, _LOOP_TIES))
    loops = {"correlated": two_steps(scene, seed, False, sizes.rounds), "white": two_steps(scene, seed, True, sizes.rounds)}
    figures += [Figure("two-step", *figure) for figure in _loops(loops)]
    return Measured(rows, mounts, vectors, figures, loops, weighed)


def _with_mean(rows: dict[tuple[Row, str], Axes3], scene: Scene, c: Calibrated, mean: np.ndarray) -> None:
    """Tables 4, 5 and 6: the mean of A's and B's numbers."""
    sensor = assign(c.drawn.sensor, c.unknowns, mean)
    fourth = direct_positioning(sensor, c.drawn.block).statistics()
    rows[Row(4, scene.name, "third direct, mean of A and B"), scene.noise] = fourth
    for count in CONTROL_POINTS:
        again = readjusted(scene, c.drawn.block, sensor, count).statistics()
        rows[Row(5 if scene.name == "A" else 6, scene.name, f"{count} control"), scene.noise] = again


def _vectors(c: Calibrated, direct: Direct | None) -> Vectors:
    """Of control and check points; those of the adjustment where there is no `direct`."""
    block = c.drawn.block
    if direct is None:
        point = np.flatnonzero(block.role != "tie")
        error = (c.adjusted.point_m - block.position_m)[point]
    else:
        point, error = direct.point, direct.error_m
    return Vectors(block.position_m[point, :2], error, block.role[point] == "check")


_Figures = Iterator[tuple[str, str, float | None, float | None, float]]


def _mounts(runs: dict[str, list[Run]]) -> _Figures:
    """RMS over seeds against what is predicted."""
    for data, some in runs.items():
        error, sigma = np.stack([r.mount_errors for r in some], axis=1)
        ratio = np.sqrt((error**2).mean(axis=0) / (sigma**2).mean(axis=0))
        for name, value in zip(MOUNTS, ratio, strict=True):
            yield f"{data}, {name}: RMS of the error over seeds / predicted sigma", "1", None, 1.3, float(value)


def _spline(images: list[Run]) -> _Figures:
    """Against orientation images, which POS errors taken as white hold together."""
    base, scan = images[0].scene, {}
    for spacing in SPACINGS_S:
        scan[spacing] = followed(run(dataclasses.replace(base, basis="spline", spacing_s=spacing), SCAN_SEED)).tie_rmse_m
        yield f"scan, another flight: spline every {spacing:g} s: ties, RMSE in space", "m", None, None, scan[spacing]
    best = min(scan, key=lambda s: scan[s])
    yield "spacing with the lowest of these", "s", None, None, best
    scene = dataclasses.replace(base, basis="spline", spacing_s=best)
    white = _rms([followed(run(base, r.seed, white=True)) for r in images])
    images_rms = _rms([followed(r) for r in images])
    splines = _rms([followed(run(scene, r.seed)) for r in images])
    measures = ("ties: RMSE in space", 20.0), ("body attitude: RMS", 35.0), ("camera attitude: RMS", 35.0)
    for k, (what, low) in enumerate(measures):
        unit, factor = ("m", 1.0) if k == 0 else ("deg", math.degrees(1.0))
        yield f"4 s orientation images, white: {what}", unit, None, None, factor * white[k]
        yield f"4 s orientation images, correlated: {what}", unit, None, None, factor * images_rms[k]
        yield f"spline every {best:g} s, correlated: {what}", unit, None, None, factor * splines[k]
        yield f"spline, correlated, below 4 s images, white: {what}", "%", low, None, 100 * (1 - splines[k] / white[k])


def _rms(found: list) -> Float[np.ndarray, " n"]:
    return np.sqrt((np.array(found) ** 2).mean(axis=0))


def _wrong(clean: list[Run]) -> _Figures:
    """RMSE over all check points of all flights."""
    spoilt = [wrong_ties(r) for r in clean]
    rmse = {of: _rms([getattr(s, f"{of}_m") for s in spoilt]) for of in ("clean", "plain", "found")}
    for axis, name in enumerate("XYZ"):
        yield (
            f"check points, {name}: RMSE / clean, wrong ties searched",
            "1",
            None,
            1.05,
            rmse["found"][axis] / rmse["clean"][axis],
        )
        yield (
            f"check points, {name}: RMSE / clean, least squares as it is",
            "1",
            None,
            None,
            rmse["plain"][axis] / rmse["clean"][axis],
        )
    yield "wrong tie points found", "%", 85.0, None, 100 * float(np.mean([s.found_share for s in spoilt]))
    yield "right tie points called wrong", "%", None, 0.5, 100 * float(np.mean([s.false_share for s in spoilt]))


def _honest(rough: list[Run]) -> _Figures:
    """For a truth that the model knows all about, and for that of the tables."""
    matching = [run(dataclasses.replace(r.scene, truth="matching"), r.seed) for r in rough]
    for truth, runs, low, high in (("matching", matching, 0.9, 1.25), ("rough", rough, None, None)):
        found = np.array([honest(r) for r in runs]).mean(axis=0)
        yield f"{truth} truth: NEES / 3 of tie points", "1", low, high, float(found[0])
        yield f"{truth} truth: variance factor", "1", None, None, float(found[1])


def _weighed(w: Weighed) -> _Figures:
    for name, start, reached, predicted in zip(w.names, w.start, w.reached, w.predicted, strict=True):
        yield f"{name}: estimated / true sigma, from {start:.2g}", "1", None, None, reached
        yield f"{name}: predicted relative sigma of it", "%", None, None, 100 * predicted


def _loops(loops: dict[str, Loop]) -> _Figures:
    for how, (loop, distance) in loops.items():
        agreed = 1e-6 if how == "correlated" else None
        yield f"{how}: mounts against the joint solution after the last round", "sigma", None, agreed, distance[-1]
        yield f"{how}: rate a round, from the equations", "1", None, None, loop.rate
        yield f"{how}: rate a round, observed", "1", None, None, loop.observed_rate
        yield f"{how}: rounds", "1", None, None, len(distance) - 1
        yield f"{how}: rounds to 1e-6 by the rate", "1", None, None, loop.rounds_needed(1e-6)
        if loop.early is not None:
            yield f"{how}: round at which a step below 0.01 sigma would have stopped it", "1", None, None, loop.early
            yield f"{how}: distance from the joint solution there", "sigma", None, None, distance[loop.early]


class Limited(NamedTuple):
    """RMSE of a row against the 1:1000 limits for hilly ground: planimetry and height."""

    planimetry_m: float
    height_m: float

    @property
    def fits(self) -> tuple[bool, bool]:
        """Whether each is within its limit."""
        limit = PROFILE.limits[SCALE, TERRAIN]
        return self.planimetry_m <= limit.planimetry_m, self.height_m <= limit.height_m


def limited(rmse_m: tuple[float, float, float]) -> Limited:
    """Of the RMSE along X, Y, Z."""
    return Limited(math.hypot(*rmse_m[:2]), rmse_m[2])


def contradictions() -> list[Row]:
    """Printed rows with an RMSE below the absolute mean, which no set of numbers has."""
    return [row for row, axes in PRINTED.items() if any(rmse < abs(mean) for *_, mean, rmse in axes)]
