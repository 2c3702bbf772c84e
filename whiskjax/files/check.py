"""Whether the shots of a flight can image its points at all: asked before anybody estimates anything."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..algebra.vectors import Vec3
from ..chain.by import By
from ..chain.imaging import into_camera
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..earth.ellipsoid import height_and_up
from ..flights.flight import Flight
from ..rules import RESULTS, FlightError
from ..rules.results import codes_of, message_of

# Nobody measures points from beyond this distance that lie below the horizon; a wrong unit or order of coordinates does.
_FAR_M = 1e5


@eqx.filter_jit
def _look(sensor: Sensor, shot: Shot, point: Vec3) -> tuple[RESULTS, RESULTS, Any, Any]:
    """How the shot and the direction fare, and the distance and the climb from the point to the platform."""
    direction = sensor.camera_at(shot).check_direction(into_camera(sensor, shot, point))
    away = [jnp.asarray(a - b) for a, b in zip(sensor.links[0].pose(shot).translation, point, strict=True)]
    _, *up = height_and_up(*point)
    return (
        sensor.check(shot),
        direction,
        jnp.sqrt(sum(c * c for c in away)),
        sum(c * u for c, u in zip(away, up, strict=True)),
    )


def check_flight(flight: Flight, place: Callable[[int], str] | None = None) -> None:
    """Refuse measurements that no shot can have made.

    **Arguments:** `place`: names measurement i for people; by default its number, image and point.

    **Raises:** `FlightError` naming the first measurement whose time lies outside the POS or in a gap, whose point lies behind
    the camera, or, in an ECEF world, beyond the horizon; and where there is no measurement.
    """
    m = flight.measurements
    place = place or (
        lambda i: f"observation {i} (image {flight.images[m.image[i]].name}, point {flight.points.names[m.point[i]]})"
    )
    if len(m) == 0:
        raise FlightError("the flight has no observations: nothing can be estimated from it; add lines to observations.csv")
    for index in _batches(flight):
        _check_batch(flight, index, place)


def _check_batch(flight: Flight, index: np.ndarray, place: Callable[[int], str]) -> None:
    m = flight.measurements
    shot = _one_option(flight, flight.shot(m.image[index], m.line_px[index]), index)
    xyz = flight.points.position_m[m.point[index]]
    known = ~np.isnan(xyz[:, 0])
    # Ties without coordinates are given some point, and nothing is asked about it.
    point = tuple(jnp.asarray(c) for c in np.where(known[:, None], xyz, 7e6).T)
    seen, direction, distance, climb = _look(flight.sensor, shot, point)
    named = lambda i: place(int(index[i]))

    codes = np.broadcast_to(codes_of(seen), index.shape)
    _refuse(codes != 0, lambda i: f"{named(i)}: {_why_not(flight.sensor, _at(shot, i), codes[i])}")

    beyond = known & (np.asarray(distance) > _FAR_M) & (np.asarray(climb) < 0) & (not flight.world.is_flat)
    _refuse(
        beyond,
        lambda i: (
            f"{named(i)}: the point lies {float(distance[i]) / 1e3:.0f} km from the platform, beyond its horizon; are "
            "latitude and longitude swapped, or in another unit, in the POS or in points.csv?"
        ),
    )

    facing = np.where(known, np.broadcast_to(codes_of(direction), index.shape), 0)
    _refuse(
        facing != 0,
        lambda i: (
            f"{named(i)}: {message_of(int(facing[i]))}; look at the signs and the order of the links in flight.toml, at "
            "the time of the image, and at the coordinates of the point"
        ),
    )


def _refuse(bad: np.ndarray, message: Callable[[int], str]) -> None:
    if bad.any():
        count = int(bad.sum())
        more = f" ({count} of {len(bad)} observations in all)" if count > 1 else ""
        raise FlightError(message(int(np.argmax(bad))) + more)


def _batches(flight: Flight) -> list[np.ndarray]:
    """All measurements in one batch, or, where the cameras differ in kind, one batch for each camera."""
    everything = np.arange(len(flight.measurements))
    camera = flight.sensor.camera
    if not isinstance(camera, By) or len({_kind(option) for option in camera.options}) == 1:
        return [everything]
    key = _option_of(flight, camera.key)
    return [np.flatnonzero(key == k) for k in np.unique(key)]


def _kind(camera: Any) -> Any:
    return jax.tree.structure(camera), tuple(np.shape(leaf) for leaf in jax.tree.leaves(camera))


def _option_of(flight: Flight, key: str) -> np.ndarray:
    return np.array([flight.key_index(image, key) for image in flight.images])[flight.measurements.image]


def _one_option(flight: Flight, shot: Shot, index: np.ndarray) -> Shot:
    """The shots of one batch, their camera's key as a Python int where all share it."""
    camera = flight.sensor.camera
    if isinstance(camera, By):
        option = np.unique(_option_of(flight, camera.key)[index])
        if len(option) == 1:
            return dataclasses.replace(shot, **{camera.key: int(option[0])})
    return shot


def _at(shot: Shot, i: int) -> Shot:
    """One shot of a batch."""
    pick = lambda v: v if v is None or isinstance(v, int) else v[i]
    return dataclasses.replace(shot, time_s=pick(shot.time_s), **{key: pick(getattr(shot, key)) for key in KEYS})


def _why_not(sensor: Sensor, shot: Shot, code: Any) -> str:
    """The message of a shot that fails: its time, the link that fails, and what that link recorded."""
    frame = next((name for name in sensor.names if codes_of(sensor[name].check(shot)).any()), "camera")
    time = "" if shot.time_s is None else f"at {float(shot.time_s):.6f} s "
    recorded = _recorded(sensor[frame], shot)
    return f"{time}{message_of(int(code))}; link {frame!r}{recorded}. Take the observation out, or add what the link lacks"


def _recorded(link: Any, shot: Shot) -> str:
    """The samples on both sides of the shot, or the first and the last one."""
    if isinstance(link, By):
        key = int(getattr(shot, link.key))
        return f".{link.names[key]}{_recorded(link.options[key], shot)}" if 0 <= key < len(link.names) else ""
    series = getattr(link, "recorded", ())  # a camera has none
    if not series:
        return ""
    record = series[0]
    time = np.asarray(record.knots.time_s)
    i = int(np.searchsorted(time, float(shot.time_s) + float(record.delay_s)))  # pyright: ignore[reportArgumentType]
    if not 0 < i < len(time):
        return f" was recorded from {time[0]:.6f} to {time[-1]:.6f} s"
    return f" has samples at {time[i - 1]:.6f} and {time[i]:.6f} s and none between; max_gap_s is {record.knots.max_gap_s:g}"
