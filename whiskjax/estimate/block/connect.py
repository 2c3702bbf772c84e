"""Which parts of a block hang together, and points that cannot be intersected."""

import numpy as np

from ...rules import WhiskjaxError
from .block import Block


def refuse_lonely(block: Block) -> None:
    """**Raises:** `WhiskjaxError` naming a check or tie point that is seen once, and how many there are."""
    count = np.bincount(block.point, minlength=len(block.role))
    lonely = np.flatnonzero((count == 1) & (block.role != "control"))
    if lonely.size:
        more = f" ({lonely.size} points are)" if lonely.size > 1 else ""
        raise WhiskjaxError(
            f"{block.point_label(int(lonely[0]))} is seen by one ray only{more}: one ray determines no point; leave it out "
            "(Block.keep)"
        )


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
