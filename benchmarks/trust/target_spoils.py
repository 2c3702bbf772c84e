"""What can go wrong with a target, one kind a function."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

import whiskjax as wj
from whiskjax.flights import tianshan

from .score import alike, scaled
from .targets import LABELS, LOOKS, TIME_S, ZEROS, Case
from .way import Spoil, Spoiled

Rng = np.random.Generator
_FRAMES = ("body", "gimbal_roll", "gimbal_pitch")
_NUMBERS = 2  # of which the gimbal's index errors take a share of what looks have in common


def off(looks: slice | int, by_px: tuple[float, float]) -> Spoil:
    """A run of looks, or so many anywhere, measured beside the target; those anywhere each in a direction of its own."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        if isinstance(looks, slice):
            rows, by = np.arange(LOOKS)[looks], np.broadcast_to(by_px, (len(range(LOOKS)[looks]), 2))
        else:
            rows = rng.choice(LOOKS, looks, replace=False)
            angle = rng.uniform(0, 2 * np.pi, looks)
            by = np.hypot(*by_px) * rng.uniform(1, 2, looks)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Spoiled(case.moved(rows, by), tuple(LABELS[i] for i in rows))

    return spoil


def one_record(together: int) -> Spoil:
    """One navigation record served so many looks in a row: each was imaged from where it was, with the errors of the first."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        first, truth, changed = np.arange(LOOKS) // together * together, tianshan.true_records(case.scene), {}
        for name in ("lat_rad", "lon_rad", "height_m", "roll_rad", "pitch_rad", "heading_rad"):
            true = np.asarray(getattr(truth, name))
            changed[name] = true + (getattr(case.recorded, name) - true)[first]
        return Spoiled(case.read(**changed), (*LABELS, "body", "time"))

    return spoil


def one_record_witness(together: int) -> Callable[[Case], float]:
    """Of both coordinates: gimbal and pixel, a tenth of the variance, stay each look's own."""
    group = np.arange(LOOKS) // together
    return lambda case: 2 * alike(0.9 * (group[:, None] == group[None, :]) + 0.1 * np.eye(LOOKS), 3)


def copied(times: int, apart_px: float = 0.0) -> Spoil:
    """All but one look in `times` are copies of that one: records, times and pixels, but for a trifle."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        first = np.arange(LOOKS) // times * times
        fields = (field.name for field in dataclasses.fields(case.recorded))
        case = case.read(**{name: np.asarray(getattr(case.recorded, name))[first] for name in fields})
        pixel = case.pixel_px[first] + apart_px * rng.standard_normal((LOOKS, 2))
        return Spoiled(dataclasses.replace(case, pixel_px=pixel, time_s=TIME_S[first]), LABELS)

    return spoil


def remembered(correlation_s: float) -> Spoil:
    """Errors of the records last, where they are stated to be new at every look."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.erring(tianshan.frame_errors(correlation_s=correlation_s)), (*_FRAMES, "time", "time_s"))

    return spoil


def remembered_witness(correlation_s: float) -> Callable[[Case], float]:
    """Both coordinates of the looks, whose errors are those of the records but for a thousandth; target and zeros take five."""
    apart = np.abs(TIME_S[:, None] - TIME_S[None, :])
    covariance = 0.999 * np.exp(-apart / correlation_s) + 0.001 * np.eye(LOOKS)
    return lambda case: 2 * alike(covariance, 3)


def constant(culprit: str, **by: Any) -> Spoil:
    """Records are off by the same in all looks: of metres along north and east, `north_m` and `east_m`."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        r, changed = case.recorded, {}
        for name, value in by.items():
            if name in ("north_m", "east_m"):
                radius = 6.37e6 * (1.0 if name == "north_m" else float(np.cos(np.mean(r.lat_rad))))
                field = "lat_rad" if name == "north_m" else "lon_rad"
                changed[field] = getattr(r, field) + value / radius
            else:
                changed[name] = getattr(r, name) + value
        return Spoiled(case.read(**changed), (culprit, *by))

    return spoil


def lagging(looks: int) -> Spoil:
    """Positions are those of so many looks earlier; the last ones stay where the path ends."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        earlier = np.maximum(np.arange(LOOKS) - looks, 0)
        fields = ("lat_rad", "lon_rad", "height_m")
        return Spoiled(case.read(**{name: getattr(case.recorded, name)[earlier] for name in fields}), ("time", "time_s", "body"))

    return spoil


def late(by_s: float) -> Spoil:
    """Positions alone are late: along the path by speed times delay."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        r = case.recorded
        way = by_s / tianshan.SPACING_S
        lat, lon = (np.gradient(np.asarray(getattr(tianshan.true_records(case.scene), name))) for name in ("lat_rad", "lon_rad"))
        return Spoiled(
            case.read(lat_rad=r.lat_rad - way * lat, lon_rad=r.lon_rad - way * lon), ("delay", "time", "time_s", "body")
        )

    return spoil


def stated(factor: float) -> Spoil:
    """All errors are `factor` times as large as stated."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        errors = tianshan.frame_errors(tianshan.TABLE_1.scaled(1 / factor))
        return Spoiled(dataclasses.replace(case, errors=errors, sigma_px=case.sigma_px / factor), _FRAMES)

    return spoil


def stated_witness(factor: float) -> Callable[[Case], float]:
    """Of both coordinates of all looks, less what target and index errors take."""
    return lambda case: scaled(factor, 2 * LOOKS - 3 - _NUMBERS)


def guess(sigmas: float, tighter: float = 1.0) -> Spoil:
    """Where the target was believed to be is so many sigmas off, and the sigma `tighter` times smaller."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        sigma, way = case.guess_sigma_m / tighter, rng.standard_normal(3)
        point = case.target_m + sigmas * sigma * way / np.linalg.norm(way)
        return Spoiled(dataclasses.replace(case, guess_m=point, guess_sigma_m=sigma), ("guess",))

    return spoil


def prior(sigmas: float, tighter: float = 1.0) -> Spoil:
    """What is known of one index error is so many sigmas off, and its sigma `tighter` times smaller."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        k, sign = int(rng.integers(2)), rng.choice([-1.0, 1.0])
        sigma, mean = np.array(case.prior_sigma_rad), np.array(case.prior_mean_rad)
        sigma[k] /= tighter
        mean[k] = (case.zero_rad if tighter > 1 else mean)[k] + sign * sigmas * sigma[k]
        return Spoiled(dataclasses.replace(case, prior_mean_rad=mean, prior_sigma_rad=sigma), (list(ZEROS)[k],))

    return spoil


def records(culprit: str, change: Callable[[tianshan.Recorded], dict[str, Any]]) -> Spoil:
    """Records in another convention."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.read(**change(case.recorded)), (culprit, *_FRAMES))

    return spoil


def focal(share: float) -> Spoil:
    """The focal length is another, in looks that hold the target away from the principal point."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(dataclasses.replace(away(case), focal_px=case.focal_px * (1 + share)), ("focal_px", "camera"))

    return spoil


def away(case: Case) -> Case:
    """The camera holds the target 400 px beside the principal point, on a side that goes round: the gimbal has turned by that."""
    angle = 2 * np.pi * np.arange(LOOKS) / 7
    x, y = 4e-3 * np.cos(angle), 4e-3 * np.sin(angle)
    r = case.recorded
    turned = case.read(gimbal_roll_rad=r.gimbal_roll_rad + x, gimbal_pitch_rad=r.gimbal_pitch_rad + y)
    sensor = tianshan.sensor(tianshan.true_records(case.scene))
    held = tianshan.true_records(case.scene)
    held = dataclasses.replace(held, gimbal_roll_rad=held.gimbal_roll_rad + x, gimbal_pitch_rad=held.gimbal_pitch_rad + y)
    shot = wj.Shot(time_s=TIME_S)
    seen, before = (wj.project(s, shot, case.target_m).pixel_px for s in (tianshan.sensor(held), sensor))
    return turned.moved(slice(None), np.asarray(seen - before))


def another(looks: slice, by_m: float) -> Spoil:
    """A run of looks saw another thing, so far east of the target."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = np.arange(LOOKS)[looks]
        return Spoiled(case.moved(rows, _displaced(case, np.full(LOOKS, by_m))[rows]), tuple(LABELS[i] for i in rows))

    return spoil


def moving(mps: float) -> Spoil:
    """The target drives east, and ends where it is looked for."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.moved(slice(None), _displaced(case, mps * (TIME_S - TIME_S[-1]))), ("target", "motion", "time"))

    return spoil


def _displaced(case: Case, east_m: np.ndarray) -> np.ndarray:
    """What it does to the pixels that the target is so far east."""
    lat, lon, _ = case.scene.target
    east = np.asarray(wj.enu_rotation(np.radians(lat), np.radians(lon)))[:, 0]
    sensor, shot = tianshan.sensor(tianshan.true_records(case.scene)), wj.Shot(time_s=TIME_S)
    there = wj.project(sensor, shot, case.target_m + east_m[:, None] * east).pixel_px
    return np.asarray(there - wj.project(sensor, shot, case.target_m).pixel_px)


def gated(spoil: Spoil) -> Spoil:
    """The same, with a gate."""

    def both(case: Case, rng: Rng) -> Spoiled[Case]:
        spoiled = spoil(case, rng)
        return Spoiled(dataclasses.replace(spoiled.case, gate=1e-3), spoiled.culprits)

    return both
