"""What every number of a sensor that was not estimated would have done to the pixels, and every image's own pose.

One sweep through the chain tells it of all of them (parameters.py); the score test (fitted.py) then says of each by how much the
sum of squares would fall if it were estimated, the value it would take, and what its being wrong did to the answer.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
from ..rules import compiled, on_device, once
from .errors import unit_motion
from .fitted import VISIBLE, AbstractFitted
from .unknown import Unit, unit_of

# Errors as they come in practice, by the suffix of the field: what silent ones are judged by. Other numbers, those of cameras,
# are wrong by what moves pixels by one (RMS).
_USUAL = {"_m": 0.1, "_rad": 1e-3, "_s": 0.01, "gain": 1e-3, "scale": 0.1}
# A number that has to change by more to move pixels by one (so many usual errors, a coefficient by so much, a focal length by a
# part) acts on hardly more than noise, as where all points lie near the principal point, or an encoder stays near its zero: it
# would be found in that noise.
_LARGEST_USUAL, _LARGEST, _LARGEST_PART = 100.0, 0.1, 0.005


class Suspects(NamedTuple):
    """Columns of pixels, (n, 2, k), by one inner unit of each number; `usual` is how large an error of it is in practice.

    `motion`: by a turn (rad) and a shift (m) of the frame of the record, `frame`, (n, 2, 6).
    """

    names: tuple[str, ...]
    frame: str
    units: tuple[Unit, ...]
    usual: Float[np.ndarray, " k"]
    columns_px: Float[np.ndarray, "n 2 k"]
    motion_px: Float[np.ndarray, "n 2 6"]


class Suspicions(NamedTuple):
    """The score test of each suspect, sizes in units of the usual error, (k,).

    `sigmas`, signed; `chance` of the largest of so many; `size` it would take, and its `sigma`, infinite where it cannot be seen;
    `taken`: how far, in sigmas, a usual error moves the answer; `like`: how alike two of them look in the residuals, (k, k).
    """

    sigmas: Float[np.ndarray, " k"]
    chance: Float[np.ndarray, " k"]
    size: Float[np.ndarray, " k"]
    sigma: Float[np.ndarray, " k"]
    taken: Float[np.ndarray, " k"]
    like: Float[np.ndarray, "k k"]


def tested(fit: AbstractFitted, of: Suspects) -> Suspicions:
    """Each suspect beside nothing else."""
    pattern = fit.whitened((of.columns_px * of.usual).reshape(-1, len(of.names)))
    slope, gram = np.asarray(pattern.T @ fit.residual.ravel()), fit.gram(pattern)
    left, whole = gram.whole - gram.taken, gram.whole.diagonal()
    seen = left.diagonal() > VISIBLE * np.where(whole > 0, whole, 1.0)
    root = np.sqrt(np.where(seen, left.diagonal(), 1.0))
    sigmas = np.where(seen, slope / root, 0.0)
    chance = np.array([math.erfc(abs(z) / math.sqrt(2)) for z in sigmas]) * max(int(seen.sum()), 1)
    taken = np.sqrt(np.maximum(gram.taken.diagonal(), 0.0))
    like = np.abs(np.where(np.outer(seen, seen), left / np.outer(root, root), 0.0))
    return Suspicions(sigmas, chance, sigmas / root, np.where(seen, 1 / root, np.inf), taken, like)


def suspects(
    sensor: Sensor, shot: Shot, point_m: Float[Any, "n 3"], pixel_px: Float[Any, "n 2"], known: tuple[tuple[Address, ...], ...]
) -> Suspects:
    """All numbers that nobody estimated or considered.

    **Arguments:** `sensor`: with the solution put in; `point_m`: where each ray meets its point, world frame; `pixel_px`: where
    it was measured; `known`: the places of the numbers that somebody did.
    """
    taken = {place for of in known for place in of}
    places = tuple(place for place in free_numbers(sensor) if place not in taken)
    for place in places:
        sensor = make_room(sensor, place)
    k = len(places)
    names = tuple(place.text for place in places)
    numbers = Parameters(jnp.zeros(k), jnp.ones(k), jnp.zeros((k, k)), names, tuple((place,) for place in places))
    point, pixel = (unstack(on_device(np.asarray(of, dtype=float))) for of in (point_m, pixel_px))
    x, y, motion = (np.asarray(part) for part in _swept(sensor, shot, point, pixel, numbers))
    columns = np.stack([x, y], axis=-1)
    kinked = [i for i, place in enumerate(places) if place.path[-1] in getattr(_owner(sensor, place), "kinks", ())]
    if kinked:
        columns[kinked] = _across(sensor, shot, point_m, tuple(places[i] for i in kinked))
    length = np.sqrt((columns**2).sum(axis=2).mean(axis=1))
    moving = np.where(length > 0, 1 / np.where(length > 0, length, 1.0), math.inf)
    usual = np.array([_usual(place, float(by)) for place, by in zip(places, moving, strict=True)])
    usual = np.where(moving > [_largest(sensor, place) for place in places], 0.0, usual)
    return Suspects(names, sensor.names[0], tuple(map(unit_of, places)), usual, np.moveaxis(columns, 0, -1), motion)


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
    numbers = Parameters(jnp.asarray(now), jnp.asarray(step_s), jnp.zeros((k, k)), names, of)
    sides = jnp.concatenate([jnp.eye(k), -jnp.eye(k)])
    pixel = np.asarray(_pixels(sensor, shot, unstack(on_device(np.asarray(point_m))), numbers, sides))
    return (pixel[:k] - pixel[k:]) / (2 * step_s[:, None, None])


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


def _all_columns(sensor: Sensor, shot: Shot, point: Vec3, pixel: Vec2, numbers: Parameters) -> tuple[Array, Array, Array]:
    """By each number, (k, n) of x and of y, and by the six motions of the outermost frame, (n, 2, 6).

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
    outermost = sensor.names[0]
    six = [found.follows(outermost, unit_motion(axis)) for axis in range(6)]
    rows = [jnp.stack([jnp.broadcast_to(jnp.asarray(c, dtype=float), (n,)) for c in of], -1) for of in zip(*six, strict=True)]
    return x, y, jnp.stack(rows, -2)


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
