"""The rays and points of a block on the device, chunk by chunk, and what is unknown besides the points."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ...algebra.vectors import Component, Vec2, Vec3
from ...chain.parameters import Parameters
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...chain.stations import AbstractStations
from ...rules import arrays_of, on_device, plain


class Chunk(eqx.Module):
    """One chunk: fields as in `Tiles`, without their first axis."""

    shot: Shot
    pixel: Vec2
    weight: Vec2
    place: Vec3
    prior: tuple[Component, ...]
    tile: Int[Array, " units"]
    start: Int[Array, " units"]
    pair: Int[Array, "pairs 2"]
    units: Int[Array, ""]
    pairs: Int[Array, ""]


class Tiles(eqx.Module):
    """All chunks of a `Plan`.

    Rays, (chunks, units, rays, points): `shot`, `pixel`, and `weight`, one over sigma, zero for a ray that takes no part.
    Points, (chunks, tiles, points): `place` and `prior` of control points, the upper triangle of their information; the identity
    where there is no point.
    """

    chunks: Chunk
    count: Int[Array, ""]  # chunks that hold something: arrays are a little longer, so that few shapes are compiled
    width: int = eqx.field(static=True)

    def chunk(self, k: Any) -> Chunk:
        """The k-th chunk."""
        return jax.tree.map(lambda a: jax.lax.dynamic_index_in_dim(a, k, keepdims=False), self.chunks)


class Unknowns(eqx.Module):
    """What is estimated besides the points: numbers of the sensor, and motions of stations, sigma * x of each."""

    others: Parameters
    sigma: Float[Array, " 6"]
    stations: str | None = eqx.field(static=True)

    def stations_of(self, sensor: Sensor) -> int:
        """How many stations there are."""
        if self.stations is None:
            return 0
        link: AbstractStations = sensor[self.stations]
        return link.stations

    def put(self, sensor: Sensor, x: Float[Array, "6 stations"], u: Float[Array, " q"]) -> Sensor:
        """The sensor with whitened motions and unknowns put in."""
        sensor = self.others.put(sensor, plain(u))
        if self.stations is None:
            return sensor
        link = sensor.names.index(self.stations)
        stations: Any = sensor.links[link]
        parts = [np.zeros((x.shape[1], 3)) if m is None else plain(m) for m in (stations.turn_rad, stations.shift_m)]
        x, sigma = plain(x), plain(self.sigma)
        math = arrays_of((x, sigma, parts))  # outside of tracing nothing has to be compiled for it
        motions = math.where(sigma > 0, (sigma[:, None] * x).T, math.concatenate(parts, axis=1))

        def where(s: Sensor) -> Any:
            held: Any = s.links[link]
            return held.turn_rad, held.shift_m

        return eqx.tree_at(
            where, sensor, (on_device(motions[:, :3]), on_device(motions[:, 3:])), is_leaf=lambda leaf: leaf is None
        )
