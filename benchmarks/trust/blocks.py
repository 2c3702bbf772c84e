"""A block of twelve frame images in three strips over a local world, its truth drawn from priors and stated errors."""

import dataclasses
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import whiskjax as wj

from .score import misfit_of
from .way import Judged

STRIPS, PER_STRIP, CENTRE_PX, FOCAL_PX = 3, 4, np.array([2000.0, 1500.0]), 3000.0
IMAGES = tuple(f"S{1 + i // PER_STRIP}-{1 + i % PER_STRIP}" for i in range(STRIPS * PER_STRIP))
STRIP_NAMES = tuple(f"S{1 + s}" for s in range(STRIPS))
STRIP = np.arange(len(IMAGES)) // PER_STRIP
_PLACE_M = np.array([[300.0 * (i % PER_STRIP), 400.0 * (i // PER_STRIP), 900.0] for i in range(len(IMAGES))])
_KAPPA_RAD = np.where(STRIP % 2 == 0, 0.0, np.pi)

CONTROL, CHECK, TIES = 8, 6, 70
ROLE = np.array(["control"] * CONTROL + ["check"] * CHECK + ["tie"] * TIES)
POINTS = tuple(f"{role[0].upper()}{1 + i:02d}" for i, role in enumerate(ROLE))
JUDGED = np.arange(CONTROL, CONTROL + 20)  # points beside whose truth the answer is laid: all check points, and ties

SIGMA_PX, SURVEY_M, TURN_RAD, SHIFT_M = 0.5, 0.02, 1e-4, 0.05
ERRORS = (wj.FrameErrors("photo", (TURN_RAD,) * 3, (SHIFT_M,) * 3),)
PLACES = {
    "lever_x": "mount.lever_arm_m[0]",
    "lever_y": "mount.lever_arm_m[1]",
    "lever_z": "mount.lever_arm_m[2]",
    "omega": "mount.angles_rad[0]",
    "phi": "mount.angles_rad[1]",
    "kappa": "mount.angles_rad[2]",
    "focal": "camera.focal_px",
}
NAMES = tuple(PLACES)
START = np.array([0.0, 0, 0, 0, 0, 0, FOCAL_PX])
PRIOR_SIGMA = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3, 2.0])
EQUAL = np.array([0.05, 0.05, 0.05, 5e-4, 5e-4, 5e-4, 0.5])  # each moves the image by about as much


def _layout() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where points are about, (n, 2), and image and point of every ray: points of three rays or more, the same for all seeds."""
    rng = np.random.default_rng(20)
    where = rng.uniform([-300.0, -250.0], [1200.0, 1050.0], (400, 2))
    from_centre = (where[None] - _PLACE_M[:, None, :2]) / _PLACE_M[:, None, 2:] * FOCAL_PX
    seen = (np.abs(from_centre) < 0.92 * CENTRE_PX).all(axis=2)
    where, seen = where[seen.sum(axis=0) > 2][: len(ROLE)], seen[:, seen.sum(axis=0) > 2][:, : len(ROLE)]
    # Control is spread: the points farthest out in eight directions.
    way = np.linspace(0, 2 * np.pi, CONTROL, endpoint=False)
    left, first = list(range(len(where))), []
    for k in range(CONTROL):
        along = (where - where.mean(axis=0)) @ [np.cos(way[k]), np.sin(way[k])]
        first.append(max(left, key=lambda i: along[i]))
        left.remove(first[-1])
    order = [*first, *left]
    image, point = np.nonzero(seen[:, order])
    return where[order], image, point


WHERE_M, IMAGE, POINT = _layout()
SHOT = wj.Shot(image=IMAGE, strip=STRIP[IMAGE])
IMAGE_OF = tuple(IMAGES[i] for i in IMAGE)


@dataclasses.dataclass(frozen=True)
class Case:
    """What `adjust` is given, and what was true.

    - `truth`: values of the unknowns; `point_m`: where the points are, and which of them the answer is laid beside, `judged`.
    - `true_sensor`: which imaged them; `white`: errors of the pixels in sigmas.
    """

    sensor: wj.Sensor
    block: wj.Block
    unknowns: tuple[wj.Unknown, ...]
    errors: tuple[wj.FrameErrors, ...]
    truth: np.ndarray
    point_m: np.ndarray
    true_sensor: wj.Sensor
    white: np.ndarray
    judged: np.ndarray
    reweigh: wj.Reweigh | None = None
    blunders: wj.Blunders | None = None

    def moved(self, rows: Any, by_px: Any) -> "Case":
        """Rays measured elsewhere."""
        pixel = np.array(self.block.pixel_px)
        pixel[rows] += by_px
        return self.given(pixel_px=pixel)

    def given(self, **fields: Any) -> "Case":
        """With other numbers of the block."""
        return dataclasses.replace(self, block=dataclasses.replace(self.block, **fields))

    def imaged(self, sensor: wj.Sensor, rows: Any = slice(None)) -> "Case":
        """These rays were seen by another instrument than the true one, of which nobody knows."""
        by = np.asarray(projected(sensor, SHOT, self.point_m[POINT]) - projected(self.true_sensor, SHOT, self.point_m[POINT]))
        return self.moved(rows, by[rows])


@dataclasses.dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks whose truth is drawn from these prior sigmas; with `reweigh`, sigmas are found from the data."""

    sigma: np.ndarray = dataclasses.field(default_factory=lambda: PRIOR_SIGMA)
    reweigh: wj.Reweigh | None = None
    verb: str = "adjust"

    def draw(self, seed: int, noise: bool) -> Case:
        rng = np.random.default_rng([2, seed])
        truth = START + self.sigma * rng.standard_normal(len(START))
        point = np.column_stack([WHERE_M, rng.uniform(0, 60, len(ROLE))])
        tilt = rng.normal(0, 0.01, (len(IMAGES), 2))
        recorded = Rotation.from_euler("ZYX", np.column_stack([_KAPPA_RAD, tilt]))
        place = _PLACE_M + rng.normal(0, 3, _PLACE_M.shape)
        turn, shift = (sigma * rng.standard_normal((len(IMAGES), 3)) * noise for sigma in (TURN_RAD, SHIFT_M))
        true_sensor = _sensor(place + recorded.apply(shift), recorded * Rotation.from_rotvec(turn), truth)
        white, survey = (rng.standard_normal((n, k)) * noise for n, k in ((len(POINT), 2), (len(ROLE), 3)))
        block = wj.Block(
            SHOT,
            np.asarray(projected(true_sensor, SHOT, point[POINT])) + SIGMA_PX * white,
            np.full((len(POINT), 2), SIGMA_PX),
            POINT,
            np.where((ROLE == "tie")[:, None], np.nan, point + SURVEY_M * survey),
            np.broadcast_to(np.eye(3) * SURVEY_M**2, (len(ROLE), 3, 3)),
            ROLE,
            points=POINTS,
            images=IMAGE_OF,
            strips=STRIP_NAMES,
        )
        known = zip(PLACES.items(), START if noise else truth, self.sigma, strict=True)
        return Case(
            sensor=_sensor(place, recorded, START),
            block=block,
            unknowns=tuple(wj.Unknown(name, where, float(mean), float(sigma)) for (name, where), mean, sigma in known),
            errors=ERRORS,
            truth=truth,
            point_m=point,
            true_sensor=true_sensor,
            white=white,
            judged=JUDGED,
            reweigh=self.reweigh,
        )

    def answer(self, case: Case) -> wj.Adjustment:
        """The adjustment of a case."""
        return wj.adjust(
            case.sensor,
            case.block,
            case.unknowns,
            errors=case.errors,
            reweigh=case.reweigh,
            blunders=case.blunders,
            throw=False,
        )

    def judged(self, case: Case) -> Judged:
        answer = self.answer(case)
        with np.errstate(invalid="ignore"):
            off = (np.asarray(answer.value) - case.truth) / np.asarray(answer.estimate.sigma)
        return Judged(answer.reasons, NAMES, tuple(off.tolist()), _worst_point(answer, case), 1)

    def misfit(self, case: Case) -> float:
        answer = self.answer(dataclasses.replace(case, reweigh=None, blunders=None))
        return misfit_of(answer.result, float(answer.cost) + answer.check.chi_square)


def _worst_point(answer: wj.Adjustment, case: Case) -> float:
    """The chance of a point as far off, times their number (Bonferroni), as a chi-square of one degree of freedom."""
    error = (np.asarray(answer.point_m) - case.point_m)[case.judged]
    spread = np.asarray(answer.covariance_m2)[case.judged]
    known = np.isfinite(error).all(axis=1) & np.isfinite(spread).all(axis=(1, 2))
    if not known.any():
        return np.inf
    each = np.einsum("ni,ni->n", error[known], np.linalg.solve(spread[known], error[known][:, :, None])[..., 0])
    return float(chi2.isf(min(1.0, known.sum() * chi2.sf(each.max(), 3)), 1))


def _sensor(place_m: np.ndarray, attitude: Rotation, values: Any, turn_rad: Any = None, shift_m: Any = None) -> wj.Sensor:
    """Twelve poses, a mount, a camera."""
    links = {"photo": wj.PosePerImage(place_m, attitude.as_quat(), turn_rad, shift_m), "mount": wj.Mount(values[:3], values[3:6])}
    return wj.Sensor(links, wj.FrameCamera(values[6], CENTRE_PX))


@eqx.filter_jit
def projected(sensor: wj.Sensor, shot: wj.Shot, point_m: Any) -> Any:
    """The pixels of points."""
    return wj.project(sensor, shot, point_m, throw=False).pixel_px


# Of every number that is observed its kind: both coordinates of rays, turns and shifts of POS, coordinates, priors.
RAYS, POS, SURVEY = slice(0, 2 * len(POINT)), slice(2 * len(POINT), 2 * len(POINT) + 6 * len(IMAGES)), CONTROL + CHECK
OBSERVED = 2 * len(POINT) + 6 * len(IMAGES) + 3 * SURVEY + len(NAMES)


@cache
def design() -> np.ndarray:
    """Whitened derivatives of all that is observed by turns and shifts, points and unknowns, at the layout without tilts: (m, k).

    In the order of the rows: rays, POS, control and check points, priors.
    """
    level, n = Rotation.from_euler("z", _KAPPA_RAD[:, None]), len(ROLE)
    point = jnp.asarray(np.column_stack([WHERE_M, np.full(n, 30.0)]))
    sizes = np.cumsum([3 * len(IMAGES), 3 * len(IMAGES), 3 * n])

    def pixels(x: Any) -> Any:
        turn, shift, by, values = jnp.split(x, sizes)
        sensor = _sensor(_PLACE_M, level, START + values, turn.reshape(-1, 3), shift.reshape(-1, 3))
        return projected(sensor, SHOT, (point + by.reshape(-1, 3))[POINT]).ravel()

    rays = np.asarray(jax.jacfwd(pixels)(jnp.zeros(sizes[-1] + len(NAMES)))) / SIGMA_PX
    sigma = np.concatenate([np.full(sizes[0], TURN_RAD), np.full(sizes[0], SHIFT_M), np.full(3 * n, SURVEY_M), PRIOR_SIGMA])
    known = np.diag(1 / sigma)[np.r_[: sizes[1] + 3 * SURVEY, sizes[2] : len(sigma)]]
    return np.concatenate([rays, known])
