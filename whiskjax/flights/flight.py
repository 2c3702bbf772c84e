"""A flight: an instrument, its images, surveyed points, what was measured, and what is to be estimated."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..chain.lines import LineTimes
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..earth.ellipsoid import ecef_to_geodetic
from ..earth.frames import enu_rotation
from ..estimate.block.block import ROLES, Block
from ..estimate.block.pos_errors import PosErrors
from ..estimate.observations import Observations
from ..estimate.unknown import Unknown, need_unknowns
from ..locate.looks import Looks
from ..locate.noise import FrameNoise
from ..rules import Arrays, FlightError, Numbers, need


@dataclasses.dataclass(frozen=True)
class World:
    """What coordinates mean: ECEF WGS-84 ("wgs84"), or a local Cartesian frame x east, y north, z up ("local").

    A local world may state its geodetic origin: latitude and longitude in degrees, ellipsoidal height in metres.
    """

    kind: str = "wgs84"
    origin: tuple[float, float, float] | None = None
    height_datum: str = "ellipsoidal"

    def __post_init__(self):
        if self.kind not in ("wgs84", "local"):
            raise FlightError(f"the world is 'wgs84' or 'local', not {self.kind!r}")
        if self.origin is not None:
            place = "latitude and longitude in degrees, height in metres"
            lat, lon, _ = Arrays("World").take("origin", self.origin, "3", finite=True, meaning=place)
            if not (abs(lat) <= 90 and abs(lon) <= 360):
                raise FlightError(f"World: origin is latitude and longitude in degrees and height in metres, not {self.origin}")
        if self.height_datum != "ellipsoidal":
            raise FlightError(f"height_datum {self.height_datum!r}: heights are ellipsoidal; convert them with your geoid first")

    def from_enu(self, position_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Rotations that take east, north, up at world positions to the world's axes; any rotation where a position is NaN."""
        if self.kind == "local" or len(position_m) == 0:
            return np.broadcast_to(np.eye(3), (len(position_m), 3, 3))
        return np.asarray(_ecef_from_enu(np.nan_to_num(position_m, nan=6.4e6)))


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
    """Image measurements as recorded: which image, which point (indices), line and sample in pixels with 1-sigma, (n,) each.

    The centre of the first pixel is at (0, 0).
    """

    image: np.ndarray
    point: np.ndarray
    line_px: np.ndarray
    sample_px: np.ndarray
    sigma_line_px: np.ndarray
    sigma_sample_px: np.ndarray

    def __len__(self) -> int:
        return len(self.image)


@dataclasses.dataclass(frozen=True)
class Flight:
    """Everything about a flight; `read_flight` and `write_flight` turn it from and into a folder.

    `noise`: errors of the recorded poses that are new at every look, for `locate`. `pos_errors`: those that vary slowly, whose
    course `adjust` estimates.
    """

    name: str
    sensor: Sensor
    images: Sequence[Image]
    points: Points
    measurements: Measurements
    unknowns: Sequence[Unknown] = ()
    noise: Sequence[FrameNoise] = ()
    pos_errors: PosErrors | None = None
    world: World = World()
    epoch: str = ""
    reference_point: str = ""
    notes: str = ""

    def __post_init__(self):
        for name, kind in (("sensor", Sensor), ("points", Points), ("measurements", Measurements), ("world", World)):
            need("Flight", name, getattr(self, name), kind)
        for i, image in enumerate(self.images):
            need("Flight", f"images[{i}]", image, Image)
        need_unknowns("Flight", "unknowns", self.unknowns)
        m, arrays = self.measurements, Arrays("Flight")
        for name, known in (("image", len(self.images)), ("point", len(self.points.names))):
            index = np.asarray(arrays.take_whole(f"measurements.{name}", getattr(m, name), "n"))
            wrong = np.flatnonzero((index < 0) | (index >= known))
            if wrong.size:
                raise FlightError(f"Flight: measurement {wrong[0]} is of {name} {index[wrong[0]]}, but there are {known}")
        for name in ("line_px", "sample_px", "sigma_line_px", "sigma_sample_px"):
            arrays.take(f"measurements.{name}", getattr(m, name), "n")

    def key_index(self, image: Image, key: str) -> int | None:
        """The index by which the shot names an image's swing, view, strip or the image itself; None where no link asks for it.

        **Raises:** `FlightError` where the sensor asks for the key and the image has none, or one that the sensor lacks.
        """
        names = self.sensor.key_names().get(key)
        if names is None:
            return [i.name for i in self.images].index(image.name) if key == "image" else None
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
        keys = {key: [self.key_index(image, key) for image in self.images] for key in KEYS}
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
        return Observations(
            self.shot(image, self.measurements.line_px[keep]),
            self.points.position_m[point],
            *self._pixels(keep),
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
        role = np.asarray(self.points.roles)
        shot = self.shot(self.measurements.image, self.measurements.line_px)
        if shot.strip is None and self.strips:
            numbers = np.array([self.strips.index(image.key("strip")) for image in self.images])
            shot = dataclasses.replace(shot, strip=numbers[self.measurements.image])
        return Block(
            shot,
            *self._pixels(np.arange(len(self.measurements))),
            self.measurements.point,
            np.where((role == "tie")[:, None], np.nan, self.points.position_m),
            self.point_covariance_m2(),
            role,
            self.points.names,
            [self.images[int(i)].name for i in self.measurements.image],
            self.strips,
        )

    def looks(self, points: Sequence[int]) -> tuple[Looks, Int[np.ndarray, " looks"]]:
        """The measurements of some points (indices) as looks at one target, ready for `locate`.

        **Returns:** the looks in the order of time, where images have times, and the index of the measurement behind each.

        **Raises:** `WhiskjaxError` where there is none, or some of the images have a time and others none.
        """
        index = np.flatnonzero(np.isin(self.measurements.point, points))
        time = self.shot(self.measurements.image[index], self.measurements.line_px[index]).time_s
        if time is not None:
            index = index[np.argsort(np.asarray(time), kind="stable")]
        shot = self.shot(self.measurements.image[index], self.measurements.line_px[index])
        return Looks(shot, *self._pixels(index)), index

    def _pixels(self, index: np.ndarray) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """Measured (sample, line offset) or (column, row), and their sigmas."""
        m, line = self.measurements, self.measurements.line_px[index]
        pixel = np.stack([m.sample_px[index], np.zeros_like(line) if self.is_line else line], axis=-1)
        return pixel, np.stack([m.sigma_sample_px[index], m.sigma_line_px[index]], axis=-1)

    def point_covariance_m2(self) -> Float[np.ndarray, "n 3 3"]:
        """Covariance of the points' coordinates in the world frame, from their east, north, up sigmas."""
        axes = self.world.from_enu(self.points.position_m)
        return np.einsum("nij,nj,nkj->nik", axes, np.asarray(self.points.sigma_enu_m) ** 2, axes)


@jax.jit
def _ecef_from_enu(point_m: Float[Numbers, "n 3"]) -> Float[Array, "n 3 3"]:
    lat, lon, _ = ecef_to_geodetic(point_m)
    return enu_rotation(lat, lon)
