"""Wang et al. (2018) as runs over the simulated blocks: their tables, and what they leave open."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...estimate.block.adjust import adjust
from ...estimate.block.adjustment import Adjustment
from ...estimate.block.block import Block
from ...estimate.block.direct import Direct, direct_positioning
from ...estimate.block.two_step import TwoStep, two_step
from ...estimate.blunders import Blunders
from ...estimate.consistency import nees
from ...estimate.unknown import Unknown, assign
from ...estimate.variance_components import Reweigh
from ...flights.songshan import LINE_S, Scene, Simulated, frame_errors, simulate_block, unknowns
from ...flights.songshan_draw import BORESIGHT_RAD, LEVER_ARM_M, STRIP_S, start_s

MOUNTS = ("u", "v", "w", "ex", "ey", "ez")
TRUE_MOUNTS = np.concatenate([LEVER_ARM_M, BORESIGHT_RAD])
WRONG_SHARE, WRONG_PX = 0.05, 20.0
_ATTITUDE_S = 0.25
_FOUND = Reweigh(priors=True)  # sigmas of rays, points and POS from the data


class Run(NamedTuple):
    """A simulated block and its adjustment."""

    scene: Scene
    seed: int
    drawn: Simulated
    adjusted: Adjustment

    @property
    def mount_errors(self) -> Float[np.ndarray, "2 6"]:
        """Lever arm and boresight: found less true, and the predicted sigma (m, rad)."""
        return np.stack([self.adjusted.value[:6] - TRUE_MOUNTS, self.adjusted.trust.sigma[:6]])


def run(scene: Scene, seed: int, white: bool = False, reweigh: bool = False) -> Run:
    """Draw and adjust. **Arguments:** `white`: POS errors are taken as white; `reweigh`: sigmas are found from the data."""
    drawn, errors = simulate_block(scene, seed), frame_errors(scene, white)
    return Run(
        scene, seed, drawn, adjust(drawn.sensor, drawn.block, unknowns(scene), errors=errors, reweigh=_FOUND if reweigh else None)
    )


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """The four trials of the paper on one block; `value` and `sigma` are those of `unknowns`, in the units of their fields."""

    drawn: Simulated
    unknowns: tuple[Unknown, ...]
    direct: Direct
    adjusted: Adjustment
    second: Direct
    third: Direct

    @property
    def value(self) -> Float[np.ndarray, " q"]:
        """What the adjustment found."""
        return self.adjusted.value


def calibrated(scene: Scene, seed: int) -> Calibrated:
    """Direct positioning, the adjustment, and direct positioning with its detector lines (second) and all its numbers (third)."""
    numbers = unknowns(scene)
    _, _, drawn, found = run(scene, seed)
    lines = [i for i, x in enumerate(numbers) if x.name not in MOUNTS]
    second = assign(drawn.sensor, [numbers[i] for i in lines], found.value[lines])
    return Calibrated(
        drawn,
        numbers,
        direct_positioning(drawn.sensor, drawn.block),
        found,
        direct_positioning(second, drawn.block),
        direct_positioning(assign(drawn.sensor, numbers, found.value), drawn.block),
    )


def spread_control(block: Block, count: int) -> Int[np.ndarray, " count"]:
    """So many control points, far from each other: each is the farthest in plan from those before; the first is the outermost."""
    control = np.flatnonzero(block.role == "control")
    plan = block.position_m[control, :2]
    chosen = [int(np.argmax(np.linalg.norm(plan - plan.mean(axis=0), axis=1)))]
    while len(chosen) < count:
        distance = np.linalg.norm(plan[:, None] - plan[chosen], axis=-1).min(axis=1)
        chosen.append(int(np.argmax(distance)))
    return control[chosen]


def readjusted(scene: Scene, block: Block, sensor: Sensor, count: int) -> Adjustment:
    """Adjust with `count` of the control points and a calibrated sensor that stays as it is (Wang et al. 2018, section 5.3).

    POS corrections and points are all that is unknown. The other control points become tie points; the check points are those of
    the calibration, in which they took no part.
    """
    role = block.role.copy()
    role[role == "control"] = "tie"
    role[spread_control(block, count)] = "control"
    return adjust(sensor, dataclasses.replace(block, role=role), errors=frame_errors(scene))


class Followed(NamedTuple):
    """How close an adjustment came: RMSE of tie points in space, RMS about an axis of body and camera attitude over the strips.

    The body's contains what the boresight has in common with POS: a constant that only POS sees. The camera's, which is the
    exterior orientation, is what images see.
    """

    tie_rmse_m: float
    body_rms_rad: float
    camera_rms_rad: float


def followed(run: Run) -> Followed:
    """Compare with the truth."""
    block, found, truth = run.drawn.block, run.adjusted, run.drawn.truth
    squared = ((found.point_m - run.drawn.point_m)[block.role == "tie"] ** 2).sum(axis=1)
    body, camera = (attitude_rms_rad(run.scene, found.sensor, truth, frame) for frame in ("body", "camera"))
    return Followed(float(np.sqrt(squared.mean())), body, camera)


def attitude_rms_rad(scene: Scene, found: Sensor, truth: Sensor, frame: str) -> float:
    """RMS of the small turns, about one axis, between the "body" (corrections included) or the "camera" of two sensors."""
    within = np.arange(_ATTITUDE_S, STRIP_S, _ATTITUDE_S)
    time_s = (start_s(len(scene.data.strips))[:, None] + within).ravel()
    a, b = (_attitude(sensor, frame, time_s) for sensor in (found, truth))
    turn = np.einsum("...ij,...kj->...ik", a, b)  # small: its skew part is the turn
    skew = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]) / 2
    return float(np.sqrt((skew**2).mean()))


def _attitude(sensor: Sensor, frame: str, time_s: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
    last = "boresight" if frame == "camera" else "pos_error" if "pos_error" in sensor.names else "body"
    rotation = sensor.pose(Shot(time_s=time_s), last).rotation
    rows = [np.broadcast_arrays(*(np.asarray(c, dtype=float) for c in row), time_s)[:3] for row in rotation]
    return np.moveaxis(np.array(rows), -1, 0)


class Spoilt(NamedTuple):
    """With wrong ties: which points are wrong, which lost a ray (of all tie points), and check RMSE of three adjustments."""

    wrong: np.ndarray
    rejected: np.ndarray
    clean_m: Float[np.ndarray, "3"]
    plain_m: Float[np.ndarray, "3"]
    found_m: Float[np.ndarray, "3"]

    @property
    def found_share(self) -> float:
        """Of the wrong points."""
        return float(self.rejected[self.wrong].mean())

    @property
    def false_share(self) -> float:
        """Of the right points."""
        return float(self.rejected[~self.wrong].mean())


def spoil(block: Block, seed: int) -> tuple[Block, np.ndarray]:
    """The block with one ray of 5 % of its tie points moved, in sample and line, by up to 20 px to either side (uniform).

    **Returns:** it, and which points (points,) are wrong.
    """
    rng = np.random.default_rng([seed, 5])
    ties = np.flatnonzero(block.role == "tie")
    wrong = np.zeros(len(block.role), dtype=bool)
    wrong[rng.permutation(ties)[: round(WRONG_SHARE * len(ties))]] = True
    order = rng.permutation(len(block))
    point, first = np.unique(block.point[order], return_index=True)  # one ray of each point, at random
    ray = order[first[wrong[point]]]
    move = rng.uniform(-WRONG_PX, WRONG_PX, (len(ray), 2))
    pixel, time = block.pixel_px.copy(), np.array(block.key("time_s"))
    pixel[ray, 0] += move[:, 0]
    time[ray] += LINE_S * move[:, 1]
    shot = Shot(time_s=time, view=block.key("view"), strip=block.key("strip"))
    return dataclasses.replace(block, shot=shot, pixel_px=pixel), wrong


def wrong_ties(clean: Run) -> Spoilt:
    """Spoil a block, and adjust it as it is and with the search for wrong rays."""
    block, wrong = spoil(clean.drawn.block, clean.seed)
    numbers, errors = unknowns(clean.scene), frame_errors(clean.scene)
    plain, found = (adjust(clean.drawn.sensor, block, numbers, errors=errors, blunders=b) for b in (None, Blunders()))
    lost = np.zeros(len(wrong), dtype=bool)
    lost[block.point[~found.used]] = True
    tie = block.role == "tie"
    rmse = [np.array([axis.rmse for axis in a.statistics()]) for a in (clean.adjusted, plain, found)]
    return Spoilt(wrong[tie], lost[tie], *rmse)


class Honest(NamedTuple):
    """NEES / 3 of the tie points (1 where covariances are honest), and the variance factor."""

    nees: float
    variance_factor: float


def honest(run: Run) -> Honest:
    """Hold the covariance of tie points against their errors."""
    tie, found = run.drawn.block.role == "tie", run.adjusted
    squared = nees((found.point_m - run.drawn.point_m)[tie], found.covariance_m2[tie])
    return Honest(float(squared.mean()) / 3, found.variance_factor)


class Weighed(NamedTuple):
    """Estimated over true sigma of each group, what it started from, and the predicted relative sigma of the estimate."""

    names: tuple[str, ...]
    start: Float[np.ndarray, " groups"]
    reached: Float[np.ndarray, " groups"]
    predicted: Float[np.ndarray, " groups"]


def weights(scene: Scene, seed: int) -> Weighed:
    """Sigmas from the data, where those of ties and of POS are given 3 times too large and those of points 3 times too small."""
    drawn = simulate_block(scene, seed)
    block = drawn.block
    tie = block.role[block.point] == "tie"
    given = dataclasses.replace(
        block, sigma_px=block.sigma_px * np.where(tie, 3.0, 1 / 3)[:, None], covariance_m2=block.covariance_m2 / 9
    )
    components = adjust(drawn.sensor, given, unknowns(scene), errors=frame_errors(scene, scale=3.0), reweigh=_FOUND).components
    assert components is not None
    start = np.array([3.0, 1 / 3, 3.0, 3.0])
    return Weighed(tuple(components.names), start, start * components.factor, components.log_sigma)


class Loop(NamedTuple):
    """The two-step loop beside the joint solution; `distance`: largest mount difference in predicted sigmas, after each round."""

    loop: TwoStep
    distance: Float[np.ndarray, " rounds"]


def two_steps(scene: Scene, seed: int, white: bool, max_rounds: int) -> Loop:
    """The paper's loop and the joint adjustment of one block, with POS errors taken as correlated or as white."""
    drawn, numbers, errors = simulate_block(scene, seed), unknowns(scene), frame_errors(scene, white)
    joint = adjust(drawn.sensor, drawn.block, numbers, errors=errors)
    block = joint.block  # its rays are at their crossings already
    loop = two_step(drawn.sensor, block, numbers, errors=errors, mounts=MOUNTS, retime=False, max_rounds=max_rounds)
    return Loop(loop, np.abs((loop.values - joint.value[:6]) / joint.trust.sigma[:6]).max(axis=1))
