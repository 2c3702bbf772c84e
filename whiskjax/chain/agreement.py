"""Whether recorded velocities are those of the recorded positions: units, signs and axes that were taken for others.

Positions and velocities describe one motion twice. Over a second or more the noise of positions is small beside the way that was
flown, and the way that the velocities add up to has to be the same.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# What a velocity in m/s may have been written in, as m/s.
_UNITS = {"km/h": 1 / 3.6, "knots": 1852 / 3600, "feet per second": 0.3048, "miles per hour": 0.44704, "km/s": 1e3}
_UNITS |= {"cm/s": 1e-2, "mm/s": 1e-3}
_LEVEL, _WORLD = ("east", "north", "up"), ("x", "y", "z")

# Another reading of the velocities has to leave this many times less (in squares): along the axes that it changes, which differ
# by at least so much, and along all of them.
_BETTER, _LEAST_MPS, _BETTER_IN_ALL = 25.0, 0.5, 5.0
# Without one they contradict the positions where they leave this share of the larger of the two (in squares).
_CONTRADICTION = 0.5
_WINDOW_S, _LEAST_WINDOWS, _MANY_WINDOWS = 1.0, 4, 8


class Contradiction(NamedTuple):
    """What is wrong with the velocities, for people, and the record where they are furthest from the positions."""

    sample: int
    sentence: str


class Ways(NamedTuple):
    """What was flown in each window of a record, by the positions and by the velocities, in the world's axes."""

    start: np.ndarray  # index of the first sample, (windows,)
    length_s: Float[np.ndarray, " windows"]
    position_m: Float[np.ndarray, "windows 3"]  # where each window starts
    by_positions_m: Float[np.ndarray, "windows 3"]
    by_velocities_m: Float[np.ndarray, "windows 3"]


def ways(
    time_s: Float[np.ndarray, " n"],
    position_m: Float[np.ndarray, "n 3"],
    velocity_mps: Float[np.ndarray, "n 3"],
    max_gap_s: float,
    window_s: float = _WINDOW_S,
) -> Ways:
    """The windows of a record that hold no gap; in a short record they are shorter than asked for."""
    dt = np.diff(time_s)
    window_s = min(window_s, (time_s[-1] - time_s[0]) / _MANY_WINDOWS)
    cuts = np.unique(np.searchsorted(time_s, np.arange(time_s[0], time_s[-1] + 0.5 * window_s, window_s)))
    cuts = cuts[cuts < len(time_s)]
    gaps = np.append(0, np.cumsum(dt > max_gap_s))
    flown = np.zeros((len(time_s), 3))
    for k in range(3):
        np.cumsum(0.5 * (velocity_mps[1:, k] + velocity_mps[:-1, k]) * dt, out=flown[1:, k])
    start, end = cuts[:-1], cuts[1:]
    whole = gaps[start] == gaps[end]
    start, end = start[whole], end[whole]
    return Ways(
        start, time_s[end] - time_s[start], position_m[start], position_m[end] - position_m[start], flown[end] - flown[start]
    )


def level_axes(position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"] | None:
    """East, north, up as rows at ECEF positions; None where the positions cannot be ECEF.

    On a sphere: up is a fifth of a degree off at most, which moves no velocity from one axis to another.
    """
    radius = np.linalg.norm(position_m, axis=1, keepdims=True)
    if not (radius > 6.3e6).all():
        return None
    up = position_m / radius
    east = np.stack([-up[:, 1], up[:, 0], np.zeros(len(up))], axis=-1)
    east /= np.maximum(np.linalg.norm(east, axis=1, keepdims=True), 1e-12)
    return np.stack([east, np.cross(up, east), up], axis=1)


def contradiction(
    time_s: Float[np.ndarray, " n"],
    position_m: Float[np.ndarray, "n 3"],
    velocity_mps: Float[np.ndarray, "n 3"],
    max_gap_s: float,
) -> Contradiction | None:
    """What is wrong with the velocities of a record, if anything is."""
    found = ways(time_s, position_m, velocity_mps, max_gap_s)
    if len(found.start) < _LEAST_WINDOWS:
        return None
    axes = level_axes(found.position_m)
    frames = [(_LEVEL, *(np.einsum("nij,nj->ni", axes, w) for w in found[3:]))] if axes is not None else []
    sample = int(found.start[np.argmax(np.linalg.norm(found.by_positions_m - found.by_velocities_m, axis=1))])
    for names, flown, told in [*frames, (_WORLD, found.by_positions_m, found.by_velocities_m)]:
        sentence = _other_reading(names, flown, told, found.length_s)
        if sentence:
            return Contradiction(sample, sentence)
    left = np.sum((found.by_positions_m - found.by_velocities_m) ** 2)
    most = max(np.sum(found.by_positions_m**2), np.sum(found.by_velocities_m**2))
    seconds = np.sqrt(np.sum(found.length_s**2))
    if left > _CONTRADICTION * most and np.sqrt(left) / seconds > 2 * _LEAST_MPS:
        flown, told = (np.sqrt(np.sum(w**2)) / seconds for w in found[3:])
        return Contradiction(
            sample, f"the positions move at {flown:.4g} m/s, the velocities are {told:.4g} m/s and lead elsewhere (rms)"
        )
    return None


def _other_reading(names: tuple[str, ...], flown: np.ndarray, told: np.ndarray, length_s: np.ndarray) -> str:
    """The unit, signs and order of axes that make the velocities those of the positions; empty where they are."""
    across, ways_flown, ways_told = flown.T @ told, np.sum(flown**2, axis=0), np.sum(told**2, axis=0)
    plain = ways_flown - 2 * np.diag(across) + ways_told
    best: tuple[float, int, str] = (np.inf, 0, "")
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            for unit, size in [("m/s", 1.0), *_UNITS.items()]:
                factor = size * np.array(signs)
                changed = (np.array(order) != np.arange(3)) | (factor != 1)
                if not changed.any():
                    continue
                left = ways_flown - 2 * factor * across[range(3), order] + factor**2 * ways_told[list(order)]
                before, after = plain[changed].sum(), max(left[changed].sum(), 0.0)
                total = float(after + plain[~changed].sum())
                explains = before > _BETTER * after and plain.sum() > _BETTER_IN_ALL * total
                if explains and np.sqrt(before / np.sum(length_s**2)) > _LEAST_MPS:
                    changes = int(changed.sum()) + 3 * (unit != "m/s")
                    best = min(best, (total, changes, _told(names, order, signs, unit)))
    return best[2]


def _told(names: tuple[str, ...], order: tuple[int, ...], signs: tuple[int, ...], unit: str) -> str:
    said = [f"they seem to be in {unit}"] if unit != "m/s" else []
    moved = [k for k in range(3) if order[k] != k]
    if len(moved) == 2:
        said.append(f"those along {names[moved[0]]} and {names[moved[1]]} are exchanged")
    elif moved:
        said.append(f"those along {', '.join(names)} stand in the order {', '.join(names[k] for k in order)}")
    opposite = [names[k] for k in range(3) if signs[k] < 0]
    if opposite:
        said.append(f"along {' and '.join(opposite)} {'they have' if len(opposite) > 1 else 'it has'} the opposite sign")
    return "the velocities contradict the positions: " + ", and ".join(said)
