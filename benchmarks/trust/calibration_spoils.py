"""What can go wrong in a calibration, one kind a function."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from .calibrations import IMAGE, IMAGE_OF, NAMES, POINTS, SIGMA_PX, Case, design
from .score import gain
from .way import Spoil, Spoiled

_UNKNOWNS = len(NAMES)
Rng = np.random.Generator


def within(case: Case, image: str) -> np.ndarray:
    """Control observations of an image in the order of time."""
    rows = case.control[[IMAGE_OF[i] == image for i in case.control]]
    return rows[np.argsort(np.asarray(case.observations.shot.time_s)[rows])]


def names_of(rows: np.ndarray) -> tuple[str, ...]:
    """The points that these observations saw."""
    return tuple(POINTS[i] for i in rows)


def blunders(count: int, sigmas: float) -> Spoil:
    """So many control observations, anywhere, each off by up to twice so many sigmas and no less than once."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = rng.choice(case.control, count, replace=False)
        angle, length = rng.uniform(0, 2 * np.pi, count), sigmas * rng.uniform(1, 2, count)
        off = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) * SIGMA_PX[rows]
        return Spoiled(case.moved(rows, off), names_of(rows))

    return spoil


def coherent(image: str, by_px: tuple[float, float], part: slice = slice(None)) -> Spoil:
    """Control observations of an image, or a run of them in time, all off by the same."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = within(case, image)[part]
        return Spoiled(case.moved(rows, by_px), (image, *(names_of(rows) if len(rows) <= 20 else ())))

    return spoil


def copies(times: int, apart_px: float = 0.0, renamed: bool = False) -> Spoil:
    """Every control observation but one in `times` gives way to copies of that one."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        observed, rows, index = case.observations, case.control, np.arange(len(POINTS))
        for image in np.unique(IMAGE[rows]):
            mine = rows[IMAGE[rows] == image]
            index[mine] = mine[np.arange(len(mine)) // times * times]
        kept = observed.take(index)
        kept = dataclasses.replace(kept, pixel_px=kept.pixel_px + apart_px * rng.standard_normal(kept.pixel_px.shape))
        if renamed:
            kept = dataclasses.replace(kept, points=POINTS)
        return Spoiled(dataclasses.replace(case, observations=kept), names_of(np.unique(index[rows])))

    return spoil


def one_record(together: int, share: float = 1.0) -> Callable[[Case, np.ndarray], np.ndarray]:
    """The correlation of errors where one record was read for so many measurements in a row, or for a share of their variance."""

    def correlation(case: Case, rows: np.ndarray) -> np.ndarray:
        group = np.arange(len(rows)) // together
        return share * (group[:, None] == group[None, :]) + (1 - share) * np.eye(len(rows))

    return correlation


def respread(correlation: Callable[[Case, np.ndarray], np.ndarray]) -> Spoil:
    """Errors of control measurements hang together, image by image, and are as large as stated."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        for image in sorted({IMAGE_OF[i] for i in case.control}):
            rows = within(case, image)
            values, vectors = np.linalg.eigh(correlation(case, rows))
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            change = (root @ case.white[rows] - case.white[rows]) * SIGMA_PX[rows]
            case = case.moved(rows, change)
        return Spoiled(case, ("L1", "R1"))

    return spoil


def respread_witness(correlation: Callable[[Case, np.ndarray], np.ndarray]) -> Callable[[Case], float]:
    """What the best test gains from errors of control that hang together, image by image."""

    def witness(case: Case) -> float:
        rows, covariance = design(case), np.eye(2 * len(POINTS) + _UNKNOWNS)
        for image in sorted({IMAGE_OF[i] for i in case.control}):
            seen = within(case, image)
            for axis in (0, 1):
                covariance[np.ix_(2 * seen + axis, 2 * seen + axis)] = correlation(case, seen)
        return gain(rows, covariance)

    return witness


def fading(scale: Callable[[Case, np.ndarray], np.ndarray], over: float, share: float = 1.0) -> Any:
    """A correlation that fades with the distance in something."""

    def correlation(case: Case, rows: np.ndarray) -> np.ndarray:
        at = scale(case, rows)
        return share * np.exp(-np.abs(at[:, None] - at[None, :]) / over) + (1 - share) * np.eye(len(rows))

    return correlation


def time_s(case: Case, rows: np.ndarray) -> np.ndarray:
    """When, which in a scan is where."""
    return np.asarray(case.observations.shot.time_s)[rows]


def sample_px(case: Case, rows: np.ndarray) -> np.ndarray:
    """Where along the detector."""
    return np.asarray(case.observations.pixel_px)[rows, 0]


def smooth(at: Callable[[Case, np.ndarray], np.ndarray], sigmas: float) -> Spoil:
    """An error that is a smooth function of something, of the shape of a wave with a phase of its own."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows, phase, axis = case.control, rng.uniform(0, 2 * np.pi), int(rng.integers(2))
        x = at(case, rows)
        wave = np.sin(3 * np.pi * (x - x.min()) / np.ptp(x) + phase) * sigmas
        off = np.zeros((len(rows), 2))
        off[:, axis] = wave * SIGMA_PX[rows, axis]
        return Spoiled(case.moved(rows, off), ("L1", "R1"))

    return spoil


def scan(case: Case, rows: np.ndarray) -> np.ndarray:
    """The scan angle: time since the beginning of the swing, sign by side."""
    start = np.array([haian.SCENES[IMAGE_OF[i]][0] for i in rows])
    right = np.array([IMAGE_OF[i][0] == "R" for i in rows])
    return (time_s(case, rows) - start - haian.SWING_S / 2) * np.where(right, -1.0, 1.0)


def number(name: str, where: str, value: float, stays: bool = True, scaled_by: bool = False) -> Spoil:
    """A number of the instrument is another than the sensor says, and nobody asks for it."""
    unknown = wj.Unknown(name, tuple(where.split()), scale=1.0)

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        sign = rng.choice([-1.0, 1.0])
        truth = haian.FOCAL_PX * (1 + sign * value) if scaled_by else sign * value
        changed = case.sensed(lambda sensor: wj.assign(sensor, [unknown], [truth]), stays=stays)
        return Spoiled(changed, tuple(place.text for place in unknown.places))

    return spoil


def one_pose(
    image: str, turn_rad: tuple[float, float, float] = (0, 0, 0), shift_m: tuple[float, float, float] = (0, 0, 0)
) -> Spoil:
    """POS was biased during one image, beyond what is stated."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        bias = wj.Mount(lever_arm_m=np.array(shift_m), angles_rad=np.array(turn_rad))
        rows = np.flatnonzero([name == image for name in IMAGE_OF])
        return Spoiled(case.sensed(lambda sensor: sensor.after("body", "bias", bias), rows, stays=False), (image, image[1:]))

    return spoil


def stated(factor: float, images: tuple[str, ...] = ("L1",)) -> Spoil:
    """The errors of images are `factor` times as large as their sigmas say."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows, sigma = np.isin(IMAGE_OF, images), np.array(case.observations.sigma_px)
        sigma[rows] /= factor
        observed = dataclasses.replace(case.observations, sigma_px=sigma)
        return Spoiled(dataclasses.replace(case, observations=observed), images)

    return spoil


def stated_witness(factor: float, images: tuple[str, ...] = ("L1",)) -> Callable[[Case], float]:
    """What the best test gains from it."""
    times = np.ones(2 * len(POINTS) + _UNKNOWNS)
    times[: 2 * len(POINTS)] = np.where(np.repeat(np.isin(IMAGE_OF, images), 2), factor, 1.0)
    return lambda case: gain(design(case) * times[:, None], np.diag(times**2))


def prior(sigmas: float, which: tuple[str, ...] = NAMES, tighter: float = 1.0) -> Spoil:
    """The prior of a number is so many sigmas off, with a sigma that may be `tighter` times too small."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        k, sign = NAMES.index(str(rng.choice(which))), rng.choice([-1.0, 1.0])
        unknowns, old = list(case.unknowns), case.unknowns[k]
        sigma = old.sigma / tighter
        mean = old.mean + sign * sigmas * sigma
        if tighter > 1:  # what was believed is so many of its own sigmas beside the truth
            mean = case.truth[k] + sign * sigmas * sigma
        unknowns[k] = dataclasses.replace(old, mean=mean, sigma=sigma)
        return Spoiled(dataclasses.replace(case, unknowns=tuple(unknowns)), (old.name,))

    return spoil


def surveyed(by_enu_m: tuple[float, float, float], role: str = "control") -> Spoil:
    """All control points, all check points or all of both are said to be elsewhere."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        observed, control = case.observations, np.asarray(case.observations.is_control)
        rows = {"control": control, "check": ~control, "all": np.ones_like(control)}[role]
        by_m = np.asarray(wj.enu_rotation(haian.LAT_RAD, haian.LON_RAD)) @ np.array(by_enu_m)
        point = np.asarray(observed.point_m) + rows[:, None] * by_m
        culprits = (role, *(names_of(np.flatnonzero(rows)) if role == "check" else ("datum", "u_gps", "v_gps", "w_gps")))
        return Spoiled(dataclasses.replace(case, observations=dataclasses.replace(observed, point_m=point)), culprits)

    return spoil


def measured(change: Callable[[np.ndarray], np.ndarray], culprit: str) -> Spoil:
    """All pixels were written down in another convention."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        pixel = change(np.array(case.observations.pixel_px))
        return Spoiled(dataclasses.replace(case, observations=dataclasses.replace(case.observations, pixel_px=pixel)), (culprit,))

    return spoil


def late(by_s: float) -> Spoil:
    """The clock of the camera runs late."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        observed = case.observations
        shot = dataclasses.replace(observed.shot, time_s=np.asarray(observed.shot.time_s) + by_s)
        return Spoiled(
            dataclasses.replace(case, observations=dataclasses.replace(observed, shot=shot)), ("time", "delay", "time_s")
        )

    return spoil


def turned_record(change: Callable[[wj.Sensor], wj.Sensor], culprit: str) -> Spoil:
    """The sensor that is handed over is described in another convention."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(dataclasses.replace(case, sensor=change(case.sensor)), (culprit,))

    return spoil


def then(spoil: Spoil, **fields: Any) -> Spoil:
    """The same with other fields of the case, as weights from the data."""

    def both(case: Case, rng: Rng) -> Spoiled[Case]:
        spoiled = spoil(case, rng)
        return Spoiled(dataclasses.replace(spoiled.case, **fields), spoiled.culprits)

    return both


def weak(case: Case, rng: Rng) -> Spoiled[Case]:
    """Nothing is wrong, but control lies in one corner of each image: the others become check points."""
    kept = np.zeros(len(POINTS), dtype=bool)
    for image in ("L1", "R1"):
        kept[within(case, image)[:12]] = True
    return Spoiled(dataclasses.replace(case, observations=dataclasses.replace(case.observations, is_control=kept)))
