"""Angles that end far from where they started: mostly axes that point elsewhere, which an angle has to stand in for.

No mount is turned by 90 deg unless somebody said so. Where its rotation R is nearly P R0, with R0 the start and P a signed
permutation of the axes, an axes link that holds P leaves the mount its small angles.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..chain.address import Address, node_at, put, read
from ..chain.by import By
from ..chain.correction import Correction
from ..chain.mounts import CONVENTIONS, Axes, Mount
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from .estimate import Estimate

FAR_RAD = math.radians(20.0)


@cache
def _rotations() -> dict[str, Float[np.ndarray, "3 3"]]:
    return {axes: np.array(Axes(axes).pose(Shot()).rotation, dtype=float) for axes in CONVENTIONS}


class FarTurn(NamedTuple):
    """A number that ended far from its start; `axes` of the link `frame` would leave it small, None where no axes would.

    - `angle_rad`: from the start, signed, within half a turn.
    - `is_new`: whether there is no such link yet, and one with these axes would have to stand before the mount.
    """

    name: str
    angle_rad: float
    frame: str = ""
    axes: str | None = None
    is_new: bool = False


def far_turns(solved: Sensor, estimate: Estimate, start: Float[np.ndarray, " k"]) -> tuple[FarTurn, ...]:
    """Of all numbers of an answer, those whose angle moved by 20 deg or more.

    **Arguments:** `solved`: the sensor with the answer put in; `start`: of its numbers, in the units of their fields.
    """
    pairs = [(place, float(s)) for of, s in zip(estimate.places, start, strict=True) for place in of]
    begun = put(solved, [place for place, _ in pairs], [value for _, value in pairs])
    found = []
    for name, (place, *_) in zip(estimate.names, estimate.places, strict=True):
        if not place.path[-1].endswith("_rad"):
            continue
        moved = math.remainder(float(np.asarray(read(solved, place))) - float(np.asarray(read(begun, place))), 2 * math.pi)
        if abs(moved) > FAR_RAD:
            found.append(FarTurn(name, moved, *_cured(solved, begun, place)))
    return tuple(found)


def _cured(solved: Sensor, begun: Sensor, place: Address) -> tuple[str, str | None, bool]:
    """The link whose axes would leave the mount nearly as it started, those axes, and whether the link is new."""
    of = place._replace(path=place.path[:-1])
    ended, start = (_rotation(node_at(sensor, of)) for sensor in (solved, begun))
    if ended is None or start is None:
        return "", None, False
    frame, axes, is_before = _beside(solved, place.link)
    # The mount that is left is P^T R behind other axes, or R P^T before them: the trace with its start says how near it is.
    nearness = {
        p: float(np.sum((matrix.T @ ended if is_before else ended @ matrix.T) * start)) for p, matrix in _rotations().items()
    }
    nearest = max(nearness, key=lambda p: nearness[p])
    if nearest == "x y z":
        return "", None, False
    if axes is None:
        return place.link, nearest, True
    known, turn = _rotations()[" ".join(word.lstrip("+") for word in axes.split())], _rotations()[nearest]
    wanted = known @ turn if is_before else turn @ known
    return frame, next(text for text, matrix in _rotations().items() if np.array_equal(matrix, wanted)), False


def _rotation(node: Any) -> Float[np.ndarray, "3 3"] | None:
    """Of a mount; None of anything else."""
    return np.asarray(node.pose(Shot()).matrix, dtype=float) if isinstance(node, Mount) else None


def _beside(sensor: Sensor, link: str) -> tuple[str, str | None, bool]:
    """The nearest axes before a link, or else behind it, with nothing between but what hardly turns; and whether before."""
    i = sensor.names.index(link)
    for way in (-1, 1):
        k = i + way
        while 0 <= k < len(sensor.names) and isinstance(sensor.links[k], Mount | By | Correction):
            k += way
        if 0 <= k < len(sensor.names) and isinstance(node := sensor.links[k], Axes):
            return sensor.names[k], node.axes, way < 0
    return "", None, True
