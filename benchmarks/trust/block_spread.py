"""Errors of a block that are larger, smaller or more alike than stated, and what the best test gains from it."""

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np

import whiskjax as wj

from .block_spoils import product
from .blocks import (
    CONTROL,
    IMAGE,
    IMAGES,
    OBSERVED,
    POINT,
    POINTS,
    POS,
    RAYS,
    ROLE,
    SHIFT_M,
    SIGMA_PX,
    STRIP,
    STRIP_NAMES,
    TURN_RAD,
    WHERE_M,
    Case,
    design,
)
from .score import gain
from .way import Spoil, Spoiled

Rng = np.random.Generator
_TIE = ROLE == "tie"


def respread(correlation: np.ndarray, culprits: tuple[str, ...]) -> Spoil:
    """Errors of rays hang together, and are as large as stated."""

    @cache
    def root() -> np.ndarray:
        values, vectors = np.linalg.eigh(correlation)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        return Spoiled(case.moved(slice(None), SIGMA_PX * (root() @ case.white - case.white)), culprits)

    return spoil


def near_in_image(over_px: float, share: float) -> np.ndarray:
    """Rays of one image whose errors are alike where they are near each other, by the layout."""
    at = WHERE_M[POINT] * 3000.0 / 900.0
    apart = np.linalg.norm(at[:, None] - at[None, :], axis=2)
    same = IMAGE[:, None] == IMAGE[None, :]
    return share * same * np.exp(-apart / over_px) + (1 - share) * np.eye(len(POINT))


def same_group(of: np.ndarray, share: float) -> np.ndarray:
    """Rays of one group have a share of their variance in common."""
    return share * (of[:, None] == of[None, :]) + (1 - share) * np.eye(len(of))


def respread_witness(correlation: np.ndarray) -> Callable[[Case], float]:
    """What the best test gains from rays whose errors have this correlation."""
    covariance = np.eye(OBSERVED)
    covariance[RAYS, RAYS] = np.kron(correlation, np.eye(2))
    return _gained(covariance)


def _gained(covariance: np.ndarray, closer: np.ndarray | None = None) -> Callable[[Case], float]:
    """Of errors with this covariance in stated sigmas; `closer`: how many times smaller than those of the scene, (m,)."""
    found = cache(lambda: gain(design() if closer is None else design() * closer[:, None], covariance))
    return lambda case: found()


def lasting(strips: bool = True) -> Spoil:
    """POS errs by one error a strip, or one for all, where it is stated to err anew in every image."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        group = STRIP if strips else np.zeros_like(STRIP)
        photo, true = case.sensor["photo"], case.true_sensor["photo"]
        truth = np.stack([np.asarray(c) for c in true.position_m], axis=1)
        attitude = np.stack([np.asarray(c) for c in true.quaternion], axis=1)
        noisy = bool(np.abs(truth - np.stack([np.asarray(c) for c in photo.position_m], axis=1)).max() > 1e-9)
        turn, shift = (sigma * rng.standard_normal((STRIP.max() + 1, 3))[group] * noisy for sigma in (TURN_RAD, SHIFT_M))
        half = turn / 2
        by = np.concatenate([half, np.ones((len(IMAGES), 1))], axis=1)
        by /= np.linalg.norm(by, axis=1, keepdims=True)
        turned = np.concatenate([product(q[None], b) for q, b in zip(attitude, by, strict=True)])
        links = {"photo": wj.PosePerImage(truth + shift, turned), "mount": case.sensor["mount"]}
        return Spoiled(dataclasses.replace(case, sensor=wj.Sensor(links, case.sensor.camera)), ("photo", *STRIP_NAMES, *IMAGES))

    return spoil


def lasting_witness(strips: bool = True) -> Callable[[Case], float]:
    """What the best test gains from POS whose turns and shifts are the same in all images of a group."""
    group = STRIP if strips else np.zeros_like(STRIP)
    covariance = np.eye(OBSERVED)
    covariance[POS, POS] = np.kron(np.eye(2), np.kron((group[:, None] == group[None, :]).astype(float), np.eye(3)))
    return _gained(covariance)


def stated_rays(factor: float, role: str | None = "tie") -> Spoil:
    """Errors of rays are `factor` times as large as their sigmas say."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        rows = ROLE[POINT] == role if role else np.ones(len(POINT), dtype=bool)
        sigma = np.where(rows[:, None], SIGMA_PX / factor, SIGMA_PX) * np.ones((1, 2))
        return Spoiled(case.given(sigma_px=sigma), ("tie", "ties", "rays of tie points", "tie rays", "rays"))

    return spoil


def stated_rays_witness(factor: float) -> Callable[[Case], float]:
    """What the best test gains from it."""
    times = np.ones(OBSERVED)
    times[RAYS] = np.where(np.repeat(_TIE[POINT], 2), factor, 1.0)
    return _gained(np.diag(times**2), times)


def stated_pos(factor: float) -> Spoil:
    """POS errs `factor` times as much as stated."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        errors = (wj.FrameErrors("photo", (TURN_RAD / factor,) * 3, (SHIFT_M / factor,) * 3),)
        return Spoiled(dataclasses.replace(case, errors=errors), ("photo", "POS", "attitude", "position"))

    return spoil


def stated_pos_witness(factor: float) -> Callable[[Case], float]:
    """What the best test gains from it."""
    times = np.ones(OBSERVED)
    times[POS] = factor
    return _gained(np.diag(times**2), times)


def stated_control(factor: float) -> Spoil:
    """Surveyed coordinates are `factor` times as wrong as stated."""

    def spoil(case: Case, rng: Rng) -> Spoiled[Case]:
        off = (np.asarray(case.block.position_m) - case.point_m) * (factor - 1)
        position = np.asarray(case.block.position_m) + np.where((ROLE == "control")[:, None], off, 0.0)
        return Spoiled(case.given(position_m=position), ("control", *(POINTS[i] for i in np.flatnonzero(ROLE == "control"))))

    return spoil


def stated_control_witness(factor: float) -> Callable[[Case], float]:
    """What the best test gains from it: the sigmas stay, the errors grow."""
    times = np.ones(OBSERVED)
    times[POS.stop : POS.stop + 3 * CONTROL] = factor
    return _gained(np.diag(times**2))
