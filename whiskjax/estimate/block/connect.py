"""Which parts of a block hang together, and points that one ray alone sees."""

import numpy as np
from jaxtyping import Bool

from ...rules import WhiskjaxError
from .block import Block


def seen_once(block: Block) -> Bool[np.ndarray, " points"]:
    """Check and tie points that one ray alone sees. It determines no point and says nothing of the block: they are left out.

    **Raises:** `WhiskjaxError` where nothing else is seen.
    """
    count = np.bincount(block.point, minlength=len(block.role))
    lonely = (count == 1) & (block.role != "control")
    if lonely[block.point].all():
        raise WhiskjaxError(
            f"{block.point_label(int(np.argmax(lonely)))} and every other point of the block is seen by one ray only, and none "
            "is a control point: nothing remains to be adjusted; measure points in two images or more"
        )
    return lonely


def connections(block: Block) -> list[list[str]]:
    """Groups of images or strips that points tie together; one group where the block is whole.

    Told apart are strips, or images, or swings, whichever the rays carry first.
    """
    key = next((name for name in ("strip", "image", "swing") if block.key(name) is not None), None)
    if key is None:
        return []
    of_ray = np.asarray(block.key(key))
    member = np.unique(of_ray)
    group = np.arange(len(member))
    place = np.searchsorted(member, of_ray)
    while True:  # the smallest group number that a point sees is that of all that it sees
        lowest = np.full(len(block.role), len(member))
        np.minimum.at(lowest, block.point, group[place])
        new = group.copy()
        np.minimum.at(new, place, lowest[block.point])
        new = new[new]
        if (new == group).all():
            break
        group = new
    names = [f"{key} {block.strips[i] if key == 'strip' and len(block.strips) else i}" for i in member.tolist()]
    return [[names[i] for i in np.flatnonzero(group == g)] for g in np.unique(group)]
