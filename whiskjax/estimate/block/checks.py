"""What is asked of an adjusted block alone, beside what every answer is asked."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from ..reason import CAUTION, Check, Figures, Said, graded, several
from .block import Block
from .connect import connections


class Rays(NamedTuple):
    """A block as its own checks see it: `datum` says what it rests on without control points; `alone` names the points that one
    ray alone sees."""

    block: Block
    used: Bool[Any, " rays"]
    datum: str
    alone: tuple[str, ...]


def _datum(rays: Rays) -> Figures:
    block = rays.block
    return graded(CAUTION, not ((block.role == "control") & block.seen).any()), {}


def _say_datum(_: dict[str, Any], rays: Rays) -> Iterable[Said]:
    yield f"there is no control point: the datum of the block rests on {rays.datum}", {"on": rays.datum}


def _lonely(rays: Rays) -> Figures:
    return graded(CAUTION, len(rays.alone) > 0), {"count": len(rays.alone)}


def _say_lonely(found: dict[str, Any], rays: Rays) -> Iterable[Said]:
    names, count = rays.alone, int(found["count"])
    said = f"{count} check or tie point{'s are' if count > 1 else ' is'} seen by one ray only"
    yield f"{said}, which determines no point, and left out: {several(names)}", {"count": count, "points": names}


def _parted(rays: Rays) -> Figures:
    used = np.asarray(rays.used)
    groups = connections(rays.block.keep(used)) if used.any() else []
    return graded(CAUTION, len(groups) > 1), {"groups": len(groups)}


def _say_parted(_: dict[str, Any], rays: Rays) -> Iterable[Said]:
    small = min(connections(rays.block.keep(np.asarray(rays.used))), key=len)
    yield f"no point ties {several(small)} to the other images: only POS and control hold them together", {"images": small}


# What only a block can be asked.
BLOCK_CHECKS = (
    Check("datum", _datum, _say_datum),
    Check("points seen once", _lonely, _say_lonely),
    Check("parts", _parted, _say_parted),
)
