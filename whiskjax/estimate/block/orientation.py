"""Exterior orientation: where the projection centre and the POS reference point were, how they were turned, and how sure that is.

Poses follow from the stations' motions and the unknowns; their covariance is that of both together, the points integrated out:
C = J S^-1 J^T, with J the small motion of a pose by each of them.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...algebra.vectors import apply, matmul, stack, transpose
from ...chain.pose import Motion
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...chain.stations import AbstractStations
from ...earth.ellipsoid import SEMI_MINOR_M
from ...earth.surface import AbstractSurface, HeightSurface, need_surface
from ...rules import WhiskjaxError, is_traced, need
from .prepare import Prepared, Ready, State

_DEEPEST_M = 50_000.0  # under the ellipsoid there is no sensor: such a position is none of the ECEF world


class Orientation(eqx.Module):
    """Poses of one frame at n exposures.

    - `position_m`: of the origin of the frame, world frame, (n, 3).
    - `world_from_frame`: rotations, (n, 3, 3).
    - `level_from_frame`: the same from east, north and up at the origin, (n, 3, 3).
    - `covariance`: of a small turn (rad) about, and a shift (m) along east, north and up there, (n, 6, 6), turns first.
    """

    position_m: Float[Any, "n 3"]
    world_from_frame: Float[Any, "n 3 3"]
    level_from_frame: Float[Any, "n 3 3"]
    covariance: Float[Any, "n 6 6"]

    @property
    def sigma(self) -> Float[Any, "n 6"]:
        """1-sigma of the turns (rad) and shifts (m)."""
        return jnp.sqrt(jnp.diagonal(self.covariance, axis1=-2, axis2=-1))


class ExteriorOrientation(eqx.Module):
    """What the images were taken from: `camera`, the projection centre and the axes of the camera; `record`, the frame whose
    motions were estimated, that of the POS reference point (where none were, the outermost frame)."""

    camera: Orientation
    record: Orientation
    shot: Shot


def exterior_orientation(
    prepared: Prepared, state: State, inverse: Float[Any, "m m"], shot: Shot | None, surface: AbstractSurface | None
) -> ExteriorOrientation:
    """Exterior orientation at a solution (`Adjustment.exterior_orientation`).

    **Arguments:** `inverse`: of the reduced normal matrix; `shot`, `surface`: as there.

    **Raises:** as there.
    """
    ready = prepared.ready
    if shot is not None:
        need("exterior_orientation", "shot", shot, Shot)
    shot = _of_stations(prepared) if shot is None else shot
    name = ready.unknowns.stations
    level = HeightSurface(0.0) if surface is None else surface
    need_surface("exterior_orientation", level)
    found = []
    for upto in (None, ready.sensor.names[0] if name is None else name):
        one = _orientation(ready, state, jnp.asarray(inverse), shot, upto, level)
        _refuse_unknown_up(one.position_m, level)
        found.append(one)
    camera, record = found
    return ExteriorOrientation(camera, record, shot)


@eqx.filter_jit
def _orientation(
    ready: Ready, state: State, inverse: Float[Array, "m m"], shot: Shot, upto: str | None, level: AbstractSurface
) -> Orientation:
    size = state.x.size

    def pose(y: Float[Array, " m"]):
        sensor: Sensor = ready.unknowns.put(ready.sensor, y[:size].reshape(state.x.shape), y[size:])
        found = sensor.pose(shot, upto)
        shape = jnp.broadcast_shapes(*(jnp.shape(c) for c in jax.tree.leaves((found, shot))))
        return jax.tree.map(lambda c: jnp.broadcast_to(jnp.asarray(c, dtype=float), shape), found)

    y = jnp.concatenate([state.x.ravel(), state.u])
    here, along = jax.linearize(pose, y)
    axes = level.level(here.translation)
    turned = matmul(transpose(axes), here.rotation)

    def motion(direction: Float[Array, " m"]) -> Float[Array, "n 6"]:
        moved = Motion.from_derivative(here, along(direction))
        return jnp.concatenate([stack(apply(turned, moved.turn)), stack(apply(turned, moved.shift))], axis=-1)

    rows = jax.vmap(motion)(jnp.eye(len(y)))
    covariance = jnp.einsum("knc,kl,lnd->ncd", rows, inverse, rows)
    matrix = lambda of: jnp.stack([stack(row) for row in of], axis=-2)
    return Orientation(here.origin_m, here.matrix, matrix(turned), covariance)


def _of_stations(prepared: Prepared) -> Shot:
    """An exposure at every station."""
    name, block = prepared.ready.unknowns.stations, prepared.block
    if name is None:
        raise WhiskjaxError("exterior_orientation: no motions were estimated, so there are no stations; say when: shot=Shot(...)")
    link: AbstractStations = prepared.ready.sensor[name]
    if link.node_s is None:
        return Shot(image=np.arange(link.stations))
    time = np.asarray(block.key("time_s"))
    nearest = np.array([int(np.argmin(np.abs(time - t))) for t in link.node_s])
    return dataclasses.replace(block.shots(nearest), time_s=jnp.asarray(link.node_s))


def _refuse_unknown_up(position_m: Float[Array, "n 3"], level: AbstractSurface) -> None:
    """**Raises:** `WhiskjaxError` where positions are none on the Earth, and the surface is one of the ellipsoid."""
    if not isinstance(level, HeightSurface) or is_traced(position_m):
        return
    away = np.linalg.norm(np.asarray(position_m), axis=-1)
    if (away < SEMI_MINOR_M - _DEEPEST_M).any():
        raise WhiskjaxError(
            f"exterior_orientation: the world is a local one ({np.nanmin(away):.0f} m from its origin), of which nobody said "
            "what is up: surface=Plane((0, 0, 0), (0, 0, 1))"
        )
