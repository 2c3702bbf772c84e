"""One target over the Tianshan seen in 40 looks from an orbit, with index errors of the gimbal drawn from their priors."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np

import whiskjax as wj
from whiskjax.flights import tianshan

from .score import misfit_of
from .way import Judged

LOOKS = 40
ORBIT = tianshan.Scene("orbit", looks=LOOKS)
TIME_S = tianshan.time_s(ORBIT)
SIGMA_PX, GUESS_M = 2.0, 500.0
ZERO_RAD = float(np.radians(0.02))
ZEROS = {"gimbal_roll_zero": "gimbal_roll.zero_rad", "gimbal_pitch_zero": "gimbal_pitch.zero_rad"}
NAMES = ("east", "north", "up", *ZEROS)
LABELS = tuple(f"look {i}" for i in range(LOOKS))


@dataclasses.dataclass(frozen=True)
class Case:
    """What `locate` is given, and what was true.

    - `errors_seed`: of the draw, by which a spoil draws other errors; None without noise.
    - `focal_px`: what the sensor says; `target_m`: where the target is, `guess_m` where it is believed to be.
    - `zero_rad`: the true index errors of the gimbal; `prior_mean_rad`, `prior_sigma_rad`: what is known of them.
    - `errors`: as stated; how they are drawn a spoil may change; `time_s`: as stamped, where it is not that of the scene.
    """

    scene: tianshan.Scene
    errors_seed: int | None
    recorded: tianshan.Recorded
    pixel_px: np.ndarray
    target_m: np.ndarray
    guess_m: np.ndarray
    guess_sigma_m: float
    zero_rad: np.ndarray
    prior_mean_rad: np.ndarray
    prior_sigma_rad: np.ndarray
    errors: tuple[wj.FrameErrors, ...]
    sigma_px: float = SIGMA_PX
    focal_px: float = tianshan.FOCAL_PX
    gate: float | None = None
    time_s: np.ndarray | None = None

    def read(self, **records: Any) -> "Case":
        """With other records, each (looks,)."""
        return dataclasses.replace(self, recorded=dataclasses.replace(self.recorded, **records))

    def moved(self, rows: Any, by_px: Any) -> "Case":
        """Looks measured elsewhere."""
        pixel = np.array(self.pixel_px)
        pixel[rows] += by_px
        return dataclasses.replace(self, pixel_px=pixel)

    def erring(self, errors: tuple[wj.FrameErrors, ...]) -> "Case":
        """The same truth, drawn with other errors than those stated; without noise the same."""
        if self.errors_seed is None:
            return self
        recorded, pixel = _drawn(jax.random.key(self.errors_seed), self.scene, errors)
        return _indexed(dataclasses.replace(self, recorded=_plain(recorded), pixel_px=np.asarray(pixel)))


@dataclasses.dataclass(frozen=True, eq=False)
class Targets:
    """A target located by a method, from looks of a scene."""

    method: str = "iterated"
    scene: tianshan.Scene = ORBIT
    verb: str = "locate"

    def draw(self, seed: int, noise: bool) -> Case:
        rng, errors = np.random.default_rng([1, seed]), tianshan.frame_errors()
        zero = ZERO_RAD * rng.standard_normal(2)
        lat_deg, lon_deg, height_m = self.scene.target
        target = np.asarray(wj.geodetic_to_ecef(np.radians(lat_deg), np.radians(lon_deg), height_m))
        recorded, pixel = tianshan.true_records(self.scene), np.zeros((self.scene.looks, 2))
        if noise:
            recorded, pixel = _drawn(jax.random.key(seed), self.scene, errors)
        return _indexed(
            Case(
                scene=self.scene,
                errors_seed=seed if noise else None,
                recorded=_plain(recorded),
                pixel_px=np.asarray(pixel),
                target_m=target,
                guess_m=target + GUESS_M * rng.standard_normal(3) * noise,
                guess_sigma_m=GUESS_M,
                zero_rad=zero,
                prior_mean_rad=zero * (not noise),
                prior_sigma_rad=np.full(2, ZERO_RAD),
                errors=errors,
            )
        )

    def answer(self, case: Case, method: str) -> wj.Location:
        """The location of a case."""
        sensor = tianshan.sensor(case.recorded)
        sensor = eqx.tree_at(lambda s: s.camera.focal_px, sensor, np.asarray(case.focal_px, dtype=float))
        time = tianshan.time_s(case.scene) if case.time_s is None else case.time_s
        known = zip(ZEROS.items(), case.prior_mean_rad, case.prior_sigma_rad, strict=True)
        return wj.locate(
            sensor,
            wj.Looks(wj.Shot(time_s=time), case.pixel_px, (case.sigma_px, case.sigma_px)),
            guess=wj.Guess.around(case.guess_m, (case.guess_sigma_m,) * 3),
            errors=case.errors,
            method=method,
            estimate=[wj.Unknown(name, where, float(mean), float(sigma)) for (name, where), mean, sigma in known],
            gate=case.gate,
            throw=False,
        )

    def judged(self, case: Case) -> Judged:
        answer = self.answer(case, self.method)
        axes, spread = np.asarray(answer.world_from_enu), np.asarray(answer.covariance_enu_m2)
        error = axes.T @ (np.asarray(answer.point_m) - case.target_m)
        off = (np.asarray(answer.value) - case.zero_rad) / np.asarray(answer.estimate.sigma)
        if not np.isfinite(spread).all():
            return Judged(answer.reasons, NAMES, (np.nan,) * len(NAMES), np.inf, 3)
        each = (*(error / np.sqrt(np.diag(spread))).tolist(), *off.tolist())
        return Judged(answer.reasons, NAMES, each, float(error @ np.linalg.solve(spread, error)), 3)

    def misfit(self, case: Case) -> float:
        answer = self.answer(dataclasses.replace(case, gate=None), "batch")
        return misfit_of(answer.result, float(answer.chi_square))


def _indexed(case: Case) -> Case:
    """The gimbal reads less than it turned, by its index errors."""
    r = case.recorded
    roll, pitch = case.zero_rad
    return case.read(gimbal_roll_rad=r.gimbal_roll_rad - roll, gimbal_pitch_rad=r.gimbal_pitch_rad - pitch)


def _plain(recorded: tianshan.Recorded) -> tianshan.Recorded:
    """Records of numpy."""
    return jax.tree.map(np.asarray, recorded)


@eqx.filter_jit
def _drawn(key: Any, scene: tianshan.Scene, errors: tuple[wj.FrameErrors, ...]) -> tuple[tianshan.Recorded, Any]:
    return tianshan.draw(key, scene, errors)
