"""A block made ready: tiles on the device, start values, priors."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...algebra.vectors import Vec3
from ...chain.address import Address, make_room
from ...chain.correction import AbstractUniform, Correction
from ...chain.sensor import Sensor
from ...rules import WhiskjaxError
from ...rules.sizes import rounded
from ..given import Knowledge, given, posed
from .block import Block
from .connect import seen_once
from .plan import Plan, plan
from .station_errors import StationErrors
from .tiles import Chunk, Tiles, Unknowns


class State(eqx.Module):
    """Where the adjustment is: whitened motions and unknowns, and the points, (chunks, tiles, points) each."""

    x: Float[Array, "6 stations"]
    u: Float[Array, " q"]
    points: Vec3


class Ready(eqx.Module):
    """A block as numbers. `roots` are the rows of POS, whitened."""

    sensor: Sensor
    unknowns: Unknowns
    tiles: Tiles
    roots: Float[Array, "6 stations stations"]


@dataclasses.dataclass(frozen=True)
class Prepared:
    """`Ready` with what leads back from chunks to rays and points, on the host."""

    ready: Ready
    start: State
    plan: Plan
    block: Block

    def by_ray(self, of_chunks: Any) -> Float[np.ndarray, "rays ..."]:
        """From an array (chunks, units, rays, points, ...) to one row a ray."""
        return _gathered(self.plan.ray, of_chunks, len(self.block))

    def by_point(self, of_chunks: Any) -> Float[np.ndarray, "points ..."]:
        """From an array (chunks, tiles, points, ...) to one row a point; NaN for points that nobody sees."""
        return _gathered(self.plan.point, of_chunks, len(self.block.role))

    def weighted(self, weight: Float[np.ndarray, "rays 2"], state: State) -> "Prepared":
        """The same with other weights (one over sigma) of the rays, 0 to leave out, starting from a state.

        Points that keep fewer rays than two, and are no control points, stay where they are and take no part. Control points are
        those of `block`, whatever they were when it was prepared.
        """
        lone = self.lone(weight[:, 0] > 0)
        weight = np.where(lone[self.block.point][:, None], 0.0, weight)
        held = _components(np.where((self.plan.ray >= 0)[..., None], weight[self.plan.ray], 0.0), self.ready.tiles)
        known = self.block.role == "control"
        information = _information(self.plan, self.block.information(), lone)
        control = _components((known[self.plan.point] & (self.plan.point >= 0))[..., None], self.ready.tiles)[0]
        tiles = self.ready.tiles
        given = _components(np.where(known[:, None], self.block.position_m, 0.0)[_whose(self.block, self.plan)], tiles)
        place = tuple(jnp.where(control, p, at) for p, at in zip(given, state.points, strict=True))
        changed = (held, place, _components(information, tiles))
        tiles = eqx.tree_at(lambda t: (t.chunks.weight, t.chunks.place, t.chunks.prior), tiles, changed)
        return dataclasses.replace(self, ready=eqx.tree_at(lambda r: r.tiles, self.ready, tiles), start=state)

    def lone(self, used: Bool[np.ndarray, " rays"]) -> Bool[np.ndarray, " points"]:
        """Points that fewer than two used rays see, and that are no control points."""
        count = np.bincount(self.block.point[used], minlength=len(self.block.role))
        return (count < 2) & (self.block.role != "control")


def _gathered(index: np.ndarray, of_chunks: Any, size: int) -> np.ndarray:
    array = np.asarray(of_chunks)[: len(index)]
    out = np.full((size, *array.shape[index.ndim :]), np.nan)
    out[index[index >= 0]] = array[index >= 0]
    return out


def prepare(
    sensor: Sensor,
    block: Block,
    unknowns: Knowledge,
    motions: StationErrors | None,
    start_m: Float[np.ndarray, "points 3"],
    keep: Plan | None = None,
) -> Prepared:
    """A block ready to be solved; check and tie points that one ray alone sees take no part.

    **Arguments:** `start_m`: approximate coordinates of every other point that some ray sees; `keep`: a plan for the same rays,
    used again where all stations still lie in their windows.

    **Raises:** `WhiskjaxError` for unknowns, links or keys that make no sense.
    """
    sensor, others, u = posed(sensor, given("adjust", "unknowns", unknowns))
    for key in sensor.key_names():
        if block.key(key) is None:
            raise WhiskjaxError(f"the sensor tells its {key}s apart, but the rays of the block carry no {key}")
    sigma, stations, roots = np.zeros(6), 0, np.zeros((6, 0, 0))
    first, acting, segments = np.zeros(len(block), dtype=int), 1, (1,)
    if motions is not None:
        for name, of in zip(others.names, others.places, strict=True):
            if any(place.link == motions.link for place in of):
                raise WhiskjaxError(f"unknown {name} lives in {motions.link}, whose motions are estimated as its errors")
        for field in ("turn_rad", "shift_m"):
            sensor = make_room(sensor, Address(motions.link, (field,), (0, 0)))
        link = motions.stations(sensor)
        sigma, stations, roots = motions.sigma, link.stations, motions.roots(sensor)
        basis = link.basis if isinstance(link, Correction) else None
        segments = basis.nodes if isinstance(basis, AbstractUniform) else (stations,)
        pairs = link.acting(block.shots())
        first, acting = np.broadcast_to(np.asarray(pairs[0][0]), (len(block),)), len(pairs)
    laid = keep if keep is not None and keep.holds(first, acting) else plan(block.point, first, acting, segments)
    numbers = Unknowns(others, jnp.asarray(sigma), None if motions is None else motions.link)
    known, lonely = block.role == "control", seen_once(block)
    # They have no place; seats on the device hold numbers, and have no weight.
    start_m = np.where(lonely[:, None], start_m[block.point[~lonely[block.point]][0]], start_m)
    place = np.where(known[:, None], block.position_m, start_m)
    tiles = _tiles(block, laid, place, block.information())
    points = _components(start_m[_whose(block, laid)], tiles)
    ready = Ready(sensor, numbers, tiles, jnp.asarray(roots))
    state = State(_whitened_motions(sensor, numbers, stations), jnp.asarray(u), points)
    prepared = Prepared(ready, state, laid, block)
    return prepared.weighted(1 / block.sigma_px, state) if lonely.any() else prepared


def _whitened_motions(sensor: Sensor, numbers: Unknowns, stations: int) -> Float[Array, "6 stations"]:
    """What the sensor already holds of the stations' motions."""
    if numbers.stations is None:
        return jnp.zeros((6, 0))
    held = np.zeros((6, stations))
    turn, shift = sensor[numbers.stations].motions
    for rows, part in ((slice(0, 3), turn), (slice(3, 6), shift)):
        if part is not None:
            held[rows] = np.asarray(part).T
    sigma = np.asarray(numbers.sigma)[:, None]
    return jnp.asarray(np.divide(held, sigma, out=np.zeros_like(held), where=sigma > 0))


def _tiles(block: Block, laid: Plan, place: np.ndarray, information: np.ndarray) -> Tiles:
    """Rays and points on the device; seats without a ray repeat one of the unit's rays with no weight."""
    some = np.maximum(laid.ray.max(axis=(2, 3)), 0)
    stand_in = np.where(laid.ray >= 0, laid.ray, some[:, :, None, None])
    weight = np.where((laid.ray >= 0)[..., None], 1 / block.sigma_px[stand_in], 0.0)
    who = _whose(block, laid)
    held: Any = Chunk(
        block.shots(stand_in),
        _columns(block.pixel_px[stand_in]),
        _columns(weight),
        _columns(place[who]),
        _columns(_information(laid, information, np.zeros(len(information), dtype=bool))),
        *(jnp.asarray(a, dtype=jnp.int32) for a in (laid.tile, laid.start, laid.pair, laid.units, laid.pairs)),
    )
    size = rounded(len(laid.units))
    grown = jax.tree.map(lambda a: jnp.asarray(_grown(np.asarray(a), size)), held)
    return Tiles(grown, jnp.asarray(len(laid.units)), laid.width)


def _whose(block: Block, laid: Plan) -> np.ndarray:
    """The point of every place; where there is none, one that is seen, whose coordinates are numbers."""
    return np.where(laid.point >= 0, laid.point, block.point[0])


def _information(laid: Plan, information: np.ndarray, lone: np.ndarray) -> np.ndarray:
    """Upper triangles of the points of every tile; the identity where there is no point, or one that takes no part."""
    upper = np.stack([information[:, i, j] for i in range(3) for j in range(i, 3)], axis=-1)
    identity = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    takes_part = (laid.point >= 0) & ~lone[laid.point]
    return np.where(takes_part[..., None], upper[laid.point], identity)


def _grown(a: np.ndarray, size: int) -> np.ndarray:
    """Longer by copies of the last entry, which nobody reads."""
    return np.concatenate([a, np.repeat(a[-1:], size - len(a), axis=0)])


def _columns(a: np.ndarray) -> Any:
    return tuple(np.ascontiguousarray(a[..., i]) for i in range(a.shape[-1]))


def _components(a: np.ndarray, like: Tiles) -> Any:
    """Components on the device, as long as the tiles' arrays."""
    size = like.chunks.units.shape[0]
    return tuple(jnp.asarray(_grown(column, size)) for column in _columns(a))
