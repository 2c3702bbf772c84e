"""What can go wrong in a block, one kind a function."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import numpy as np

import whiskjax as wj

from .blocks import IMAGE, IMAGE_OF, IMAGES, NAMES, PER_STRIP, POINT, POINTS, ROLE, SIGMA_PX, STRIP, STRIP_NAMES, Case
from .way import Spoil, Spoiled

Rng = np.random.Generator
_TIE = ROLE == "tie"


def blunders(count: int, sigmas: float) -> Spoil:
    """So many rays of ties, anywhere, each off by up to twice so many sigmas and no less than once."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = rng.choice(np.flatnonzero(_TIE[POINT]), count, replace=False)
        angle, length = rng.uniform(0, 2 * np.pi, count), SIGMA_PX * sigmas * rng.uniform(1, 2, count)
        off = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Spoiled(case.moved(rows, off), tuple(POINTS[i] for i in POINT[rows]))

    return spoil


def rays(images: Sequence[str], by_px: tuple[float, float], half: bool = False) -> Spoil:
    """All rays of images, or of half the field of each, off by the same."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = np.isin(IMAGE_OF, images)
        if half:
            rows &= np.asarray(case.block.pixel_px)[:, 0] < 2000.0
        return Spoiled(case.moved(rows, by_px), tuple(images))

    return spoil


def of_strip(strip: str) -> tuple[str, ...]:
    """Images of a strip."""
    first = STRIP_NAMES.index(strip) * PER_STRIP
    return IMAGES[first : first + PER_STRIP]


def strip_rays(strip: str, by_px: tuple[float, float]) -> Spoil:
    """All rays of a strip off by the same, of which one of its images may be named too."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        spoiled = rays(of_strip(strip), by_px)(case, rng)
        return Spoiled(spoiled.case, (strip, *spoiled.culprits))

    return spoil


def mismatched(by_px: float) -> Spoil:
    """A tie point is two things: in one strip it was matched to another than in the others."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        several = [p for p in np.flatnonzero(_TIE) if len(set(STRIP[IMAGE[POINT == p]])) > 1]
        p = int(rng.choice(several))
        strip = int(rng.choice(sorted(set(STRIP[IMAGE[POINT == p]]))))
        rows = (POINT == p) & (STRIP[IMAGE] == strip)
        return Spoiled(case.moved(rows, (by_px, -by_px)), (POINTS[p],))

    return spoil


def pose(images: Sequence[str], turn_rad: float = 0.0, shift_m: float = 0.0) -> Spoil:
    """POS of these images is off by more than it says, all by the same."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        photo = case.sensor["photo"]
        rows, by = np.isin(IMAGES, images), shift_m * np.array([1.0, -1.0, 1.0])
        position = np.stack([np.asarray(c) for c in photo.position_m], axis=1) + rows[:, None] * by
        quaternion = np.stack([np.asarray(c) for c in photo.quaternion], axis=1)
        half = np.array([0.5, -0.5, 0.5]) * turn_rad
        turned = product(quaternion, np.concatenate([half, [1.0]]) / np.sqrt(1 + half @ half))
        quaternion = np.where(rows[:, None], turned, quaternion)
        links = {"photo": wj.PosePerImage(position, quaternion), "mount": case.sensor["mount"]}
        sensor = wj.Sensor(links, case.sensor.camera)
        strips = {STRIP_NAMES[STRIP[IMAGES.index(name)]] for name in images} if len(images) > 1 else set()
        return Spoiled(dataclasses.replace(case, sensor=sensor), (*images, *strips, "photo"))

    return spoil


def product(q: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) times one, x, y, z, w."""
    v, w, bv, bw = q[:, :3], q[:, 3:], by[:3], by[3]
    return np.concatenate([w * bv + bw * v + np.cross(v, bv), w * bw - v @ bv[:, None]], axis=1)


def camera(culprit: str, change: Callable[[wj.Sensor], wj.Sensor]) -> Spoil:
    """The images were taken by another camera than the sensor holds."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.imaged(change(case.true_sensor)), (culprit, "camera"))

    return spoil


def distorting(sensor: wj.Sensor) -> wj.Sensor:
    """Half a pixel in the middle of the field, and three in its corners."""
    links = dict(zip(sensor.names, sensor.links, strict=True))
    return wj.Sensor(links, wj.FrameCamera(sensor.camera.focal_px, (2000.0, 1500.0), [-0.002, 0.0, 0.0, 0.0, 0.0]))


def principal(sensor: wj.Sensor) -> wj.Sensor:
    """The principal point is three pixels aside."""
    links = dict(zip(sensor.names, sensor.links, strict=True))
    return wj.Sensor(links, wj.FrameCamera(sensor.camera.focal_px, (2003.0, 1497.0)))


def twice(role: str, apart_px: float = 0.0) -> Spoil:
    """Half of the points of a role give way to the others, listed again under their names with the same rays."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        mine = np.flatnonzero(ROLE == role)
        kept, lost = mine[: len(mine) // 2], mine[len(mine) // 2 : 2 * (len(mine) // 2)]
        rows = np.flatnonzero(~np.isin(POINT, lost))
        again = np.flatnonzero(np.isin(POINT, kept))
        source, point = np.concatenate([rows, again]), np.concatenate([POINT[rows], lost[np.searchsorted(kept, POINT[again])]])
        block, near = case.block, apart_px * rng.standard_normal((len(again), 2))
        pixel = np.asarray(block.pixel_px)[source]
        pixel[len(rows) :] += near
        position = np.array(block.position_m)
        position[lost] = position[kept]
        truth = np.array(case.point_m)
        truth[lost] = truth[kept]
        block = wj.Block(
            wj.Shot(image=IMAGE[source], strip=STRIP[IMAGE[source]]),
            pixel,
            np.asarray(block.sigma_px)[source],
            point,
            position,
            np.asarray(block.covariance_m2),
            ROLE,
            points=POINTS,
            images=[IMAGE_OF[i] for i in source],
            strips=STRIP_NAMES,
        )
        return Spoiled(dataclasses.replace(case, block=block, point_m=truth), tuple(POINTS[i] for i in (*kept, *lost)))

    return spoil


def each_ray_twice(apart_px: float = 0.0) -> Spoil:
    """Every ray is listed twice."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        source = np.repeat(np.arange(len(POINT)), 2)
        block = case.block.keep(source)
        pixel = np.asarray(block.pixel_px) + apart_px * rng.standard_normal((len(source), 2))
        return Spoiled(dataclasses.replace(case, block=dataclasses.replace(block, pixel_px=pixel)), POINTS)

    return spoil


def prior(sigmas: float, which: Sequence[str] = NAMES, tighter: float = 1.0) -> Spoil:
    """The prior of a number is so many sigmas off, with a sigma that may be `tighter` times too small."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        k, sign = NAMES.index(str(rng.choice(list(which)))), rng.choice([-1.0, 1.0])
        unknowns, old = list(case.unknowns), case.unknowns[k]
        sigma = old.sigma / tighter
        mean = (case.truth[k] if tighter > 1 else old.mean) + sign * sigmas * sigma
        unknowns[k] = dataclasses.replace(old, mean=mean, sigma=sigma)
        return Spoiled(dataclasses.replace(case, unknowns=tuple(unknowns)), (old.name,))

    return spoil


def surveyed(by_m: tuple[float, float, float], roles: Sequence[str] = ("control",), only: int | None = None) -> Spoil:
    """Points of these roles are said to be elsewhere: all of them, or one."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = np.isin(ROLE, roles)
        if only is not None:
            rows = np.arange(len(ROLE)) == np.flatnonzero(rows)[only]
        position = np.asarray(case.block.position_m) + rows[:, None] * np.array(by_m)
        culprits = tuple(POINTS[i] for i in np.flatnonzero(rows))
        return Spoiled(case.given(position_m=position), culprits if only is not None else (*culprits, *roles, "datum"))

    return spoil


def exchanged(one: int, other: int) -> Spoil:
    """Two control points are taken for each other."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        position = np.array(case.block.position_m)
        position[[one, other]] = position[[other, one]]
        return Spoiled(case.given(position_m=position), (POINTS[one], POINTS[other]))

    return spoil


def datum(by_m: tuple[float, float, float]) -> Spoil:
    """Control, check points and POS are all said to be elsewhere: another datum."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        moved = surveyed(by_m, ("control", "check"))(case, rng)
        sensor = eqx.tree_at(
            lambda s: s["photo"].position_m,
            case.sensor,
            tuple(c + by for c, by in zip(case.sensor["photo"].position_m, by_m, strict=True)),
        )
        return Spoiled(dataclasses.replace(moved.case, sensor=sensor), ("control", "photo", "datum"))

    return spoil


def measured(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """All pixels were written down in another convention."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.given(pixel_px=change(np.array(case.block.pixel_px))), ("pixel_px", "camera"))

    return spoil


def heading(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """Attitudes are recorded in another convention, as quaternions (n, 4) changed."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        quaternion = change(np.stack([np.asarray(c) for c in case.sensor["photo"].quaternion], axis=1))
        sensor = eqx.tree_at(lambda s: s["photo"].quaternion, case.sensor, tuple(quaternion.T))
        return Spoiled(dataclasses.replace(case, sensor=sensor), ("photo", "heading", "kappa", "turn z"))

    return spoil


def without_control(case: Case, rng: Rng) -> Spoiled[Case]:
    """Nothing is wrong, but control lies in one corner: the other control points become check points."""
    role = np.array(ROLE)
    role[2:8] = "check"
    return Spoiled(case.given(role=role))


def then(spoil: Spoil, **fields: Any) -> Spoil:
    """The same with other fields of the case, as weights from the data."""

    def both(case: Case, rng: Rng) -> Spoiled[Case]:
        spoiled = spoil(case, rng)
        return Spoiled(dataclasses.replace(spoiled.case, **fields), spoiled.culprits)

    return both
