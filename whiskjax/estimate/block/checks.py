"""What is asked of an adjusted block alone, beside what every answer is asked."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...rules import arrays_of, plain
from ..reason import CAUTION, Check, Figures, Said, graded, several
from .block import Block
from .connect import connections

_LARGE = 6.0  # sigmas


class Rays(NamedTuple):
    """A block as its own checks see it: `datum` says what it rests on without control points; `alone` names the points that one
    ray alone sees."""

    block: Block
    used: Bool[Any, " rays"]
    residual_px: Float[Any, "rays 2"]
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


def _largest(rays: Rays) -> Figures:
    used, math = rays.used, arrays_of((rays.residual_px, rays.used))
    squared = math.nan_to_num(math.where(used[:, None], (rays.residual_px / plain(rays.block.sigma_px)) ** 2, 0.0)).max(axis=1)
    return graded(CAUTION, squared.max() > _LARGE**2), {"ray": squared.argmax(), "sigmas": math.sqrt(squared.max())}


def _say_largest(found: dict[str, Any], rays: Rays) -> Iterable[Said]:
    label, sigmas = rays.block.ray_label(int(found["ray"])), float(found["sigmas"])
    yield f"the largest residual, {sigmas:.1f} sigma, is that of {label}", {"measurement": label, "sigmas": sigmas}


# What only a block can be asked.
BLOCK_CHECKS = (
    Check("datum", _datum, _say_datum),
    Check("points seen once", _lonely, _say_lonely),
    Check("parts", _parted, _say_parted),
    Check("largest residual", _largest, _say_largest),
)
