"""Whether a run of looks sees another target than the others."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..estimate.fitted import scores
from ..estimate.reason import FINE, Check, Figures, Said, about
from ..estimate.score_family import judged_together, most_significant
from .look_by_look import Sight

_CELLS = 12  # of the looks in the order of time, between which runs begin and end
_FEWEST = 2  # looks: a place has three coordinates, and a look gives two


def _two_targets(sight: Sight) -> Figures:
    """Each run of looks with a target of its own: the derivative of the pixel by the place, in the looks of the run."""
    if sight.fit is None or not len(runs := _runs(np.asarray(sight.looks.is_used))):
        return np.asarray(FINE), {}
    return judged_together(scores(sight.fit, *_patterns(np.asarray(sight.by_target_px), runs)))


def _runs(used: Bool[np.ndarray, " looks"]) -> Bool[np.ndarray, "runs looks"]:
    """Looks of each run that is tried, from one cell to another; of the first and the last ones, which see the same two targets,
    the fewer."""
    index, looks, found = np.flatnonzero(used), np.arange(len(used)), []
    edge = np.unique(np.round(np.linspace(0, len(index), _CELLS + 1)).astype(int)).tolist()
    for i, first in enumerate(edge[:-1]):
        for end in edge[i + 1 :]:
            many, at_edge = end - first, first == 0 or end == edge[-1]
            doubled = at_edge and (2 * many > len(index) or (2 * many == len(index) and first > 0))
            if many >= _FEWEST and len(index) - many >= _FEWEST and not doubled:
                found.append(used & (looks >= index[first]) & (looks <= index[end - 1]))
    return np.array(found).reshape(-1, len(used))


def _patterns(
    by_target_px: Float[np.ndarray, "looks 2 3"], runs: Bool[np.ndarray, "runs looks"]
) -> tuple[Float[np.ndarray, "coordinates d"], list[slice]]:
    pattern = np.einsum("kai,rk->kari", by_target_px, runs).reshape(2 * runs.shape[1], -1)
    return pattern, [slice(3 * r, 3 * r + 3) for r in range(len(runs))]


def _say_two_targets(found: dict[str, Any], sight: Sight) -> Iterable[Said]:
    worst = most_significant(found)[0]
    looks, shift_m = np.flatnonzero(_runs(np.asarray(sight.looks.is_used))[worst]), found["size"][worst]
    first, last, distance = int(looks[0]), int(looks[-1]), float(np.linalg.norm(shift_m))
    sigmas, moves = math.sqrt(float(found["statistic"][worst])), float(found["moves"][worst])
    east, north, up = (about(float(c)) for c in shift_m)
    yield (
        f"looks {first} to {last} see a target {about(distance)} m from that of the others (east {east}, north {north}, up {up} "
        f"m; {sigmas:.3g} sigma, and it moved the answer by {about(moves)}): is it one and the same?",
        {
            "first": f"look {first}", "last": f"look {last}", "looks": looks.tolist(), "distance_m": distance,
            "shift_enu_m": shift_m.tolist(), "sigmas": sigmas, "moves": moves,
        },
    )  # fmt: skip


TWO_TARGETS = Check("two targets", _two_targets, _say_two_targets)
