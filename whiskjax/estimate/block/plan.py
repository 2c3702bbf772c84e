"""Which points are adjusted together: tiles of points whose rays see the same few windows of stations.

All rays of a tile that see one window touch the same columns of the normal equations: they are a unit, and a unit is a matrix
product instead of thousands of small blocks. A tile has one unit or several (strips that cross, say). Host side (numpy): done
once for a block.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

_RAYS_AT_ONCE = 4096  # what the chain is evaluated for in one go: enough for vector loops, little enough for the cache
_TILE_POINTS = (16, 32, 48, 64, 128)
_MOST_SLACK = 8
_UNIT_COST = 3e5  # what a unit costs besides its products, in multiplications


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """Chunks of units; -1 where a seat is empty.

    - `ray`: (chunks, units, rays, points), index of each ray; `tile`: (chunks, units), which tile of the chunk a unit belongs to.
    - `point`: (chunks, tiles, points), index of each point; a chunk has as many tiles as units, at most.
    - `start`: (chunks, units), first station of each unit's window of `width` stations.
    - `pair`: (chunks, pairs, 2), units of one tile, each pair once; `units`, `pairs`: how many there are in each chunk.
    """

    ray: Int[np.ndarray, "chunks units rays points"]
    tile: Int[np.ndarray, "chunks units"]
    point: Int[np.ndarray, "chunks tiles points"]
    start: Int[np.ndarray, "chunks units"]
    pair: Int[np.ndarray, "chunks pairs 2"]
    units: Int[np.ndarray, " chunks"]
    pairs: Int[np.ndarray, " chunks"]
    width: int

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Plan) or self.width != other.width:
            return False
        return all(np.array_equal(getattr(self, f.name), getattr(other, f.name)) for f in dataclasses.fields(self))

    def __hash__(self) -> int:  # a plan is a static field: what is compiled for
        return hash((self.ray.tobytes(), self.start.tobytes(), self.width))

    def holds(self, first: Int[np.ndarray, " rays"], acting: int) -> bool:
        """Whether every ray's stations lie in the window of its unit."""
        local = first[self.ray] - self.start[:, :, None, None]
        return bool(((self.ray < 0) | ((local >= 0) & (local + acting <= self.width))).all())


class _Shape(NamedTuple):
    """Tiles of equal numbers of units: rays (tiles, units, points, rays) and window starts (tiles, units)."""

    ray: np.ndarray
    start: np.ndarray


def plan(point: Int[np.ndarray, " rays"], first: Int[np.ndarray, " rays"], acting: int, segments: Sequence[int]) -> Plan:
    """Units that hold every ray once.

    **Arguments:** `point`: which point each ray sees; `first`: the first station that acts on it; `acting`: how many act, from
    `first` on; `segments`: numbers of stations that follow each other (strips): a window is not meant to reach from one to the
    next.
    """
    stations, ends = sum(segments), np.cumsum(segments)
    # Segments are drawn apart, so that the last stations of one and the first of the next are no neighbours.
    apart = 4 * stations
    drawn = first + apart * np.searchsorted(ends, first, side="right")
    order = np.lexsort((drawn, point))
    extent, seats = _passes(point[order], drawn[order], acting)
    grouped = _units(point, drawn, order, extent, acting, seats)
    tried = []
    for width in _widths(extent, stations):
        slack = width - extent
        for size in _TILE_POINTS:
            shapes = [_tiles(ray, start, width, slack, size, stations, apart) for ray, start in grouped]
            tried.append((sum(_cost(shape, width) for shape in shapes), width, shapes))
    _, width, shapes = min(tried, key=lambda t: t[0])
    return _chunks(shapes, point, width)


def _widths(extent: int, stations: int) -> list[int]:
    """Widths that hold the extent, four to each doubling, so that similar blocks share compiled functions."""
    grid = [g << k for k in range(stations.bit_length()) for g in (4, 5, 6, 7)]
    enough = [width for width in (1, 2, 3, *grid) if extent <= width < stations] + [stations]
    return [width for width in enough if width <= max(enough[0], extent + _MOST_SLACK)]


def _passes(point: np.ndarray, first: np.ndarray, acting: int) -> tuple[int, int]:
    """How many neighbouring stations a point usually sees in one pass over it, and how many rays."""
    # A pass ends where the point's next ray begins more than twice the acting stations later.
    ends = (np.diff(point) != 0) | (np.diff(first) > 2 * acting + 2)
    starts = np.flatnonzero(np.concatenate([[True], ends]))
    extent = np.maximum.reduceat(first, starts) - first[starts] + acting
    rays = np.diff(np.append(starts, len(first)))
    return int(np.quantile(extent, 0.99, method="higher")), int(np.quantile(rays, 0.95, method="higher"))


def _units(
    point: np.ndarray, first: np.ndarray, order: np.ndarray, reach: int, acting: int, seats: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points of equal numbers of units: rays (points, units, rays), and where their windows start (points, units)."""
    p, f = point[order], first[order]
    begins = np.flatnonzero(np.concatenate([[True], np.diff(p) != 0]))
    count = np.diff(np.append(begins, len(p)))
    rank = np.arange(len(p)) - np.repeat(begins, count)
    unit, seat, start = np.zeros(len(p), dtype=int), np.zeros(len(p), dtype=int), f.copy()
    for r in range(1, int(count.max())):
        now = np.flatnonzero(rank == r)
        fits = (f[now] + acting - start[now - 1] <= reach) & (seat[now - 1] + 1 < seats)
        unit[now] = np.where(fits, unit[now - 1], unit[now - 1] + 1)
        seat[now] = np.where(fits, seat[now - 1] + 1, 0)
        start[now] = np.where(fits, start[now - 1], f[now])
    units = np.maximum.reduceat(unit, begins) + 1
    row = np.repeat(np.arange(len(begins)), count)
    found = []
    for n in np.unique(units).tolist():
        members = np.flatnonzero(units == n)
        place = np.full(len(begins), -1)
        place[members] = np.arange(len(members))
        mine = place[row] >= 0
        at = place[row[mine]], unit[mine]
        rays, starts = np.full((len(members), n, seats), -1), np.zeros((len(members), n), dtype=int)
        rays[(*at, seat[mine])] = order[mine]
        starts[at] = start[mine]
        found.append((rays, starts))
    return found


def _tiles(ray: np.ndarray, start: np.ndarray, width: int, slack: int, size: int, stations: int, apart: int) -> _Shape:
    """Points whose windows begin in the same cells of slack + 1 stations, cut into tiles."""
    cell = start // (slack + 1)
    order = np.lexsort((*start.T[::-1], *cell.T[::-1]))
    cell = cell[order]
    new = np.concatenate([[True], (np.diff(cell, axis=0) != 0).any(axis=1)])
    begins = np.flatnonzero(new)
    seat = np.arange(len(order)) - np.repeat(begins, np.diff(np.append(begins, len(order))))
    new |= seat % size == 0
    tile = np.cumsum(new) - 1
    place = np.arange(len(order)) - np.flatnonzero(new)[tile]
    tiled = np.full((int(tile[-1]) + 1, ray.shape[1], size, ray.shape[2]), -1)
    tiled[tile, :, place] = ray[order]
    begin = (slack + 1) * cell[new] - apart * (start[order][new] // apart)
    return _Shape(tiled, np.clip(begin, 0, max(stations - width, 0)))


def _cost(shape: _Shape, width: int) -> float:
    """Multiplications of all tiles, about."""
    tiles, units, points, rays = shape.ray.shape
    columns = (6 * width) ** 2
    return tiles * units * (_UNIT_COST + points * columns * (2 * rays + 3 * (units + 1) / 2))


def _chunks(shapes: Sequence[_Shape], point: np.ndarray, width: int) -> Plan:
    """Tiles packed into chunks of about equal numbers of rays."""
    points, seats = shapes[0].ray.shape[2:]
    most = max(shape.start.shape[1] for shape in shapes)
    total = sum(shape.start.size for shape in shapes)
    room = max(min(_RAYS_AT_ONCE // (points * seats), total), most)
    packed: list[list[tuple[_Shape, int]]] = [[]]
    used = 0
    for shape in shapes:
        for k in range(len(shape.start)):
            used += shape.start.shape[1]
            if used > room:
                packed.append([])
                used = shape.start.shape[1]
            packed[-1].append((shape, k))
    chunks = len(packed)
    ray = np.full((chunks, room, points, seats), -1)
    tile, start = np.full((chunks, room), room - 1), np.zeros((chunks, room), dtype=int)
    pairs: list[list[tuple[int, int]]] = [[] for _ in packed]
    units = np.zeros(chunks, dtype=int)
    who = np.full((chunks, room, points), -1)
    for c, members in enumerate(packed):
        for t, (shape, k) in enumerate(members):
            here = slice(units[c], units[c] + shape.start.shape[1])
            ray[c, here], start[c, here], tile[c, here] = shape.ray[k], shape.start[k], t
            seen = shape.ray[k].max(axis=(0, 2))
            who[c, t] = np.where(seen >= 0, point[seen], -1)
            numbers = range(here.start, here.stop)
            pairs[c] += [(a, b) for a in numbers for b in numbers if b < a]
            units[c] = here.stop
    longest = 2 ** math.ceil(math.log2(max(1, *map(len, pairs))))  # few sizes: how many there are is a number
    pair = np.zeros((chunks, longest, 2), dtype=int)
    for c, some in enumerate(pairs):
        if some:
            pair[c, : len(some)] = some
    return Plan(np.ascontiguousarray(ray.swapaxes(2, 3)), tile, who, start, pair, units, np.array(list(map(len, pairs))), width)
