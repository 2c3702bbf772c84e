"""Evaluate once what no unknown touches.

Links that stay put move into the shots as poses, and neighbours merge into one: the sensor stays unbatched, the shots stay the
only thing that is batched, and what remains to be traced is the few links that an estimator changes.
"""

import dataclasses
from collections.abc import Collection

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
