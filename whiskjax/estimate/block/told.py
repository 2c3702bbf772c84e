"""What is told to people of an adjusted block: what is wrong with it, and what a careful person would say."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...rules import RESULTS
from ...rules.results import message_of
from ..diagnosis import UNLIKELY
from ..errors import AXES
from .block import Block
from .connect import connections
from .station_errors import StationErrors

_NAMED = 10


def impossible(block: Block, codes: Int[np.ndarray, " rays"]) -> list[str]:
    """What to say of rays that the sensor cannot have made as it was adjusted: the first by name, and how many there are."""
    if not codes.any():
        return []
    i, count = int(np.argmax(codes != 0)), int((codes != 0).sum())
    more = f" ({count} of {len(codes)} rays fail)" if count > 1 else ""
    hint = ", as in a mirrored block; start nearer" if message_of(int(codes[i])) == RESULTS[RESULTS.point_behind_camera] else ""
    return [f"where the adjustment ended, {block.ray_label(i)}: {message_of(int(codes[i]))}{more}{hint}"]


def weak(matrix: Float[np.ndarray, "m m"], stations: int, unknowns: Sequence[str], motions: StationErrors | None) -> str:
    """Which unknowns take part in the weakest combination of a singular system."""
    if not np.isfinite(matrix).all():
        return ": the normal equations hold values that are no numbers"
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > 1e-12 * values[-1]:
        return ""
    share = np.abs(vectors[:, 0])
    names = [f"{axis} of station {k}" for axis in AXES for k in range(stations)] + list(unknowns)
    order = np.argsort(-share)[:6]
    named = ", ".join(names[i] for i in order if share[i] > 0.1 * share[order[0]])
    hint = "" if motions is None or motions.observed else "; without POS a block needs three control points or more"
    return f": {named}. Give priors, or leave some of them out{hint}"


def warnings_of(
    block: Block,
    used: Bool[np.ndarray, " rays"],
    lonely: Bool[np.ndarray, " points"],
    motions: StationErrors | None,
    factor: float,
    tail: float,
    squared: np.ndarray,
    data_share: Float[np.ndarray, " q"],
    unknowns: Sequence[str],
) -> list[str]:
    """What a careful person would say.

    **Arguments:** `squared`: whitened residuals, zero of rays that take no part, (rays, 2); `data_share`: of each unknown.
    """
    said = []
    if not ((block.role == "control") & block.seen).any():
        rests = "the priors" if motions is None else "POS" if motions.observed else "nothing"
        said.append(f"there is no control point: the datum of the block rests on {rests}")
    if math.isfinite(factor) and tail < UNLIKELY:
        said.append(
            f"residuals are larger than their sigmas say: variance factor {factor:.3g} (probability of a larger one {tail:.1e}); "
            "look for wrong tie points, or let the weights be estimated"
        )
    elif math.isfinite(factor) and factor < 0.5:
        said.append(f"residuals are smaller than their sigmas say: variance factor {factor:.3g}")
    if lonely.any():
        alone = np.flatnonzero(lonely)
        named = ", ".join(block.point_label(int(i)) for i in alone[:_NAMED])
        more = f", ... ({len(alone)} points)" if len(alone) > _NAMED else ""
        said.append(f"seen by one ray only, which determines no point, and left out: {named}{more}")
    wrong = ~used & ~lonely[block.point]
    if wrong.any():
        lost = np.setdiff1d(block.point[wrong], block.point[used]).size
        touched = len(np.unique(block.point[wrong]))
        said.append(f"{int(wrong.sum())} rays of {touched} points are wrong and left out; {lost} points lose all of their rays")
    groups = connections(block.keep(used)) if used.any() else []
    if len(groups) > 1:
        small = min(groups, key=len)
        said.append(f"no point ties {', '.join(small)} to the other images: only POS and control hold them together")
    prior_only = [name for name, share in zip(unknowns, data_share, strict=True) if share < 0.05]
    if prior_only:
        said.append(f"fixed by their priors alone: {', '.join(prior_only)}")
    worst = int(np.argmax(np.nan_to_num(squared).max(axis=1)))
    if squared[worst].max() > 36:
        said.append(f"the largest residual, {math.sqrt(squared[worst].max()):.1f} sigma, is that of {block.ray_label(worst)}")
    return said
