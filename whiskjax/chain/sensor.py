"""An instrument: named links from the Earth to the camera, and the camera."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx

from ..algebra.vectors import total
from ..earth.refraction import Refraction
from ..rules import RESULTS, Arrays, WhiskjaxError, first_failure, need
from .by import By, fit, is_aligned, is_camera
from .camera import AbstractCamera
from .link import AbstractLink, Moves
from .pose import Pose
from .shot import Shot

_TAKEN = ("camera", "earth", "refraction")


def check_frame_name(name: str) -> None:
    """**Raises:** `WhiskjaxError` where a name is no word, or one that is a place of its own."""
    if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN:
        raise WhiskjaxError(
            f"{name!r} cannot name a frame: a word is needed, and not {' or '.join(map(repr, _TAKEN))}, which are taken"
        )


class Sensor(eqx.Module):
    """The imaging chain: `Sensor({"body": Trajectory(...), "platform": Mount(...), ...}, camera)`.

    Links go from the Earth inwards; each is named after the frame it leads to. Names are held in a tuple, because a pytree of
    dicts comes back sorted. With a `refraction` (ECEF world only) lines of sight are bent; it is no link, since it
    depends on where the ray goes.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    links: tuple[AbstractLink, ...]
    camera: AbstractCamera | By
    refraction: Refraction | None

    def __init__(self, links: Mapping[str, AbstractLink], camera: AbstractCamera | By, refraction: Refraction | None = None):
        """**Raises:** `WhiskjaxError` where there is no link, a name is not a word, or a key has two lists of options."""
        need("Sensor", "links", links, Mapping, "a dict of links by the frame each leads to, as {'body': Trajectory(...)}")
        if not links:
            raise WhiskjaxError("a sensor needs at least one link from the Earth, as Sensor({'body': Trajectory(...)}, camera)")
        for name, link in links.items():
            check_frame_name(name)
            if not isinstance(link, AbstractLink) or is_camera(link):
                found = "a By of cameras" if is_camera(link) and isinstance(link, By) else type(link).__name__
                raise WhiskjaxError(f"Sensor: links: {name}: a link is needed here, not {found}")
        if not is_camera(camera):
            raise WhiskjaxError(f"Sensor: camera: a camera, or a By of cameras, is needed here, not {type(camera).__name__}")
        if refraction is not None:
            need("Sensor", "refraction", refraction, Refraction, "Refraction()")
        self.names, self.links, self.camera, self.refraction = tuple(links), tuple(links.values()), camera, refraction
        self.key_names()

    def __getitem__(self, name: str) -> Any:
        """The link of this name, or the camera, or the refraction."""
        if name == "camera":
            return self.camera
        if name == "refraction":
            if self.refraction is None:
                raise WhiskjaxError("the sensor has no refraction: Sensor(links, camera, refraction=Refraction())")
            return self.refraction
        if name not in self.names:
            raise WhiskjaxError(f"no link named {name!r}; there are {', '.join(self.names)} and camera")
        return self.links[self.names.index(name)]

    def after(self, frame: str, name: str, link: AbstractLink) -> "Sensor":
        """The same sensor with one more link behind the frame `frame`: a correction at that joint, say.

        **Raises:** `WhiskjaxError` where there is no such frame, or the name is taken.
        """
        if frame not in self.names:
            raise WhiskjaxError(f"no frame named {frame!r}; there are {', '.join(self.names)}")
        if name in self.names:
            raise WhiskjaxError(f"there is already a link named {name!r}; give the new one another name")
        links: dict[str, AbstractLink] = {}
        for known, existing in zip(self.names, self.links, strict=True):
            links[known] = existing
            if known == frame:
                links[name] = link
        return Sensor(links, self.camera, self.refraction)

    def key_names(self) -> dict[str, tuple[str, ...]]:
        """The names of the options behind each key that some link or the camera asks for; the shot holds their index.

        **Raises:** `WhiskjaxError` where two of them list different names, since one index could not mean both.
        """
        found: dict[str, tuple[str, ...]] = {}

        def visit(name: str, part: Any) -> None:
            if isinstance(part, By):
                if found.setdefault(part.key, part.names) != part.names:
                    known = found[part.key]
                    raise WhiskjaxError(
                        f"{name}: the {part.key}s are {part.names}, but another link lists {known}: use one order"
                    )
                for option in part.options:
                    visit(name, option)

        for name, part in zip((*self.names, "camera"), (*self.links, self.camera), strict=True):
            visit(name, part)
        return found

    def refuse_aligned(self, owner: str) -> None:
        """What sorts, pads or picks shots cannot use links or cameras that hold a number for each of them.

        **Raises:** `WhiskjaxError` naming the link; `owner` is who would.
        """
        for name, part in zip((*self.names, "camera"), (*self.links, self.camera), strict=True):
            if is_aligned(part):
                raise WhiskjaxError(
                    f"{owner}: {name} holds a record for each look, but observations are sorted and padded here; give records in "
                    "time, as a Trajectory or an Encoder, or one for each image (PosePerImage, By)"
                )

    @property
    def is_line(self) -> bool:
        """Whether the images are made of lines exposed one after the other."""
        return self.camera.is_line

    def camera_at(self, shot: Shot) -> AbstractCamera:
        """The camera as it was at each shot."""
        return self.camera.at(shot)

    def pose(self, shot: Shot, upto: str | None = None) -> Pose:
        """Pose earth_from_`upto`; by default up to the camera."""
        stop = self.names[-1] if upto is None else upto
        if stop not in self.names:
            raise WhiskjaxError(f"no frame named {stop!r}; there are {', '.join(self.names)}")
        pose = Pose()
        for name, link in zip(self.names, self.links, strict=True):
            pose = pose @ link.pose(shot)
            if name == stop:
                break
        return pose

    def moves(self, shot: Shot) -> Moves:
        """How the whole chain moves in time: the samples of all links, and the sum of their rates."""
        of_each = [link.moves(shot) for link in self.links]
        recorded = tuple(record for moves in of_each for record in moves.recorded)
        return Moves(recorded, total(m.turn_radps for m in of_each), total(m.speed_mps for m in of_each))

    def check(self, shot: Shot) -> RESULTS:
        """The first link's failure for each shot, if any: a time outside the record, in a gap, an unknown key."""
        return first_failure(*(link.check(shot) for link in (*self.links, self.camera)))


def fit_sensor(arrays: Arrays, sensor: Sensor, shot: Shot) -> None:
    """Whether what links and camera hold for each shot fits the other arguments of somebody.

    **Raises:** `WhiskjaxError` naming the link.
    """
    for name, part in zip((*sensor.names, "camera"), (*sensor.links, sensor.camera), strict=True):
        fit(arrays, name, part, shot)
