"""Liu et al. (2019) as a study over runs: every figure is a trial, a scene located a thousand times by one estimator."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...chain.correction import Bias, Correction
from ...chain.imaging import image_to_ground
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...earth.ellipsoid import geodetic_to_ecef
from ...earth.frames import enu_rotation
from ...earth.surface import HeightSurface
from ...estimate.consistency import nees
from ...estimate.errors import FrameErrors
from ...estimate.motions import motion_unknowns
from ...estimate.unknown import Unknown
from ...flights.tianshan import (
    GUESS_SIGMA_DEG_DEG_M,
    PIXEL_SIGMA_PX,
    TABLE_1,
    Errors,
    Place,
    Recorded,
    Scene,
    curvature_radii,
    draw_runs,
    frame_errors,
    sensor,
    time_s,
    true_records,
)
from ...locate.all_looks import at_last, equations
from ...locate.guess import Guess, first_guess
from ...locate.locate import locate
from ...locate.looks import Looks
from ...locate.nuisance import gather
from ...locate.problem import Problem
from ...rules.results import codes_of

_LANES = 250
FAR_M = 100.0
# Errors that stay the same in all looks: attitude and gimbal wholly, the others by a tenth (their white part stays).
CONSTANT = Errors((1.0, 1.0, 2.0), *TABLE_1[1:6], 0.0)
WHITE_BESIDE_CONSTANT = Errors(TABLE_1.position_m, 0.0, 0.0, 0.0, 0.0, 0.0, PIXEL_SIGMA_PX)


class Estimator(NamedTuple):
    """The form of the filter, whether R carries the errors of the records, and what is done with constant errors."""

    method: str = "extended"
    full_noise: bool = False
    biases: str = "ignored"


PAPER = Estimator()
EXTENDED, ITERATED, BATCH = (Estimator(method, True) for method in ("extended", "iterated", "batch"))
CONSIDERED, ESTIMATED = (Estimator("iterated", True, biases) for biases in ("considered", "estimated"))


@dataclasses.dataclass(frozen=True)
class Trial:
    """What an estimator did on many runs of a scene; `track_enu_m` is the error after each look, (runs, looks, 3)."""

    track_enu_m: Float[np.ndarray, "runs looks 3"]
    covariance_enu_m2: Float[np.ndarray, "runs 3 3"]
    code: np.ndarray

    @property
    def error_enu_m(self) -> Float[np.ndarray, "runs 3"]:
        """After the last look."""
        return self.track_enu_m[:, -1]

    @property
    def distance_m(self) -> Float[np.ndarray, " runs"]:
        """Length of the error in space."""
        return np.linalg.norm(self.error_enu_m, axis=1)

    @property
    def mean_m(self) -> float:
        """Mean error in space: the paper's measure."""
        return float(self.distance_m.mean())

    @property
    def rmse_m(self) -> float:
        """Root mean square error in space."""
        return float(np.sqrt((self.distance_m**2).mean()))

    @property
    def cep50_m(self) -> float:
        """Median horizontal error."""
        return float(np.median(np.hypot(*self.error_enu_m[:, :2].T)))

    @property
    def nees(self) -> float:
        """Mean normalised error squared: 3 where the covariance is honest."""
        return float(nees(self.error_enu_m, self.covariance_enu_m2).mean())

    @property
    def far_share(self) -> float:
        """The share of runs that end more than 100 m off."""
        return float((self.distance_m > FAR_M).mean())


def point_of(place: Place) -> Float[np.ndarray, "3"]:
    """A place in ECEF."""
    return np.asarray(geodetic_to_ecef(np.radians(place.lat_deg), np.radians(place.lon_deg), place.height_m))


def guess_sigma_enu_m(place: Place) -> Float[np.ndarray, "3"]:
    """Equation 19 in metres at a place: sigma east, north, up."""
    d_lat, d_lon, up = GUESS_SIGMA_DEG_DEG_M
    lat = np.radians(place.lat_deg)
    meridian, prime_vertical = curvature_radii(lat)
    return np.array([np.radians(d_lon) * prime_vertical * np.cos(lat), np.radians(d_lat) * meridian, up])


def to_enu(place: Place) -> Float[np.ndarray, "3 3"]:
    """Rotation ecef_from_enu at a place."""
    return np.asarray(enu_rotation(np.radians(place.lat_deg), np.radians(place.lon_deg)))


def trial(
    scene: Scene,
    runs: int,
    seed: int,
    estimator: Estimator = PAPER,
    *,
    guess: Place | float | None = 1000.0,
    white: Errors = TABLE_1,
    constant: Errors | None = None,
) -> Trial:
    """Locate the target of a scene in many runs.

    **Arguments:** `guess`: where the filter starts: a place, the height in metres of the surface that the first look is
    intersected with, or None: drawn from P0 around the truth, anew for each run.
    """
    kept = () if constant is None else frame_errors(constant, np.inf)
    recorded, pixel = draw_runs(scene, runs, seed, (*frame_errors(white), *kept), white.pixel_px)
    target, ecef_from_enu = point_of(scene.target), to_enu(scene.target)
    sigma = guess_sigma_enu_m(scene.target)
    rng = np.random.default_rng([seed, 1])
    if guess is None:
        start = target + (rng.normal(0, 1, (runs, 3)) * sigma) @ ecef_from_enu.T
    elif isinstance(guess, Place):
        start = np.tile(point_of(guess), (runs, 1))
    else:
        start = np.asarray(_first_guesses(recorded, pixel, time_s(scene), sigma, guess))
    biases = constant if estimator.biases != "ignored" else None
    track, covariance, code = _located(
        recorded,
        pixel,
        jnp.asarray(start),
        time_s(scene),
        sigma,
        frame_errors(white) if estimator.full_noise else (),
        estimator,
        biases,
    )
    return Trial((np.asarray(track) - target) @ ecef_from_enu, np.asarray(covariance), codes_of(code))


def biased(of: Sensor, errors: Errors) -> tuple[Sensor, tuple[Unknown, ...]]:
    """The sensor with a constant small motion behind every recorded frame, and the unknowns that these are."""
    for frame in ("body", "gimbal_roll", "gimbal_pitch"):
        of = of.after(frame, f"{frame}_bias", Correction(Bias()))
    e = errors
    body = motion_unknowns(of, "body_bias", turn_sigma_rad=(e.roll_rad, e.pitch_rad, e.yaw_rad), shift_sigma_m=e.position_m)
    roll = motion_unknowns(of, "gimbal_roll_bias", turn_sigma_rad=(e.gimbal_roll_rad, 0.0, 0.0))
    pitch = motion_unknowns(of, "gimbal_pitch_bias", turn_sigma_rad=(0.0, e.gimbal_pitch_rad, 0.0))
    return of, (*body, *roll, *pitch)


def _looks(pixel: Array, times: Any) -> Looks:
    return Looks(Shot(time_s=times), pixel, (PIXEL_SIGMA_PX, PIXEL_SIGMA_PX))


def _each(of, data):
    """of(run) for every run, in chunks that fit the cache."""
    return jax.lax.map(of, data, batch_size=min(_LANES, jax.tree.leaves(data)[0].shape[0]))


@jax.jit
def _first_guesses(recorded: Recorded, pixel: Array, times: Any, sigma: Any, height_m: Any) -> Array:
    """The first look of every run, intersected with the surface."""

    def one(run: tuple[Recorded, Array]) -> Array:
        return first_guess(sensor(run[0]), _looks(run[1], times[:1]), HeightSurface(height_m), sigma, throw=False).point_m

    first = jax.tree.map(lambda a: a[:, :1], (recorded, pixel))
    return _each(one, first)


@eqx.filter_jit
def _located(
    recorded: Recorded,
    pixel: Array,
    start: Array,
    times: Any,
    sigma: Any,
    white: tuple[FrameErrors, ...],
    estimator: Estimator,
    biases: Errors | None,
):
    def one(run: tuple[Recorded, Array, Array]):
        record, pixel, point = run
        of, estimate, consider = sensor(record), (), ()
        if biases is not None:
            of, unknowns = biased(of, biases)
            estimate, consider = (unknowns, ()) if estimator.biases == "estimated" else ((), unknowns)
        found = locate(
            of,
            _looks(pixel, times),
            guess=Guess.around(point, sigma),
            errors=white,
            method=estimator.method,
            estimate=estimate,
            consider=consider,
            throw=False,
        )
        return found.looks.point_m, found.looks.covariance_enu_m2[-1], found.result

    return _each(one, (recorded, pixel, start))


def single_look(scene: Scene, runs: int, seed: int, height_sigma_m: float) -> Float[np.ndarray, "runs 3"]:
    """Errors east, north, up of one look onto a surface whose height is known to `height_sigma_m` only: the ellipsoid model."""
    scene = dataclasses.replace(scene, looks=1)
    recorded, pixel = draw_runs(scene, runs, seed)
    height = scene.target.height_m + np.random.default_rng([seed, 2]).normal(0, height_sigma_m, runs)
    ground = image_to_ground(sensor(recorded), Shot(time_s=np.zeros(1)), pixel, HeightSurface(jnp.asarray(height)[:, None]))
    return (np.asarray(ground.point_m)[:, 0] - point_of(scene.target)) @ to_enu(scene.target)


def bound(
    scene: Scene, white: Errors = TABLE_1, constant: Errors | None = None, *, prior: bool = True
) -> Float[np.ndarray, "3 3"]:
    """Cramer-Rao bound: the least covariance (east, north, up) of any unbiased estimate with these errors and the prior P0.

    The inverse of the information of prior and looks at the truth (Van Trees 1968), constant errors among the unknowns.
    """
    of, unknowns = sensor(true_records(scene)), ()
    if constant is not None:
        of, unknowns = biased(of, constant)
    of, nuisance = gather(of, unknowns, ())
    guess = Guess.around(point_of(scene.target), guess_sigma_enu_m(scene.target) * (1.0 if prior else 1e3))
    looks = _looks(jnp.zeros((scene.looks, 2)), time_s(scene))
    ecef_from_enu = to_enu(scene.target)
    covariance = np.asarray(_bound(Problem(of, looks, guess, HeightSurface(0.0), frame_errors(white), nuisance, None)))
    return ecef_from_enu.T @ covariance[:3, :3] @ ecef_from_enu


@eqx.filter_jit
def _bound(problem: Problem) -> Array:
    model, prior = problem.pose()
    truth, spread = at_last(model, prior)
    return equations(model, jnp.linalg.inv(spread), truth, jnp.ones(len(problem.looks), dtype=bool)).formal
