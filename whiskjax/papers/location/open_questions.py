"""What Liu et al. (2019) leave out: refraction, calibration errors handed to the filter, a time offset of camera and POS."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...chain.imaging import image_to_ground, project
from ...chain.mounts import Mount
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...earth.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from ...earth.refraction import Refraction
from ...earth.surface import HeightSurface
from ...estimate.calibrate import calibrate
from ...estimate.calibration import Calibration
from ...estimate.consistency import nees
from ...estimate.many import calibrate_redrawn
from ...estimate.observations import Observations
from ...estimate.unknown import Unknown, assign
from ...flights.tianshan import PIXEL_SIGMA_PX, Recorded, Scene, draw_runs, frame_errors, in_time, sensor, time_s, true_records
from ...locate.guess import Guess
from ...locate.locate import locate
from ...locate.looks import Looks
from .study import guess_sigma_enu_m, point_of, to_enu

_BORESIGHT_SIGMA_RAD = np.radians(0.1)
_SURVEYED, _CALIBRATION_SIGMA_PX = 6, 60.0
_OFFSET_SIGMA_S = 0.05
_LANES = 100


class Bent(NamedTuple):
    """What ignoring refraction does to a scene, in metres: the shift of one look on the ground, the height after all looks."""

    ground_shift_m: float
    height_bias_m: float


def refraction(scene: Scene) -> Bent:
    """Locate without refraction what was seen through it; nothing else is wrong.

    All looks are solved at once with the noise of Table 1 as weights.
    """
    true = sensor(true_records(scene))
    target, times = point_of(scene.target), time_s(scene)
    through_air = Sensor(dict(zip(true.names, true.links, strict=True)), true.camera, Refraction())
    shot = Shot(time_s=times)
    seen = project(through_air, shot, np.broadcast_to(target, (scene.looks, 3))).pixel_px
    ground = np.asarray(image_to_ground(true, shot, seen, HeightSurface(scene.target.height_m)).point_m)
    guess = Guess.around(target, 1e3 * guess_sigma_enu_m(scene.target))
    found = locate(true, Looks(shot, seen, (PIXEL_SIGMA_PX, PIXEL_SIGMA_PX)), guess=guess, errors=frame_errors(), method="batch")
    up = to_enu(scene.target)[:, 2]
    return Bent(float(np.linalg.norm(ground[0] - target)), float(up @ (np.asarray(found.point_m) - target)))


@dataclasses.dataclass(frozen=True)
class HandedOn:
    """Errors east, north, up of a target located after a calibration, with what the filter believed, by case.

    "ignored": the calibrated boresight is taken as exact; "considered": the posterior of the calibration is handed on.
    """

    error_enu_m: dict[str, Float[np.ndarray, "runs 3"]]
    covariance_enu_m2: dict[str, Float[np.ndarray, "runs 3 3"]]

    def nees(self, case: str) -> float:
        """Mean over the runs: 3 where the covariance is honest."""
        return float(nees(self.error_enu_m[case], self.covariance_enu_m2[case]).mean())


def handed_on(runs: int, seed: int) -> HandedOn:
    """Calibrate the boresight on a few surveyed points, then locate a target with it, a flight of its own in every run."""
    rng = np.random.default_rng([seed, 3])
    scene = Scene()
    unknowns = tuple(
        Unknown(f"boresight {axis}", f"boresight.angles_rad[{i}]", 0.0, _BORESIGHT_SIGMA_RAD) for i, axis in enumerate("xyz")
    )
    before = dataclasses.replace(scene, looks=_SURVEYED)
    mounted = _with_boresight(in_time(true_records(before), time_s(before)))
    truth = rng.normal(0, _BORESIGHT_SIGMA_RAD, (runs, 3))
    shot, points = Shot(time_s=time_s(before)), _around(scene, rng)
    exact = np.asarray(_imaged(mounted, unknowns, shot, points, jnp.asarray(truth)))
    measured = exact + rng.normal(0, _CALIBRATION_SIGMA_PX, exact.shape)
    sigma = np.full((_SURVEYED, 2), _CALIBRATION_SIGMA_PX)
    seen = Observations(shot, points, measured[0], sigma, np.ones(_SURVEYED, dtype=bool))
    calibration = calibrate(mounted, seen, unknowns)
    value = calibrate_redrawn(mounted, seen, unknowns, measured).value

    recorded, pixel = draw_runs(scene, runs, seed)
    # The boresight turns the image: the pixels of the target are those that the true one gives, plus the noise drawn.
    target, ecef_from_enu = point_of(scene.target), to_enu(scene.target)
    looks = Shot(time_s=time_s(scene))
    shifted = _imaged(
        _with_boresight(sensor(true_records(scene))), unknowns, looks, np.tile(target, (scene.looks, 1)), jnp.asarray(truth)
    )
    start = target + rng.normal(0, 1, (runs, 3)) @ np.diag(guess_sigma_enu_m(scene.target)) @ ecef_from_enu.T
    error, covariance = {}, {}

    def one(run: tuple[Recorded, Array, Array, Array], calibration: Calibration | None) -> tuple[Array, Array]:
        record, pixel, value, point = run
        found = locate(
            assign(_with_boresight(sensor(record)), unknowns, value),
            Looks(looks, pixel, (PIXEL_SIGMA_PX, PIXEL_SIGMA_PX)),
            guess=Guess.around(point, guess_sigma_enu_m(scene.target)),
            errors=frame_errors(),
            consider=() if calibration is None else dataclasses.replace(calibration.estimate, value=value),
            throw=False,
        )
        return found.looks.point_m[-1], found.looks.covariance_enu_m2[-1]

    for case, handed in (("ignored", None), ("considered", calibration)):
        located = jax.jit(lambda runs, handed=handed: jax.lax.map(lambda run: one(run, handed), runs, batch_size=_LANES))
        point, spread = located((recorded, pixel + shifted, jnp.asarray(value), jnp.asarray(start)))
        error[case] = (np.asarray(point) - target) @ ecef_from_enu
        covariance[case] = np.asarray(spread)
    return HandedOn(error, covariance)


def _with_boresight(of: Sensor) -> Sensor:
    return of.after("gimbal_pitch", "boresight", Mount(angles_rad=np.zeros(3)))


def _around(scene: Scene, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Surveyed points within a few hundred metres of the target."""
    lat, lon, height = ecef_to_geodetic(point_of(scene.target))
    away = rng.normal(0, 5e-5, (2, _SURVEYED))
    return np.asarray(geodetic_to_ecef(lat + away[0], lon + away[1], height + rng.normal(0, 50, _SURVEYED)))


@eqx.filter_jit
def _imaged(of: Sensor, unknowns: tuple[Unknown, ...], shot: Shot, points: np.ndarray, values: Array) -> Array:
    return jax.vmap(lambda v: project(assign(of, unknowns, v), shot, points, throw=False).pixel_px)(values)


class Offset(NamedTuple):
    """A time offset between camera and POS, new in every run: RMSE in space and NEES of the target where it is ignored and where
    it is estimated, and the RMS error of the offset itself."""

    rmse_ignored_m: float
    rmse_estimated_m: float
    nees_ignored: float
    nees_estimated: float
    offset_rms_s: float


def time_offset(runs: int, seed: int) -> Offset:
    """Locate from POS whose stamps are later than those of camera and gimbal by a time known to 50 ms (1-sigma) only."""
    # To and fro: along an orbit a shift in time changes nothing. One look more at either end keeps all inside the record.
    scene = Scene("race", looks=82)
    recorded, pixel = draw_runs(scene, runs, seed)
    rng = np.random.default_rng([seed, 4])
    late = rng.normal(0, _OFFSET_SIGMA_S, runs)
    target, ecef_from_enu = point_of(scene.target), to_enu(scene.target)
    sigma = guess_sigma_enu_m(scene.target)
    unknown = Unknown("time offset", "body.delay_s", 0.0, _OFFSET_SIGMA_S)
    shot = Shot(time_s=time_s(scene)[1:-1])
    ignored, estimated, offset = [], [], []
    for k in range(runs):
        of = in_time(jax.tree.map(lambda a, k=k: np.asarray(a[k]), recorded), time_s(scene), late[k])
        looks = Looks(shot, pixel[k, 1:-1], (PIXEL_SIGMA_PX, PIXEL_SIGMA_PX))
        guess = Guess.around(target + ecef_from_enu @ (rng.normal(0, 1, 3) * sigma), sigma)
        plain = locate(of, looks, guess=guess, errors=frame_errors(), throw=False)
        timed = locate(of, looks, guess=guess, errors=frame_errors(), estimate=(unknown,), throw=False)
        for into, found in ((ignored, plain), (estimated, timed)):
            error = ecef_from_enu.T @ (np.asarray(found.line_m) - target)
            into.append((error, np.asarray(found.looks.covariance_enu_m2[-1])))
        offset.append(float(timed.value[0]) - late[k])

    def summed(cases: list) -> tuple[float, float]:
        error, covariance = (np.stack(part) for part in zip(*cases, strict=True))
        return float(np.sqrt((error**2).sum(axis=1).mean())), float(nees(error, covariance).mean())

    (rmse_ignored, nees_ignored), (rmse_estimated, nees_estimated) = summed(ignored), summed(estimated)
    return Offset(rmse_ignored, rmse_estimated, nees_ignored, nees_estimated, float(np.sqrt(np.mean(np.square(offset)))))
