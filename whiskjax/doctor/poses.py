"""Recorded poses of a flight, changed sample by sample: attitudes against the local level, and positions."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..algebra.vectors import unstack
from ..chain.attitudes import Slerp, TurnSpline
from ..chain.samples import matrices_from_quaternions, quaternions_from_matrices, sign_continuous
from ..chain.sensor import Sensor
from ..chain.trajectory import PosePerImage, Trajectory
from ..flights.flight import Flight

Turning = Callable[[Float[np.ndarray, "n 3 3"]], Float[np.ndarray, "n 3 3"]]
# East, north, up as north, east, down, and back.
SWAP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


def with_links(sensor: Sensor, change: Callable[[str, Any], Any]) -> Sensor:
    """The sensor with every link as `change` makes it of its name and itself."""
    links = {name: change(name, link) for name, link in zip(sensor.names, sensor.links, strict=True)}
    return Sensor(links, sensor.camera, sensor.refraction)


def tables(flight: Flight) -> str:
    """Where the poses are recorded, for people."""
    kinds = {type(link) for link in flight.sensor.links}
    return " and ".join(name for kind, name in ((Trajectory, "pos.csv"), (PosePerImage, "poses.csv")) if kind in kinds)


def is_recorded(flight: Flight) -> bool:
    """Whether the sensor holds recorded poses that can be changed."""
    return any(isinstance(link, Trajectory | PosePerImage) for link in flight.sensor.links)


def turned(flight: Flight, turn: Turning) -> Flight:
    """The flight with other attitudes. **Arguments:** `turn`: of rotations ned_from_body, (n, 3, 3)."""
    return world_turned(flight, lambda r, level: level @ turn(np.swapaxes(level, -1, -2) @ r))


def world_turned(flight: Flight, turn: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Flight:
    """The same of rotations world_from_body, with world_from_ned at each sample."""

    def change(_: str, link: Any) -> Any:
        if not _records(link):
            return link
        position = np.stack([np.asarray(c) for c in link.position_m], axis=-1)
        level = flight.world.from_enu(position) @ SWAP
        rotation = matrices_from_quaternions(np.stack([np.asarray(c) for c in link.quaternion], axis=-1))
        return _with_attitudes(link, quaternions_from_matrices(turn(rotation, level)))

    return dataclasses.replace(flight, sensor=with_links(flight.sensor, change))


def _with_attitudes(link: Trajectory | PosePerImage, quaternion: Float[np.ndarray, "n 4"]) -> Trajectory | PosePerImage:
    if isinstance(link, PosePerImage):
        return eqx.tree_at(lambda p: p.quaternion, link, unstack(quaternion))
    quaternion = sign_continuous(quaternion)
    time, gaps = np.asarray(link.knots.time_s), np.asarray(link.knots.is_gap)
    turning = Slerp(quaternion) if link.interpolation == "linear" else TurnSpline(time, quaternion, gaps)
    # Not by the constructor, which refuses what no platform can fly: here it is one of many things that are tried.
    return eqx.tree_at(lambda t: (t.quaternion, t.turning), link, (unstack(quaternion), turning))


def lifted(flight: Flight, by_m: float) -> Flight:
    """The flight with all recorded positions higher."""

    def change(_: str, link: Any) -> Any:
        if not _records(link):
            return link
        position = np.stack([np.asarray(c) for c in link.position_m], axis=-1)
        return eqx.tree_at(lambda x: x.position_m, link, unstack(position + by_m * flight.world.from_enu(position)[:, :, 2]))

    return dataclasses.replace(flight, sensor=with_links(flight.sensor, change))


def _records(link: Any) -> bool:
    return isinstance(link, Trajectory | PosePerImage)


def about(axis: str, angle_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 3"]:
    """Active rotations about x, y or z."""
    s, c, k = np.sin(angle_rad), np.cos(angle_rad), "xyz".index(axis)
    out = np.zeros((len(s), 3, 3))
    i, j = (k + 1) % 3, (k + 2) % 3
    out[:, k, k], out[:, i, i], out[:, j, j], out[:, i, j], out[:, j, i] = 1.0, c, c, -s, s
    return out


def roll_pitch_heading(r: Float[np.ndarray, "n 3 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of rotations ned_from_body = Rz(heading) Ry(pitch) Rx(roll), radians, (n,) each."""
    pitch = np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0]))
    return np.arctan2(r[:, 2, 1], r[:, 2, 2]), pitch, np.arctan2(r[:, 1, 0], r[:, 0, 0])


def omega_phi_kappa(r: Float[np.ndarray, "n 3 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of rotations enu_from_body = Rx(omega) Ry(phi) Rz(kappa), radians, (n,) each."""
    phi = np.arctan2(r[:, 0, 2], np.hypot(r[:, 0, 0], r[:, 0, 1]))
    return np.arctan2(-r[:, 1, 2], r[:, 2, 2]), phi, np.arctan2(-r[:, 0, 1], r[:, 0, 0])
