"""Evaluate once what no unknown touches.

Links that stay put move into the shots as poses, and neighbours merge into one: the sensor stays unbatched, the shots stay the
only thing that is batched, and what remains to be traced is the few links that an estimator changes.
"""

import dataclasses
from collections.abc import Collection

from ..rules import Arrays, need
from .link import AbstractLink, Given
from .sensor import Sensor
from .shot import Shot


def bake(sensor: Sensor, shots: Shot, free: Collection[str], joints: Collection[str] = ()) -> tuple[Sensor, Shot]:
    """A sensor and shots that image alike, with all links but `free` already evaluated; refraction stays what it is.

    **Arguments:**

    - `shots`: must not be baked yet.
    - `free`: names of the links that unknowns act on; they stay live links.
    - `joints`: names of further frames that must survive, so that a small motion can be applied there.

    **Returns:** the baked sensor, whose merged links keep the name of the innermost frame they lead to, and the shots that carry
    their poses.
    """
    need("bake", "sensor", sensor, Sensor)
    need("bake", "shots", shots, Shot, "Shot(time_s=...)")
    for argument, names in (("free", free), ("joints", joints)):
        if isinstance(names, str) or not isinstance(names, Collection):
            Arrays("bake").refuse(argument, f"is a list of names, not {names!r}")
    for name in (*free, *joints):
        if name != "camera":
            sensor[name]
    links: dict[str, AbstractLink] = {}
    poses = []
    merging: str | None = None
    for name, link in zip(sensor.names, sensor.links, strict=True):
        if name in free:
            links[name], merging = link, None
            continue
        pose = link.pose(shots)
        if merging is None:
            poses.append(pose)
        else:
            poses[-1] = poses[-1] @ pose
            del links[merging]
        links[name] = Given(len(poses) - 1)
        merging = None if name in joints else name
    return Sensor(links, sensor.camera, sensor.refraction), dataclasses.replace(shots, poses=tuple(poses))


def ready(sensor: Sensor, shots: Shot, free: Collection[str]) -> tuple[Sensor, Shot]:
    """A sensor and shots that image alike, for one pass over the shots: trigonometry is done, products are not.

    A filter looks at every shot once; a pose multiplied out beforehand is 12 numbers written and read again, its sines and
    cosines are fewer. Every frame keeps its name, so that a small motion can be applied at each.

    **Arguments:** as for `bake`.
    """
    links: dict[str, AbstractLink] = {}
    carried = []
    for name, link in zip(sensor.names, sensor.links, strict=True):
        if name in free:
            links[name] = link
        else:
            carried.append(link.ready(shots))
            links[name] = Given(len(carried) - 1)
    return Sensor(links, sensor.camera, sensor.refraction), dataclasses.replace(shots, poses=tuple(carried))
