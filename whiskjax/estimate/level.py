"""East, north and up at a frame: motions that are stated there, seen in the frame's own axes."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Mat3, Vec3, apply, matmul, norm, stack, transpose, unstack
from ..chain.pose import Motion, Pose
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..earth.ellipsoid import SEMI_MINOR_M
from ..earth.surface import AbstractSurface, HeightSurface
from ..rules import WhiskjaxError, is_traced

_DEEPEST_M = 50_000.0  # under the ellipsoid there is no sensor: such a position is none of the ECEF world


def in_frame(frame: str, motion: Motion, shot: Shot, sensor: Sensor | None, surface: AbstractSurface | None = None) -> Motion:
    """A motion about east, north and up at a frame, as one about its own axes.

    **Raises:** `WhiskjaxError` where no sensor says how the frame is turned, or nobody knows what is up.
    """
    if sensor is None:
        raise WhiskjaxError(f"errors of {frame} are in level axes; a sensor is needed, which says how the frame is turned")
    rotation = frame_from_level(frame, sensor.pose(shot, frame), surface)
    return Motion(apply(rotation, motion.turn), apply(rotation, motion.shift))


def frame_from_level(frame: str, world_from_frame: Pose, surface: AbstractSurface | None = None) -> Mat3:
    """The rotation from east, north, up at the origin of a frame into the frame's axes.

    **Arguments:** `surface`: what is level; the ellipsoid by default.

    **Raises:** `WhiskjaxError` where the world is a local one, of which the ellipsoid does not know what is up.
    """
    level = HeightSurface(0.0) if surface is None else surface
    refuse_unknown_up(frame, world_from_frame.translation, level)
    return matmul(transpose(world_from_frame.rotation), level.level(world_from_frame.translation))


def level_at(position_m: Float[np.ndarray, "3"]) -> tuple[tuple[str, str, str], Float[np.ndarray, "3 3"]]:
    """East, north and up at a place, as columns in the world frame; x, y and z in a local world."""
    if np.linalg.norm(position_m) < SEMI_MINOR_M - _DEEPEST_M:
        return ("x", "y", "z"), np.eye(3)
    matrix: Any = _level(position_m)
    return ("east", "north", "up"), np.asarray(matrix)


@jax.jit
def _level(position_m: Float[np.ndarray, "3"]) -> Float[Array, "3 3"]:
    return jnp.stack([stack(row) for row in HeightSurface(0.0).level(unstack(position_m))])


def refuse_unknown_up(frame: str, position: Vec3, surface: AbstractSurface) -> None:
    """**Raises:** `WhiskjaxError` where positions are none on the Earth, and the surface is one of the ellipsoid."""
    if not isinstance(surface, HeightSurface) or any(is_traced(c) for c in position):
        return
    away = np.asarray(norm(position))
    if (away < SEMI_MINOR_M - _DEEPEST_M).any():
        raise WhiskjaxError(
            f"errors of {frame} are in level axes, but the world is a local one ({np.nanmin(away):.0f} m from its origin), of "
            "which nobody said what is up: surface=Plane((0, 0, height), (0, 0, 1))"
        )
