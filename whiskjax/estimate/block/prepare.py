"""A block made ready: tiles on the device, start values, priors."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...algebra.vectors import Vec3
from ...chain.address import Address, make_room
from ...chain.sensor import Sensor
from ...chain.stations import AbstractStations
from ...rules import WhiskjaxError, arrays_of, is_traced, on_device, plain
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
    """A block as numbers. `roots` are the rows of POS, whitened: for each axis, or for turns and shifts (station_errors.py)."""

    sensor: Sensor
    unknowns: Unknowns
    tiles: Tiles
    roots: Float[Array, "groups rows rows"]

    @property
    def rays(self) -> int:
        """How many seats there are for rays."""
        return self.tiles.chunks.pixel[0].size

    def recorded(self, x: Float[Array, "6 stations"]) -> Float[Array, "groups rows"]:
        """Whitened residuals of POS."""
        return jnp.einsum("aek,ak->ae", self.roots, x.reshape(self.roots.shape[::2]))


class Prepared(eqx.Module):
    """`Ready` with what leads back from chunks to rays and points, on the host."""

    ready: Ready
    start: State
    plan: Plan = eqx.field(static=True)
    block: Block

    def by_ray(self, of_chunks: Any) -> Float[Any, "rays ..."]:
        """From an array (chunks, units, rays, points, ...) to one row a ray."""
        return _gathered(self.plan.ray, of_chunks, len(self.block))

    def by_point(self, of_chunks: Any) -> Float[Any, "points ..."]:
        """From an array (chunks, tiles, points, ...) to one row a point; NaN for points that nobody sees."""
        return _gathered(self.plan.point, of_chunks, len(self.block.role))

    def point_m(self, state: State) -> Float[Any, "points 3"]:
        """The points of a state, world frame, metres; NaN for points that nobody sees."""
        math = arrays_of(state.points)
        return self.by_point(math.stack([math.asarray(c) for c in state.points], axis=-1))

    def weighted(self, weight: Float[Any, "rays 2"], state: State, used: np.ndarray | None = None) -> "Prepared":
        """The same with other weights (one over sigma) of the rays, 0 to leave out, starting from a state.

        Points that keep fewer rays than two, and are no control points, stay where they are and take no part. Control points are
        those of `block`, whatever they were when it was prepared.

        **Arguments:** `used`: rays that have a weight; told where weights are traced.
        """
        lone = self.lone(weight[:, 0] > 0 if used is None else used)
        math = arrays_of((weight, self.block, state))
        weight = math.where(lone[self.block.point][:, None], 0.0, weight)
        held = _components(math.where((self.plan.ray >= 0)[..., None], weight[self.plan.ray], 0.0), self.ready.tiles)
        known = self.block.role == "control"
        information = _information(self.plan, self.block.information(), lone)
        tiles, size = self.ready.tiles, self.ready.tiles.chunks.units.shape[0]
        control = _grown((known[self.plan.point] & (self.plan.point >= 0)), size)
        given = _grown(math.where(known[:, None], self.block.position_m, 0.0)[_whose(self.block, self.plan)], size)
        at = [math.where(control, given[..., i], math.asarray(c)) for i, c in enumerate(state.points)]
        place = tuple(on_device(c) for c in at)
        changed = (held, place, _components(information, tiles))
        tiles = eqx.tree_at(lambda t: (t.chunks.weight, t.chunks.place, t.chunks.prior), tiles, changed)
        return dataclasses.replace(self, ready=eqx.tree_at(lambda r: r.tiles, self.ready, tiles), start=state)

    def without(self, lone: Bool[np.ndarray, " points"], state: State) -> "Prepared":
        """The same where some points take no part."""
        used = ~lone[self.block.point]
        return self.weighted(arrays_of(self.block.sigma_px).where(used[:, None], 1 / self.block.sigma_px, 0.0), state, used)

    def lone(self, used: Bool[np.ndarray, " rays"]) -> Bool[np.ndarray, " points"]:
        """Points that fewer than two used rays see, and that are no control points."""
        count = np.bincount(self.block.point[used], minlength=len(self.block.role))
        return (count < 2) & (self.block.role != "control")


def _gathered(index: np.ndarray, of_chunks: Any, size: int) -> Any:
    """Rows by index from an array whose first axes are those of the index; NaN where there is none."""
    some = index >= 0
    if is_traced(of_chunks):
        place = np.full(size, -1)
        place[index[some]] = np.flatnonzero(some)
        rows = of_chunks[: len(index)].reshape(index.size, *of_chunks.shape[index.ndim :])[np.maximum(place, 0)]
        return jnp.where((place >= 0).reshape(-1, *(1,) * (rows.ndim - 1)), rows.astype(float), jnp.nan)
    array = np.asarray(of_chunks)[: len(index)]
    out = np.full((size, *array.shape[index.ndim :]), np.nan)
    out[index[some]] = array[some]
    return out


def prepare(
    sensor: Sensor,
    block: Block,
    unknowns: Knowledge,
    motions: StationErrors | None,
    start_m: Float[Any, "points 3"],
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
        sensor = make_room(sensor, *(Address(motions.link, (field,), (0, 0)) for field in ("turn_rad", "shift_m")))
        link = motions.stations(sensor)
        stations, segments = link.stations, link.segments
        _refuse_traced_nodes(motions.link, link)
        sigma, roots = motions.sigma, motions.roots(sensor)
        first, acting = _acting(link, block)
    laid = keep if keep is not None and keep.holds(first, acting) else plan(block.point, first, acting, segments)
    numbers = Unknowns(others, on_device(sigma), None if motions is None else motions.link)
    known, lonely = block.role == "control", seen_once(block)
    math = arrays_of((block, start_m))
    # They have no place; seats on the device hold numbers, and have no weight.
    start_m = math.where(lonely[:, None], start_m[block.point[~lonely[block.point]][0]], start_m)
    place = math.where(known[:, None], block.position_m, start_m)
    tiles = _tiles(block, laid, place, block.information())
    points = _components(start_m[_whose(block, laid)], tiles)
    ready = Ready(sensor, numbers, tiles, on_device(roots))
    state = State(_whitened_motions(sensor, numbers, stations), on_device(u), points)
    prepared = Prepared(ready, state, laid, block)
    return prepared.without(lonely, state) if lonely.any() else prepared


def _acting(link: AbstractStations, block: Block) -> tuple[Int[np.ndarray, " rays"], int]:
    """The first station that acts on each ray, and how many act.

    Where times are traced nobody knows which: then one window spans all stations.
    """
    if link.node_s is not None and is_traced(block.time_s):
        return np.zeros(len(block), dtype=int), link.stations
    with jax.ensure_compile_time_eval():
        pairs = link.acting(block.shots())
        return np.broadcast_to(np.asarray(pairs[0][0]), (len(block),)), len(pairs)


def _refuse_traced_nodes(name: str, link: AbstractStations) -> None:
    """**Raises:** `WhiskjaxError` where the nodes in time are traced, by which the plan of the block is made."""
    if any(is_traced(leaf) for leaf in jax.tree.leaves(getattr(link, "basis", None))):
        raise WhiskjaxError(
            f"adjust: the nodes of {name} are traced, but they say what is computed: make the sensor outside of jit and vmap, "
            "and put what varies into it"
        )


def _whitened_motions(sensor: Sensor, numbers: Unknowns, stations: int) -> Float[Array, "6 stations"]:
    """What the sensor already holds of the stations' motions."""
    if numbers.stations is None:
        return jnp.zeros((6, 0))
    turn, shift = (plain(np.zeros((stations, 3)) if part is None else part) for part in sensor[numbers.stations].motions)
    sigma = plain(numbers.sigma)[:, None]
    math = arrays_of((turn, shift, sigma))
    held = math.concatenate([turn.T, shift.T])
    return on_device(math.where(sigma > 0, held / math.where(sigma > 0, sigma, 1.0), 0.0))


def _tiles(block: Block, laid: Plan, place: Any, information: Any) -> Tiles:
    """Rays and points on the device; seats without a ray repeat one of the unit's rays with no weight."""
    some = np.maximum(laid.ray.max(axis=(2, 3)), 0)
    stand_in = np.where(laid.ray >= 0, laid.ray, some[:, :, None, None])
    weight = arrays_of(block.sigma_px).where((laid.ray >= 0)[..., None], 1 / block.sigma_px[stand_in], 0.0)
    who = _whose(block, laid)
    size = rounded(len(laid.units))

    def held(a: Any) -> Any:
        return on_device(_grown(a, size))

    def columns(a: Any) -> Any:
        return tuple(held(a[..., i]) for i in range(a.shape[-1]))

    chunks: Any = Chunk(
        block.shots(stand_in, held),
        columns(block.pixel_px[stand_in]),
        columns(weight),
        columns(place[who]),
        columns(_information(laid, information, np.zeros(len(information), dtype=bool))),
        *(held(np.asarray(a, dtype=np.int32)) for a in (laid.tile, laid.start, laid.pair, laid.units, laid.pairs)),
    )
    return Tiles(chunks, on_device(len(laid.units)), laid.width)


def _whose(block: Block, laid: Plan) -> np.ndarray:
    """The point of every place; where there is none, one that is seen, whose coordinates are numbers."""
    return np.where(laid.point >= 0, laid.point, block.point[0])


def _information(laid: Plan, information: Any, lone: np.ndarray) -> Any:
    """Upper triangles of the points of every tile; the identity where there is no point, or one that takes no part."""
    math = arrays_of(information)
    upper = math.stack([information[:, i, j] for i in range(3) for j in range(i, 3)], axis=-1)
    identity = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    takes_part = (laid.point >= 0) & ~lone[laid.point]
    return math.where(takes_part[..., None], upper[laid.point], identity)


def _grown(a: Any, size: int) -> Any:
    """Longer by copies of the last entry, which nobody reads."""
    math = arrays_of(a)
    return math.concatenate([a, math.repeat(a[-1:], size - len(a), axis=0)])


def _components(a: Any, like: Tiles) -> Any:
    """Components on the device, as long as the tiles' arrays."""
    size = like.chunks.units.shape[0]
    return tuple(on_device(_grown(a[..., i], size)) for i in range(a.shape[-1]))
