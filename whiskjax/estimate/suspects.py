"""What all that was taken as known would have done to the pixels: numbers of the sensor that nobody estimated, the poses of its
record, and the datum of the control points.

One sweep through the chain tells it of all of them (parameters.py); the score test (fitted.py) then says of each by how much the
sum of squares would fall if it were estimated, the value it would take, and what its being wrong did to the answer.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import Vec2, Vec3, unstack
from ..chain.address import Address, make_room, node_at, read
from ..chain.camera import AbstractCamera
from ..chain.free_numbers import free_numbers
from ..chain.imaging import into_camera
from ..chain.joints import joint_derivatives
from ..chain.link import AbstractLink
from ..chain.parameters import Parameters, passages
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.stations import AbstractStations
from ..rules import compiled, on_device, once
from .errors import unit_motion
from .fitted import AbstractFitted
from .level import level_at
from .unknown import ANGLE, METRE, Unit, unit_of

# Errors as they come in practice, by the suffix of the field: what silent ones are judged by. Other numbers, those of cameras,
# are wrong by what moves pixels by one (RMS).
_USUAL = {"zero_rad": 5e-3, "_m": 0.1, "_rad": 1e-3, "_s": 0.01, "gain": 1e-3, "scale": 0.1}
# National datums that move with their plate are half a metre from the global ones after twenty years.
DATUM, _DATUM_M = "datum", 0.5
# A number that has to change by more to move pixels by one (so many usual errors, a coefficient by so much, a focal length by a
# part) acts on hardly more than noise, as where all points lie near the principal point, or an encoder stays near its zero: it
# would be found in that noise.
_LARGEST_USUAL, _LARGEST, _LARGEST_PART = 100.0, 0.1, 0.005
_MOTIONS = ("turn x", "turn y", "turn z", "shift x", "shift y", "shift z")
_POSE_UNITS, _POSE_USUAL = (ANGLE,) * 3 + (METRE,) * 3, (1e-3,) * 3 + (0.1,) * 3


class Suspects(NamedTuple):
    """Columns of pixels, (n, 2, k), by one inner unit of each number; `usual` is how large an error of it is in practice.

    `kin`: what a number is one component of, as "datum"; "" of a number of the sensor. `motion_px`: by a turn (rad, axes of the
    frame of the record, `frame`) and a shift (m, there), (n, 2, 6); `place_px`: by the point, world frame, (n, 2, 3).
    """

    names: tuple[str, ...]
    kin: tuple[str, ...]
    frame: str
    units: tuple[Unit, ...]
    usual: Float[np.ndarray, " k"]
    columns_px: Float[np.ndarray, "n 2 k"]
    motion_px: Float[np.ndarray, "n 2 6"]
    place_px: Float[np.ndarray, "n 2 3"]


class Suspicions(NamedTuple):
    """The score test of each suspect, sizes in units of the usual error, (k,).

    `sigmas`, signed; `chance` of the largest of so many; `size` it would take, and its `sigma`, infinite where it cannot be seen;
    `taken`: how far, in sigmas, a usual error moves the answer; `like`: how alike two of them look in the residuals, and `same`:
    in what they do to the answer, (k, k) each.
    """

    sigmas: Float[np.ndarray, " k"]
    chance: Float[np.ndarray, " k"]
    size: Float[np.ndarray, " k"]
    sigma: Float[np.ndarray, " k"]
    taken: Float[np.ndarray, " k"]
    like: Float[np.ndarray, "k k"]
    same: Float[np.ndarray, "k k"]


def tested(fit: AbstractFitted, of: Suspects, everything: AbstractFitted | None = None) -> Suspicions:
    """Each suspect beside nothing else.

    **Arguments:** `everything`: the fit that knows the check points too, of which the answer does not: they see more.
    """
    errors_px = (of.columns_px * of.usual).reshape(-1, len(of.names))
    pattern, asked = fit.whitened(errors_px), fit if everything is None else everything
    answer = fit.gram(pattern).taken
    pattern = pattern if everything is None else everything.whitened(errors_px)
    slope, gram = np.asarray(pattern.T @ asked.residual.ravel()), asked.gram(pattern)
    left, whole = gram.whole - gram.taken, gram.whole.diagonal()
    seen = left.diagonal() > asked.visible * np.where(whole > 0, whole, 1.0)
    root = np.sqrt(np.where(seen, left.diagonal(), 1.0))
    sigmas = np.where(seen, slope / root, 0.0)
    chance = np.array([math.erfc(abs(z) / math.sqrt(2)) for z in sigmas]) * max(int(seen.sum()), 1)
    taken = np.sqrt(np.maximum(answer.diagonal(), 0.0))
    like = np.abs(np.where(np.outer(seen, seen), left / np.outer(root, root), 0.0))
    same = np.abs(answer / np.outer(*2 * [np.where(taken > 0, taken, np.inf)]))
    return Suspicions(sigmas, chance, sigmas / root, np.where(seen, 1 / root, np.inf), taken, like, same)


def suspects(
    sensor: Sensor,
    shot: Shot,
    point_m: Float[Any, "n 3"],
    pixel_px: Float[Any, "n 2"],
    known: tuple[tuple[Address, ...], ...],
    given: Bool[Any, " n"] | None = None,
    stated: bool = False,
) -> Suspects:
    """All numbers that nobody estimated or considered, the poses of the record, and the datum of given points.

    **Arguments:** `sensor`: with the solution put in; `point_m`: where each ray meets its point, world frame; `pixel_px`: where
    it was measured; `known`: the places of the numbers that somebody did; `given`: rays whose point was surveyed; `stated`:
    whether errors of the poses were stated.
    """
    taken = {place for of in known for place in of}
    places = tuple(place for place in free_numbers(sensor) if place not in taken)
    sensor = make_room(sensor, *places)
    k = len(places)
    names = tuple(place.text for place in places)
    numbers = Parameters(*_numbers(np.zeros(k), np.ones(k)), names, tuple((place,) for place in places))
    point, pixel = (unstack(on_device(np.asarray(of, dtype=float))) for of in (point_m, pixel_px))
    x, y, motion, place = (np.asarray(part) for part in _swept(sensor, shot, point, pixel, numbers))
    columns = np.stack([x, y], axis=-1)
    kinked = [i for i, place in enumerate(places) if place.path[-1] in getattr(_owner(sensor, place), "kinks", ())]
    if kinked:
        columns[kinked] = _across(sensor, shot, point_m, tuple(places[i] for i in kinked))
    length = np.sqrt((columns**2).sum(axis=2).mean(axis=1))
    moving = np.where(length > 0, 1 / np.where(length > 0, length, 1.0), math.inf)
    usual = np.array([_usual(place, float(by)) for place, by in zip(places, moving, strict=True)])
    usual = np.where(moving > [_largest(sensor, place) for place in places], 0.0, usual)
    frame = record_frame(sensor)
    found = Suspects(names, ("",) * k, frame, tuple(map(unit_of, places)), usual, np.moveaxis(columns, 0, -1), motion, place)
    if not stated:
        found = _with(found, f"poses of {frame}", _MOTIONS, _POSE_UNITS, _POSE_USUAL, motion)
    if given is not None and np.any(given):
        axes, world_from_level = level_at(np.asarray(point_m)[np.asarray(given)].mean(axis=0))
        moved = np.where(np.asarray(given)[:, None, None], place, 0.0) @ world_from_level
        found = _with(found, DATUM, axes, (METRE,) * 3, (_DATUM_M,) * 3, moved)
    return found


def record_frame(sensor: Sensor) -> str:
    """Whose errors are stated: the frame whose motions a block estimates, or else the outermost one, which is the record's."""
    links = zip(sensor.names, sensor.links, strict=True)
    return next((name for name, link in links if isinstance(link, AbstractStations)), sensor.names[0])


def _with(
    found: Suspects, what: str, parts: tuple[str, ...], units: tuple[Unit, ...], usual: tuple[float, ...], columns_px: np.ndarray
) -> Suspects:
    """With the components of something that all records, or all given points, have in common."""
    return found._replace(
        names=found.names + tuple(f"{what}, {part}" for part in parts),
        kin=found.kin + (what,) * len(parts),
        units=found.units + units,
        usual=np.append(found.usual, usual),
        columns_px=np.concatenate([found.columns_px, columns_px], axis=2),
    )


def _owner(sensor: Sensor, place: Address) -> Any:
    """The part that has the number."""
    return node_at(sensor, place._replace(path=place.path[:-1]))


def _spacing_s(link: AbstractLink) -> float:
    """Of the samples of its record."""
    time_s: Any = np.asarray(link.recorded[0].knots.time_s)
    return float(np.median(np.diff(time_s)))


def _across(
    sensor: Sensor, shot: Shot, point_m: Float[Any, "n 3"], places: tuple[Address, ...]
) -> Float[np.ndarray, "delays n 2"]:
    """What delays of linearly interpolated records do, per second: the difference from one sample earlier to one later.

    Their derivative is the slope between two samples, whose errors are those of the pose itself: so noise of the record would
    look like a delay. Of white errors this difference has none in common with the pose.
    """
    step_s = np.array([_spacing_s(_owner(sensor, p)) for p in places])
    now, k = np.array([float(np.asarray(read(sensor, place))) for place in places]), len(places)
    names, of = tuple(place.text for place in places), tuple((place,) for place in places)
    numbers = Parameters(*_numbers(now, step_s), names, of)
    sides = on_device(np.concatenate([np.eye(k), -np.eye(k)]))
    pixel = np.asarray(_pixels(sensor, shot, unstack(on_device(np.asarray(point_m))), numbers, sides))
    return (pixel[:k] - pixel[k:]) / (2 * step_s[:, None, None])


def _numbers(mean: Float[np.ndarray, " k"], scale: Float[np.ndarray, " k"]) -> tuple[Any, Any, Any]:
    """Mean, scale and root of numbers without a prior, on the device."""
    return on_device(mean), on_device(scale), on_device(np.zeros((len(mean),) * 2))


def _largest(sensor: Sensor, place: Address) -> float:
    """The largest error that is looked for."""
    if (usual := _stated(place)) is not None:
        return _LARGEST_USUAL * usual
    if place.path[-1] == "focal_px":
        return _LARGEST_PART * abs(float(np.asarray(read(sensor, place))))
    return _LARGEST if unit_of(place).name == "1" else math.inf


def _usual(place: Address, moving: float) -> float:
    """**Arguments:** `moving`: what moves pixels by one."""
    usual = _stated(place)
    return usual if usual is not None else moving if math.isfinite(moving) else 0.0


def _stated(place: Address) -> float | None:
    return next((size for suffix, size in _USUAL.items() if place.path[-1].endswith(suffix)), None)


def _all_columns(sensor: Sensor, shot: Shot, point: Vec3, pixel: Vec2, numbers: Parameters) -> tuple[Array, ...]:
    """By each number, (k, n) of x and of y, by the six motions of the record's frame, (n, 2, 6), and by the point, (n, 2, 3).

    By numbers of the camera where a ray was measured, not where it is projected: there the errors of the poses are in the place,
    and residuals would be explained by themselves. Across a detector line the measured offset is noise, and the line is taken.
    """
    found = once(lambda: joint_derivatives(sensor, shot, point))
    met = passages(sensor, point, found, numbers.links)
    if "camera" in met:
        camera = sensor.camera_at(shot)
        measured = (pixel[0], jnp.zeros_like(pixel[0])) if camera.is_line else pixel
        met["camera"] = met["camera"]._replace(outer=once(lambda: _seen_at(camera, measured, found.points[sensor.names[-1]])))
    n = point[0].shape[0]
    x, y = jnp.zeros((len(numbers), n)), jnp.zeros((len(numbers), n))
    for part in numbers.columns(sensor, shot, met):
        which = np.array(part.which)
        x, y = (
            whole.at[which].add(jnp.broadcast_to(jnp.asarray(of, dtype=float), (len(which), n)))
            for whole, of in ((x, part.x), (y, part.y))
        )
    frame = record_frame(sensor)
    six = [found.follows(frame, unit_motion(axis)) for axis in range(6)]
    each = lambda of: jnp.stack([jnp.broadcast_to(jnp.asarray(c, dtype=float), (n,)) for c in of], -1)
    rows = lambda pair: jnp.stack([each(of) for of in pair], -2)
    return x, y, rows(zip(*six, strict=True)), rows(found.derivatives["earth"])


def _seen_at(camera: AbstractCamera, pixel: Vec2, like: Vec3) -> Vec3:
    """The direction of a pixel in the camera frame; where there is none, that of the point."""
    direction = camera.direction(pixel)
    there = jnp.isfinite(sum(jnp.asarray(c, dtype=float) for c in direction))
    x, y, z = (jnp.where(there, d, p) for d, p in zip(direction, like, strict=True))
    return x, y, z


def _all_pixels(
    sensor: Sensor, shot: Shot, point: Vec3, numbers: Parameters, u: Float[Array, "cases k"]
) -> Float[Array, "cases n 2"]:
    """Of each case of the numbers, one after the other."""

    def of(u: Array) -> Array:
        changed = numbers.put(sensor, u)
        x, y = changed.camera_at(shot).pixel(into_camera(changed, shot, point))
        return jnp.stack([jnp.broadcast_to(c, point[0].shape) for c in (x, y)], -1)

    return jax.lax.map(of, u)


_pixels: Callable[..., Any] = compiled(_all_pixels, lambda sensor, shot, point, numbers, u: point[0].size)
_swept: Callable[..., Any] = compiled(_all_columns, lambda sensor, shot, point, pixel, numbers: point[0].size)
