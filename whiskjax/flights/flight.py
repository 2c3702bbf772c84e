"""A flight: an instrument, its images, surveyed points, what was measured, and what is to be estimated."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ..chain.lines import LineTimes
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..earth.world import WGS84, World
from ..estimate.block.block import ROLES, Block
from ..estimate.errors import FrameErrors, need_errors
from ..estimate.observations import Observations
from ..estimate.unknown import Unknown, need_unknowns
from ..locate.looks import Looks
from ..rules import Arrays, FlightError, need
from .line_sigmas import ground_height_m, sigma_px, where_seen


@dataclasses.dataclass(frozen=True)
class Image:
    """One image: a frame exposed at `time_s`, or lines at `lines`; and the names of its swing, view and strip."""

    name: str
    time_s: float | None = None
    lines: LineTimes | None = None
    swing: str | None = None
    view: str | None = None
    strip: str | None = None
    columns: int | None = None
    rows: int | None = None

    def __post_init__(self):
        need("Image", "name", self.name, str)
        arrays = Arrays(f"Image {self.name}")
        arrays.take("time_s", self.time_s, "", optional=True, absolute=True, finite=True)
        if self.lines is not None:
            need(f"Image {self.name}", "lines", self.lines, LineTimes, "LineTimes(line, time_s)")

    def key(self, key: str) -> str | None:
        """The name behind a key of the shot."""
        return self.name if key == "image" else getattr(self, key)


@dataclasses.dataclass(frozen=True)
class Points:
    """Object points: names, world coordinates in metres (NaN for ties without), 1-sigma east, north, up, both (n, 3), roles."""

    names: Sequence[str]
    position_m: Float[np.ndarray, "n 3"]
    sigma_enu_m: Float[np.ndarray, "n 3"]
    roles: Sequence[str]

    def __post_init__(self):
        arrays = Arrays("Points")
        object.__setattr__(self, "position_m", np.asarray(arrays.take("position_m", self.position_m, "n 3", absolute=True)))
        sigma = arrays.take("sigma_enu_m", self.sigma_enu_m, "n 3", finite=True, least=0.0, meaning="east, north, up")
        object.__setattr__(self, "sigma_enu_m", np.asarray(sigma))
        for name in ("names", "roles"):
            arrays.fit(name, np.shape(getattr(self, name)), "n")
        unknown = sorted(set(map(str, self.roles)) - set(ROLES))
        if unknown:
            raise FlightError(f"Points: roles: a point is a {', '.join(ROLES)} point, not {unknown}")


@dataclasses.dataclass(frozen=True)
class Measurements:
    """Image measurements as recorded: which image, which point (indices), where and how well, (n,) each.

    - `line_px`, `sample_px`: row and column of a frame; of a line camera the number of the line, which says when the point was
      seen, and the sample along the detector. The first pixel's centre is 0.
    - `sigma_sample_px`: 1-sigma of the sample.
    - `sigma_line_px`: 1-sigma of the row; of a line camera in focal-plane pixels across the line. NaN where in `sigma_lines`.
    - `sigma_lines`: of a line camera, 1-sigma of the line number, in lines; NaN where in `sigma_line_px`. The flight turns it
      into pixels (`px_per_line`) where it makes observations, rays or looks.
    """

    image: np.ndarray
    point: np.ndarray
    line_px: np.ndarray
    sample_px: np.ndarray
    sigma_line_px: np.ndarray
    sigma_sample_px: np.ndarray
    sigma_lines: np.ndarray | None = None

    def __post_init__(self):
        arrays = Arrays("Measurements")
        in_px = np.asarray(arrays.take("sigma_line_px", self.sigma_line_px, "n"))
        lines = np.full_like(in_px, np.nan) if self.sigma_lines is None else self.sigma_lines
        lines = np.asarray(arrays.take("sigma_lines", lines, "n"))
        object.__setattr__(self, "sigma_lines", lines)
        wrong = np.flatnonzero(np.isnan(in_px) == np.isnan(lines))
        if wrong.size:
            raise FlightError(f"measurement {wrong[0]}: give sigma_line_px or sigma_lines, one of them, and NaN for the other")
        wrong = np.flatnonzero(lines <= 0)
        if wrong.size:
            raise FlightError(f"measurement {wrong[0]}: sigma_lines must be positive, not {lines[wrong[0]]:g}")

    @property
    def is_in_lines(self) -> Bool[np.ndarray, " n"]:
        """Where the sigma of the line is in lines."""
        return ~np.isnan(np.asarray(self.sigma_lines, dtype=float))

    def __len__(self) -> int:
        return len(self.image)


@dataclasses.dataclass(frozen=True)
class Flight:
    """Everything about a flight; `read_flight` and `write_flight` turn it from and into a folder.

    `errors`: how the recorded poses of frames err, by which `locate` weighs looks, and whose course `adjust` estimates.
    """

    name: str
    sensor: Sensor
    images: Sequence[Image]
    points: Points
    measurements: Measurements
    unknowns: Sequence[Unknown] = ()
    errors: Sequence[FrameErrors] = ()
    world: World = WGS84
    epoch: str = ""
    reference_point: str = ""
    notes: str = ""

    def __post_init__(self):
        for name, kind in (("sensor", Sensor), ("points", Points), ("measurements", Measurements), ("world", World)):
            need("Flight", name, getattr(self, name), kind)
        for i, image in enumerate(self.images):
            need("Flight", f"images[{i}]", image, Image)
        need_unknowns("Flight", "unknowns", self.unknowns)
        need_errors("Flight", self.errors)
        m, arrays = self.measurements, Arrays("Flight")
        for name, known in (("image", len(self.images)), ("point", len(self.points.names))):
            index = np.asarray(arrays.take_whole(f"measurements.{name}", getattr(m, name), "n"))
            wrong = np.flatnonzero((index < 0) | (index >= known))
            if wrong.size:
                raise FlightError(f"Flight: measurement {wrong[0]} is of {name} {index[wrong[0]]}, but there are {known}")
        for name in ("line_px", "sample_px", "sigma_line_px", "sigma_sample_px", "sigma_lines"):
            arrays.take(f"measurements.{name}", getattr(m, name), "n")

    def key_index(self, image: Image, key: str) -> int | None:
        """The index by which the shot names an image's swing, view, strip or the image itself; None where no link asks for it.

        **Raises:** `FlightError` where the sensor asks for the key and the image has none, or one that the sensor lacks.
        """
        return self._key_indices([image], key)[0]

    def _key_indices(self, images: Sequence[Image], key: str) -> list[int | None]:
        """`key_index` of many images: what the sensor asks for is looked up once."""
        names = self.sensor.key_names().get(key)
        if names is None and key == "image":
            place = {known.name: i for i, known in reversed(list(enumerate(self.images)))}
            return [place[image.name] for image in images]
        return [None if names is None else self._known_key(image, key, names) for image in images]

    @staticmethod
    def _known_key(image: Image, key: str, names: tuple[str, ...]) -> int:
        name = image.key(key)
        if name is None:
            raise FlightError(
                f"image {image.name} has no {key}, but the sensor tells {', '.join(names)} apart: fill in its {key}"
            )
        if name not in names:
            raise FlightError(f"image {image.name}: the {key} {name!r} is unknown; the sensor has {', '.join(names)}")
        return names.index(name)

    def shot(self, image_index: np.ndarray, line_px: np.ndarray | None = None) -> Shot:
        """Shots of images (indices, (n,)), for line cameras at the given lines, for frame cameras at the image's time.

        **Raises:** `FlightError` naming the image where a line lies outside its line table.
        """
        image_index = np.asarray(image_index)
        keys = {key: self._key_indices(self.images, key) for key in KEYS}
        picked: dict[str, Any] = {key: np.asarray(v)[image_index] for key, v in keys.items() if v and v[0] is not None}
        if not self.is_line:
            times = [image.time_s for image in self.images]
            if all(t is None for t in times):
                return Shot(**picked)
            return Shot(time_s=np.array([np.nan if t is None else t for t in times])[image_index], **picked)
        time = np.full(image_index.shape, np.nan)
        for i in np.unique(image_index):
            here, image = image_index == i, self.images[i]
            if image.lines is None:
                raise FlightError(f"image {image.name} has no line times: add its lines to lines.csv")
            lines = np.asarray(line_px)[here]
            time[here] = np.interp(lines, image.lines.line, image.lines.time_s, left=np.nan, right=np.nan)
            if np.isnan(time[here]).any():
                first, last = float(image.lines.line[0]), float(image.lines.line[-1])
                wrong = lines[np.isnan(time[here])][0]
                raise FlightError(f"image {image.name}: line {wrong:g} lies outside its line table, {first:g} to {last:g}")
        return Shot(time_s=time, **picked)

    @property
    def is_line(self) -> bool:
        """Whether the images are made of lines."""
        return self.sensor.is_line

    @property
    def strips(self) -> Sequence[str]:
        """Names of the strips, in the order in which the rays of `block` number them; empty where an image has none."""
        names = [image.strip for image in self.images]
        return self.sensor.key_names().get("strip", () if None in names else tuple(dict.fromkeys(names)))  # pyright: ignore[reportReturnType]

    def observations(self) -> Observations:
        """Measurements of control and check points, ready for `calibrate`; tie points, which have no coordinates, stay behind."""
        role = np.asarray(self.points.roles)[self.measurements.point]
        keep = np.flatnonzero(role != "tie")
        image, point = self.measurements.image[keep], self.measurements.point[keep]
        shot = self._for_errors(self.shot(image, self.measurements.line_px[keep]), image)
        position = self.points.position_m[point]
        return Observations(
            shot,
            position,
            self._pixels(keep),
            sigma_px(self, keep, shot, position, at_crossing=False),
            role[keep] == "control",
            self.point_covariance_m2()[point],
            [self.images[int(i)].name for i in image],
            [self.points.names[int(i)] for i in point],
        )

    def block(self) -> Block:
        """All measurements and all points, ready for `adjust`; coordinates of tie points, where somebody gave any, stay behind.

        Points keep their indices, seen or not. Where every image has a strip, so have the rays: by the sensor's own numbers, or,
        where no link asks for strips, by those of `strips`.
        """
        role, every = np.asarray(self.points.roles), np.arange(len(self.measurements))
        shot = self.shot(self.measurements.image, self.measurements.line_px)
        sigma = sigma_px(self, every, shot, self._where_rays_go(), at_crossing=True)
        if shot.strip is None and self.strips:
            numbers = np.array([self.strips.index(image.key("strip")) for image in self.images])
            shot = dataclasses.replace(shot, strip=numbers[self.measurements.image])
        return Block(
            shot,
            self._pixels(every),
            sigma,
            self.measurements.point,
            np.where((role == "tie")[:, None], np.nan, self.points.position_m),
            self.point_covariance_m2(),
            role,
            self.points.names,
            [self.images[int(i)].name for i in self.measurements.image],
            self.strips,
        )

    def looks(self, points: Sequence[int], height_m: float | None = None) -> tuple[Looks, Int[np.ndarray, " looks"]]:
        """The measurements of some points (indices) as looks at one target, ready for `locate`.

        **Arguments:** `height_m`: about how high the target lies, which tells how many pixels a line is where sigmas are in
        lines; by default the mean of the other points with coordinates.

        **Returns:** the looks in the order of time, where images have times, and the index of the measurement behind each.

        **Raises:** `WhiskjaxError` where there is none, or some of the images have a time and others none.
        """
        index = np.flatnonzero(np.isin(self.measurements.point, points))
        time = self.shot(self.measurements.image[index], self.measurements.line_px[index]).time_s
        if time is not None:
            index = index[np.argsort(np.asarray(time), kind="stable")]
        shot = self.shot(self.measurements.image[index], self.measurements.line_px[index])
        seen = np.full((len(index), 3), np.nan)
        if self.is_line and self.measurements.is_in_lines[index].any():
            height = lambda: ground_height_m(self, index, points) if height_m is None else height_m
            seen = where_seen(self, index, np.zeros(len(index), dtype=int), height)
        sigma = sigma_px(self, index, shot, seen, at_crossing=False)
        return Looks(self._for_errors(shot, self.measurements.image[index]), self._pixels(index), sigma), index

    def _for_errors(self, shot: Shot, image_index: np.ndarray) -> Shot:
        """The shots with the keys for which errors are drawn anew, where no link asks for them and every image has one."""
        for key in {one.anew for one in self.errors} - {"flight"}:
            names = [image.key(key) for image in self.images]
            if getattr(shot, key) is None and None not in names:
                order = list(dict.fromkeys(names))
                numbers = np.array([order.index(name) for name in names])
                shot = dataclasses.replace(shot, **{key: numbers[image_index]})
        return shot

    def _pixels(self, index: np.ndarray) -> Float[np.ndarray, "n 2"]:
        """Measured (sample, line offset) or (column, row): at its own time a point lies on the line, at offset zero."""
        m, line = self.measurements, self.measurements.line_px[index]
        return np.stack([m.sample_px[index], np.zeros_like(line) if self.is_line else line], axis=-1)

    def _where_rays_go(self) -> Float[np.ndarray, "n 3"]:
        """About where each ray of a block meets the ground, as `adjust` begins: control points where they are given, others where
        their rays meet. NaN where nobody needs it.
        """
        m = self.measurements
        is_control = (np.asarray(self.points.roles) == "control")[m.point]
        where = np.where(is_control[:, None], self.points.position_m[m.point], np.nan)
        rest = np.flatnonzero(~is_control)
        if self.is_line and m.is_in_lines[rest].any():
            whose = np.unique(m.point[rest], return_inverse=True)[1]
            where[rest] = where_seen(self, rest, whose, lambda: ground_height_m(self, rest))
        return where

    def control_height_m(self, other_than: Sequence[int] = ()) -> float | None:
        """Mean ellipsoidal height (z of a local world) of the control points, some (indices) left aside; None without any."""
        control = np.asarray(self.points.roles) == "control"
        control[list(other_than)] = False
        return float(self.world.height_m(self.points.position_m[control]).mean()) if control.any() else None

    def point_covariance_m2(self) -> Float[np.ndarray, "n 3 3"]:
        """Covariance of the points' coordinates in the world frame, from their east, north, up sigmas."""
        axes = self.world.from_enu(self.points.position_m)
        return np.einsum("nij,nj,nkj->nik", axes, np.asarray(self.points.sigma_enu_m) ** 2, axes)
