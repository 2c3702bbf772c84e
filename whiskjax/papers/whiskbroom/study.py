"""Jin et al. (2024) as a study over seeds: calibrated from the left image alone and from both, each applied to all six images.

Whose R_pos is applied to an image is a key of the shot of its own here ("view"), beside the swing with which the image was made:
left parameters on a right image then are further observations that take no part, and one call of `calibrate_batch` gives the
residuals with a swing's own parameters and with the other's.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...chain.by import By
from ...chain.imaging import image_to_ground, project
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...earth.surface import HeightSurface
from ...estimate.many import Batch, calibrate_batch
from ...estimate.observations import Observations
from ...estimate.unknown import Unknown, assign
from ...flights.flight import Flight
from ...flights.haian import GROUND_M, HALF_LINE_PX, SCENES, SWING_RAD, SWING_S, TABLE_4, simulate, unknowns
from ...rules import SensorError, WhiskjaxError
from ...rules.results import codes_of, message_of
from .printed import TABLES, Column

_IMAGE = np.repeat(list(SCENES), [count for _, count, *_ in SCENES.values()])
_IS_CONTROL = np.concatenate([np.arange(count) < count - check for _, count, check, *_ in SCENES.values()])
_IS_RIGHT = np.char.startswith(_IMAGE, "R")
_APPLIED_TWICE = np.flatnonzero(np.isin(_IMAGE, ["L2", "R2", "L3", "R3"]))
# Pairs of angles and arms that the paper says are correlated, and the largest scan angles of the points they are seen with.
PAIRS = (
    ("omega_pos", "omega_sen"), ("phi_pos", "phi_sen"), ("kappa_pos", "kappa_sen"),
    ("u_gps", "u_sen"), ("v_gps", "v_sen"), ("w_gps", "w_sen"),
)  # fmt: skip
SCANS_DEG = (10, 20, 30, 40, 50)


class Model(NamedTuple):
    """A way to calibrate the flight: its unknowns, the rows of observations it is shown, and which of them decide.

    `row` points into a flight's observations in the order of image, role (control first) and time; `view` says whose R_pos is
    applied (0 left, 1 right), `parameters` the same by the paper's names.
    """

    unknowns: tuple[Unknown, ...]
    row: np.ndarray
    view: np.ndarray
    decides: Bool[np.ndarray, " n"]
    parameters: np.ndarray

    def rows_of(self, column: Column) -> np.ndarray:
        """The rows of a column of a table; within an image and role they go along the swing."""
        before = column.parameters == "none"
        here = _IMAGE[self.row] == column.image
        # Before, nothing is applied; rows that stand there a second time are left out.
        here &= np.arange(len(here)) < len(_IMAGE) if before else self.parameters == column.parameters
        if column.points != "all":
            here &= _IS_CONTROL[self.row] == (column.points == "control")
        return np.flatnonzero(here)


def from_left() -> Model:
    """12 unknowns from the control points of L1, applied to all images whatever their swing (section 3.1, Tables 1 to 3)."""
    row = np.arange(len(_IMAGE))
    shared = tuple(x for x in unknowns() if not x.name.endswith("_right"))
    decides = _IS_CONTROL & (_IMAGE == "L1")
    return Model(shared, row, np.zeros(len(row), dtype=int), decides, np.full(len(row), "A"))


def from_both() -> Model:
    """15 unknowns from the control points of L1 and R1, applied with either swing's R_pos (section 3.2, Tables 4 to 7)."""
    row = np.concatenate([np.arange(len(_IMAGE)), _APPLIED_TWICE])
    right = np.concatenate([_IS_RIGHT, ~_IS_RIGHT[_APPLIED_TWICE]])
    return Model(unknowns(), row, right.astype(int), _IS_CONTROL[row], np.where(right, "CR", "CL"))


def run_of(model: Model, flight: Flight) -> tuple[Sensor, Observations]:
    """A flight as a model sees it: R_pos chosen by "view", observations in the model's rows."""
    links = dict(zip(flight.sensor.names, flight.sensor.links, strict=True))
    by_swing = links["platform"]
    assert isinstance(by_swing, By)
    links["platform"] = By("view", {name: by_swing[name] for name in by_swing.names})
    found = flight.observations()
    image = flight.measurements.image
    order = np.lexsort(np.stack([np.asarray(found.shot.time_s), ~found.is_control, image]))[model.row]
    taken = found.take(order)
    shot = dataclasses.replace(taken.shot, view=model.view)
    return Sensor(links, flight.sensor.camera), dataclasses.replace(taken, shot=shot, is_control=model.decides)


@dataclasses.dataclass(frozen=True)
class Study:
    """Both calibrations of every seed: `left` has 12 unknowns from L1, `both` 15 from L1 and R1; lanes are seeds."""

    seeds: tuple[int, ...]
    left: Batch
    both: Batch

    def residual_px(self, column: Column) -> Float[np.ndarray, "seeds n 2"]:
        """Residuals (x, y) of the points of a table's column, along the swing."""
        model, batch = (from_left(), self.left) if column.parameters == "A" else (from_both(), self.both)
        stage = batch.residual_before_px if column.parameters == "none" else batch.residual_after_px
        return stage[:, model.rows_of(column)]

    def statistic(self, column: Column, statistic: str) -> Float[np.ndarray, "seeds 2"]:
        """The mean, or the standard deviation (n - 1), of a column's residuals in px."""
        residual = self.residual_px(column)
        return residual.mean(axis=1) if statistic == "mean" else residual.std(axis=1, ddof=1)

    @functools.cached_property
    def representative(self) -> int:
        """The lane whose statistics after the calibrations lie nearest to the medians over the seeds, in their spreads."""
        columns = dict.fromkeys(c for table in TABLES for c in table.columns if c.parameters != "none")
        figures = np.concatenate([self.statistic(c, s) for c in columns for s in ("mean", "std")], axis=1)
        spread = figures.std(axis=0) if len(figures) > 1 else 1.0
        return int(np.argmin((((figures - np.median(figures, axis=0)) / spread) ** 2).sum(axis=1)))


def study(seeds: Sequence[int], on_run: Callable[[int, int], None] = lambda unknowns, seed: None) -> Study:
    """Simulate and calibrate every seed in both ways.

    **Arguments:** `on_run`: called with the number of unknowns and the seed whenever a run begins.

    **Raises:** `WhiskjaxError` without seeds; `SensorError` naming the seed whose calibration failed.
    """
    if not seeds:
        raise WhiskjaxError("a study needs at least one seed")

    def solve(model: Model) -> Batch:
        def runs() -> Iterator[tuple[Sensor, Observations]]:
            for seed in seeds:
                on_run(len(model.unknowns), seed)
                yield run_of(model, simulate(seed, drift=True))

        batch = calibrate_batch(runs(), model.unknowns)
        if not batch.is_successful.all():
            i = int(np.argmin(batch.is_successful))
            code = int(codes_of(batch.result)[i])
            raise SensorError(f"seed {seeds[i]}, {len(model.unknowns)} unknowns: {message_of(code)}")
        return batch

    return Study(tuple(seeds), solve(from_left()), solve(from_both()))


def correlation_by_scan(seeds: Sequence[int]) -> dict[tuple[str, str], Float[np.ndarray, "seeds scans"]]:
    """How the data alone tell `PAIRS` apart in one left image whose points reach to each of `SCANS_DEG`.

    Correlations of the 12 unknowns without priors, from the derivatives at the truth, on a regular grid of points of one weight.
    """
    out = {pair: np.zeros((len(seeds), len(SCANS_DEG))) for pair in PAIRS}
    names = [x.name.removesuffix("_left") for x in from_left().unknowns]
    share, sample = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, 25), np.linspace(-HALF_LINE_PX, HALF_LINE_PX, 9)))
    pixel = np.stack([sample, np.zeros_like(sample)], axis=-1)
    for k, seed in enumerate(seeds):
        sensor = simulate(seed, noise=False).sensor
        for n, limit in enumerate(SCANS_DEG):
            time_s = SWING_S / 2 * (1 + share * np.radians(limit) / SWING_RAD)
            rows = np.asarray(_derivative(sensor, time_s, pixel)).reshape(-1, len(names))
            # Columns of length one: units drop out of a correlation.
            inverse = np.linalg.inv(np.asarray(np.linalg.qr(rows / np.linalg.norm(rows, axis=0), mode="r")))
            covariance = inverse @ inverse.T
            sigma = np.sqrt(np.diag(covariance))
            for pair in PAIRS:
                i, j = map(names.index, pair)
                out[pair][k, n] = covariance[i, j] / (sigma[i] * sigma[j])
    return out


@eqx.filter_jit
def _derivative(sensor: Sensor, time_s: np.ndarray, pixel: np.ndarray) -> Array:
    """Of the pixels of L1 by the 12 unknowns at the truth, (n, 2, 12), with the points where those pixels look."""
    shared = from_left().unknowns
    truth = jnp.array([x.mean for x in unknowns(mean=TABLE_4) if not x.name.endswith("_right")])
    shot = Shot(time_s=time_s, swing=0)
    point = image_to_ground(assign(sensor, shared, truth), shot, pixel, HeightSurface(GROUND_M), throw=False).point_m
    return jax.jacfwd(lambda v: project(assign(sensor, shared, v), shot, point, throw=False).pixel_px)(truth)


def mean_x_gap(seeds: Sequence[int], scan_first: bool) -> Float[np.ndarray, " seeds"]:
    """Mean x of L1 less that of R1 before the calibration, in px, with R_scan = Rx(scan) Ry(pitch) or the other order."""
    out = []
    for seed in seeds:
        flight = simulate(seed, scan_first=scan_first)
        found = flight.observations()
        x = found.pixel_px[:, 0] - np.asarray(project(flight.sensor, found.shot, found.point_m).pixel_px)[:, 0]
        mean = {name: x[(np.asarray(found.images) == name) & found.is_control].mean() for name in ("L1", "R1")}
        out.append(mean["L1"] - mean["R1"])
    return np.array(out)
