"""An image whose pose is so wrong that its rays do not meet the others: found before anything can be adjusted.

Points in which a wrong ray takes part cannot be intersected, or lie anywhere; each of them says only that some ray is wrong. What
they have in common is the image. Without its rays they all meet, and lie where the image does not look.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int

from ...chain.imaging import project
from ...chain.sensor import Sensor
from ...rules.results import codes_of
from ..evidence import groupings
from ..intersection import intersect
from .block import Block

_FEWEST = 2  # points: one alone may have a wrong ray
_SHARED, _HEALED = 0.75, 0.9  # of the points that do not meet
_AWAY = 10.0  # times as far from where the others see a point as those are from one another


class WrongImage(NamedTuple):
    """An image (`kind`: or a strip, a view, a swing) whose rays are wrong, by name.

    `parted`: points that cannot be intersected with it; `whole`: how many of its points can be without it.
    """

    kind: str
    name: str
    parted: int
    whole: int

    @property
    def text(self) -> str:
        """For people."""
        return (
            f"{self.kind} {self.name}: its rays are wrong, the others agree: {self.parted} points cannot be intersected with "
            f"them, and without them {self.whole} points that it sees lie where it does not look; look at its pose, time and name"
        )


def wrong_image(sensor: Sensor, block: Block, parted: Bool[np.ndarray, " points"]) -> WrongImage | None:
    """The image without which everything fits; None where there is none, or several.

    **Arguments:** `block`: rays of points that have to be intersected; `parted`: those that do not meet.
    """
    if parted.sum() < _FEWEST:
        return None
    found, told = [], set()
    for grouping in groupings(sensor, block.key, block.images, block.strips):
        for i, name in enumerate(grouping.names):
            rays = np.asarray(grouping.index == i)
            seen = np.bincount(block.point[rays], minlength=len(block.role)) > 0
            if rays.all() or rays.tobytes() in told or (seen & parted).sum() < _SHARED * parted.sum():
                continue
            told.add(rays.tobytes())  # a strip of one image is that image
            if (best := _without(sensor, block, rays, seen, parted)) is not None:
                found.append((best[0], WrongImage(grouping.kind, str(name), int(parted.sum()), best[1])))
    return max(found, key=lambda one: one[0])[1] if found else None


def _without(
    sensor: Sensor, block: Block, rays: Bool[np.ndarray, " rays"], seen: np.ndarray, parted: np.ndarray
) -> tuple[float, int] | None:
    """How many times farther a group's rays are from its points than the others are, which agree, and how many those are."""
    others = np.flatnonzero(~rays & seen[block.point])
    points = np.flatnonzero(np.bincount(block.point[others], minlength=len(block.role)) > 1)
    others = others[np.isin(block.point[others], points)]
    if len(points) < _FEWEST:
        return None
    rest = block.keep(others)
    met = intersect(sensor, rest.shot, jnp.asarray(rest.pixel_px), _numbers(points, rest.point), rest.sigma_px, throw=False)
    fine, healed = codes_of(met.result) == 0, parted[points]
    if fine.sum() < _FEWEST or (fine & healed).sum() < _HEALED * healed.sum():
        return None
    own = np.flatnonzero(rays & np.isin(block.point, points[fine]))
    of = block.keep(own)
    place = np.asarray(met.point_m)[_numbers(points, of.point)]
    looked = project(sensor, of.shot, place, throw=False)
    away = np.linalg.norm(np.asarray(looked.pixel_px) - of.pixel_px, axis=1)
    away = float(np.median(np.where(np.isfinite(away), away, np.inf)))
    apart = np.asarray(met.residual_px)[fine[_numbers(points, rest.point)]]
    apart = max(float(np.median(np.linalg.norm(apart, axis=1))), float(np.median(of.sigma_px)))
    return (away / apart, len(np.unique(of.point))) if away > _AWAY * apart else None


def _numbers(points: Int[np.ndarray, " some"], of: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Places of points among some of them, which are sorted."""
    return np.searchsorted(points, of)
