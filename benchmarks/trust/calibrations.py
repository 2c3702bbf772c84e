"""Calibrations of the whiskbroom scanner over Haian from 130 control points, the truth drawn from the priors."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from .score import ground_chi_square, misfit_of
from .way import Judged

IMAGES = tuple(haian.SCENES)
IMAGE = np.repeat(np.arange(len(IMAGES)), [scene[1] for scene in haian.SCENES.values()])
IMAGE_OF = tuple(IMAGES[i] for i in IMAGE)
POINTS = tuple(f"{name}-{k + 1:02d}" for name, (_, count, *_) in haian.SCENES.items() for k in range(count))
SIGMA_PX = np.array([scene[3:] for scene in haian.SCENES.values()])[IMAGE]
_UNKNOWNS = haian.unknowns()
NAMES = tuple(unknown.name for unknown in _UNKNOWNS)

# Each like the others: 0.2 m and half a degree.
EQUAL = haian.Truth(
    np.full(3, 0.2), *(np.radians(np.full(3, 0.5)) for _ in range(2)), np.full(3, 0.2), np.radians(np.full(3, 0.5))
)

# Ten pixels of each swing over the second pair of images, which no control point lies on.
_ALONG = np.linspace(0.05, 0.95, 10) * haian.SWING_S
_SWINGS = np.repeat([0, 1], 10)
_GROUND = wj.Shot(time_s=np.concatenate([haian.SCENES["L2"][0] + _ALONG, haian.SCENES["R2"][0] + _ALONG]), swing=_SWINGS)
_GROUND_PX = np.stack([800.0 * np.cos(np.arange(20.0)), np.zeros(20)], axis=1)


@dataclasses.dataclass(frozen=True)
class Case:
    """What `calibrate` is given, and what was true.

    - `truth`: values of the 15 unknowns; `true_sensor`: the instrument as it is, with which the ground points are compared.
    - `white`: of every measurement the errors in sigmas, (n, 2).
    """

    sensor: wj.Sensor
    observations: wj.Observations
    unknowns: tuple[wj.Unknown, ...]
    errors: tuple[wj.FrameErrors, ...]
    truth: np.ndarray
    true_sensor: wj.Sensor
    white: np.ndarray
    reweigh: wj.Reweigh | None = None
    blunders: wj.Blunders | None = None

    @property
    def control(self) -> np.ndarray:
        """Indices of control observations."""
        return np.flatnonzero(self.observations.is_control)

    def moved(self, rows: Any, by_px: Any) -> "Case":
        """Measured elsewhere: `by_px` is added to the pixels of these observations."""
        pixel = np.array(self.observations.pixel_px)
        pixel[rows] += by_px
        return dataclasses.replace(self, observations=dataclasses.replace(self.observations, pixel_px=pixel))

    def sensed(self, change: Callable[[wj.Sensor], wj.Sensor], rows: Any = slice(None), stays: bool = True) -> "Case":
        """The world was otherwise: these observations were imaged by an instrument that nobody describes.

        **Arguments:** `stays`: whether the instrument is so for good, and the ground is seen by it.
        """
        observed, otherwise = self.observations, change(self.true_sensor)
        by = np.asarray(_projected(otherwise, observed.shot, observed.point_m))
        by = by - np.asarray(_projected(self.true_sensor, observed.shot, observed.point_m))
        case = self.moved(rows, by[rows])
        return dataclasses.replace(case, true_sensor=otherwise) if stays else case


@dataclasses.dataclass(frozen=True, eq=False)
class Calibrations:
    """Flights over Haian whose truth is drawn from these prior sigmas; with `reweigh`, sigmas are found from the data."""

    sigma: haian.Truth = haian.PRIOR_SIGMA
    reweigh: wj.Reweigh | None = None
    verb: str = "calibrate"

    def draw(self, seed: int, noise: bool) -> Case:
        of_truth, of_flight = jax.random.split(jax.random.key(seed))
        truth = haian.draw_truth(of_truth, sigma=self.sigma)
        drawn = (_drawn if noise else _exact)(of_flight, truth)
        numpy = {k: np.asarray(getattr(drawn, k)) for k in ("point_m", "surveyed_m", "exact_px", "pixel_px")}
        drawn, values = drawn._replace(**numpy), np.concatenate(truth)
        observed = dataclasses.replace(drawn.observations(), images=IMAGE_OF, points=POINTS)
        unknowns = haian.unknowns(haian.Truth(*np.zeros((5, 3))) if noise else truth, self.sigma)
        return Case(
            sensor=drawn.sensor,
            observations=observed,
            unknowns=unknowns,
            errors=haian.frame_errors(),
            truth=values,
            true_sensor=wj.assign(drawn.sensor, unknowns, values),
            white=(drawn.pixel_px - drawn.exact_px) / SIGMA_PX,
            reweigh=self.reweigh,
        )

    def answer(self, case: Case) -> wj.Calibration:
        """The calibration of a case."""
        return wj.calibrate(
            case.sensor,
            case.observations,
            case.unknowns,
            errors=case.errors,
            reweigh=case.reweigh,
            blunders=case.blunders,
            throw=False,
        )

    def judged(self, case: Case) -> Judged:
        answer = self.answer(case)
        value, covariance = np.asarray(answer.value), np.asarray(answer.estimate.covariance)
        with np.errstate(invalid="ignore"):
            off = (value - case.truth) / np.sqrt(np.diag(covariance))
        here, by_unknowns = _ground(case.sensor, jnp.asarray(value))
        true_m = _image_to_ground(case.true_sensor)
        chi_square, freedom = ground_chi_square(np.asarray(here - true_m).ravel(), np.asarray(by_unknowns), covariance)
        return Judged(answer.reasons, NAMES, tuple(off.tolist()), chi_square, freedom)

    def misfit(self, case: Case) -> float:
        answer = self.answer(dataclasses.replace(case, reweigh=None, blunders=None))
        return misfit_of(answer.result, float(answer.estimate.cost) + answer.fit.check.chi_square)


@eqx.filter_jit
def _drawn(key: Any, truth: haian.Truth) -> haian.Drawn:
    return haian.draw(key, truth=truth)


@eqx.filter_jit
def _exact(key: Any, truth: haian.Truth) -> haian.Drawn:
    return haian.draw(key, truth=truth, noise=False)


@eqx.filter_jit
def _projected(sensor: wj.Sensor, shot: wj.Shot, point_m: Any) -> Any:
    return wj.project(sensor, shot, point_m).pixel_px


@eqx.filter_jit
def _image_to_ground(sensor: wj.Sensor) -> Any:
    return wj.image_to_ground(sensor, _GROUND, _GROUND_PX, wj.HeightSurface(haian.GROUND_M), throw=False).point_m


@eqx.filter_jit
def _ground(sensor: wj.Sensor, value: Any) -> tuple[Any, Any]:
    """Where the fixed pixels look, (20, 3), and its derivatives by the unknowns, (60, k)."""
    at = lambda v: _image_to_ground(wj.assign(sensor, _UNKNOWNS, v))
    return at(value), jax.jacfwd(lambda v: at(v).ravel())(value)


def design(case: Case) -> np.ndarray:
    """Derivatives of all pixels, whitened by their own sigmas, and of the priors by the unknowns: (2 n + k, k)."""
    observed = case.observations
    by = np.asarray(_by_unknowns(case.sensor, observed.shot, observed.point_m, jnp.asarray(case.truth)))
    prior = np.diag([1 / unknown.sigma for unknown in case.unknowns])
    return np.concatenate([by.reshape(-1, len(NAMES)) / observed.sigma_px.reshape(-1, 1), prior])


@eqx.filter_jit
def _by_unknowns(sensor: wj.Sensor, shot: wj.Shot, point_m: Any, value: Any) -> Any:
    return jax.jacfwd(lambda v: wj.project(wj.assign(sensor, _UNKNOWNS, v), shot, point_m).pixel_px)(value)
