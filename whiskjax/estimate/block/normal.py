"""Normal equations of a block, points eliminated tile by tile.

With D the derivatives of the pixels by stations and other unknowns, H those by the points, everything whitened, each point leaves
D^T D - Z^T Z and D^T r - Z^T z, where V = H^T H plus the point's prior = L L^T, Z = L^-1 H^T D and z = L^-1 H^T r (Schur 1917;
Brown 1958 for the block). A unit of a tile is one matrix product over its window of stations; chunks of units are streamed, so
that memory holds one chunk of derivatives at a time.

The points follow on the way: each pass linearises at the points that it is given, and moves them to their optimum for the
stations of the pass. A pass so needs no substitution back, and its reduced cost is that of the moved points, to first order.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...algebra.symmetric import inverse_lower
from ...algebra.vectors import Component, Vec3, total
from ...chain.sensor import Sensor
from ...chain.stations import AbstractStations
from ...rules import once
from ...rules.rounds import rounds
from .rays import Dependence, depend
from .tiles import Chunk, Tiles, Unknowns

Factor = tuple[Component, ...]  # L^-1 of a point's 3x3 system: k00, k10, k11, k20, k21, k22


class Normal(NamedTuple):
    """Half of the stations' normal matrix (its transpose is to be added), the border by unknowns and right side, the corner.

    The corner's last entry is the sum of squared whitened residuals with the points at their optimum.
    """

    half: Float[Array, "6 stations 6 stations"]
    border: Float[Array, "6 stations q+1"]
    corner: Float[Array, "q+1 q+1"]


class Rows(NamedTuple):
    """Whitened rows of a chunk; points run along the last axis, so that every loop is a vector loop.

    Of rays: `motion` (6, 2, units, rays, points), `rest` (q+1, 2, units, rays, points) with the residuals last, and `window`
    (width, units, rays, points), the weight of each station of the window. Of points, Z: `seen` (units, 6 width, 3 points) and
    `point_rest` (q+1, 3, tiles, points); their factor and L^-1 H^T r.
    """

    motion: Array
    rest: Array
    window: Array
    seen: Array
    point_rest: Array
    factor: Factor
    right: Vec3


def accumulate(sensor: Sensor, unknowns: Unknowns, tiles: Tiles, points: Vec3, reversible: bool = False) -> tuple[Normal, Vec3]:
    """The normal equations of all rays and control points.

    **Arguments:** `sensor`: with the current values put in; `points`: where the points are taken, (chunks, tiles, points) each;
    `reversible`: whether reverse mode has to pass.

    **Returns:** the normal equations, and the points moved to their optimum for this sensor.
    """
    stations, size = unknowns.stations_of(sensor), len(unknowns.others) + 1
    nothing = Normal(jnp.zeros((6, stations) * 2), jnp.zeros((6, stations, size)), jnp.zeros((size, size)))

    def add(k, carry):
        normal, all_moved = carry  # `points` is only read: read and written in one carry, XLA copies it for every chunk
        chunk, at = tiles.chunk(k), tuple(c[k] for c in points)
        rows = chunk_rows(sensor, unknowns, chunk, at, tiles.width)
        normal = _add_chunk(normal, chunk, at, rows, reversible)
        moved = tuple(a + s for a, s in zip(at, backward(rows.factor, rows.right), strict=True))
        return normal, tuple(jax.lax.dynamic_update_index_in_dim(c, m, k, 0) for c, m in zip(all_moved, moved, strict=True))

    return rounds(tiles.count, tiles.chunks.units.shape[0], add, (nothing, points), reversible)


def chunk_rows(sensor: Sensor, unknowns: Unknowns, chunk: Chunk, at: Vec3, width: int) -> Rows:
    """Everything about one chunk that its products are made of."""
    units, rays, points = shape = chunk.pixel[0].shape
    point = tuple(jnp.broadcast_to(c[chunk.tile][:, None, :], shape) for c in at)

    def whitened() -> Dependence:
        found = depend(sensor, chunk.shot, point, chunk.pixel, unknowns.stations, unknowns.others)
        return _whitened(found, unknowns, chunk)

    found = once(whitened)
    factor, right = _eliminate(found, chunk, at)
    of_units = tuple(c[chunk.tile][:, None, :] for c in factor)
    lower = [forward(of_units, row) for row in found.by_point]  # L^-1 H^T: of x and y, three each
    rest = jnp.stack([jnp.stack(pair) for pair in (*zip(*found.by_unknown, strict=True), found.residual)])
    terms = [[lower[a][i][None, :, r] * rest[:, a, :, r] for a in range(2) for r in range(rays)] for i in range(3)]
    point_rest = _of_tiles(jnp.stack([total(t) for t in terms], axis=1), chunk)
    point_rest = point_rest.at[-1].set(jnp.stack(right))
    if unknowns.stations is None:
        none = jnp.zeros((0, 2, *shape))
        return Rows(none, rest, none[:, 0], jnp.zeros((units, 0, 3 * points)), point_rest, factor, right)
    motion = jnp.stack([jnp.stack(pair) for pair in zip(*found.by_motion, strict=True)])
    window = _window(sensor[unknowns.stations], chunk, width)
    z = jnp.stack([jnp.stack([lower[0][i] * m[0] + lower[1][i] * m[1] for i in range(3)]) for m in motion])

    def spread(u):
        """(6, width, 3, points)."""
        return total(window[None, :, None, u, r] * z[:, None, :, u, r] for r in range(rays)).reshape(-1, 3 * points)

    return Rows(motion, rest, window, jax.lax.map(spread, jnp.arange(units)), point_rest, factor, right)


def _whitened(found: Dependence, unknowns: Unknowns, chunk: Chunk) -> Dependence:
    """Residuals and derivatives over their sigmas, by whitened unknowns; points stay in metres."""
    weight = chunk.weight

    def over(rows: Any, scale: Any) -> Any:
        return tuple(tuple(w * scale[i] * c for i, c in enumerate(row)) for w, row in zip(weight, rows, strict=True))

    return Dependence(
        tuple(w * r for w, r in zip(weight, found.residual, strict=True)),
        over(found.by_point, (1.0, 1.0, 1.0)),
        over(found.by_motion, unknowns.sigma),
        over(found.by_unknown, (1.0,) * len(unknowns.others)),
    )


def _window(link: AbstractStations, chunk: Chunk, width: int) -> Array:
    """The weight of each station of the unit's window."""
    seat = jnp.arange(width, dtype=jnp.int32)[:, None, None, None]
    weights = jnp.zeros((width, *chunk.pixel[0].shape))
    for station, weight in link.acting(chunk.shot):
        local = station - chunk.start[:, None, None]
        spread = jnp.broadcast_to(jnp.asarray(weight, dtype=float), local.shape)
        weights = weights + jnp.where(local[None] == seat, spread[None], 0.0)
    return weights


def _of_tiles(of_units: Array, chunk: Chunk) -> Array:
    """Sums over the units of each tile: (..., units, points) -> (..., tiles, points)."""
    tiles = jnp.arange(len(chunk.tile), dtype=chunk.tile.dtype)
    member = (tiles[:, None] == chunk.tile[None, :]).astype(of_units.dtype)
    return jnp.einsum("tu,...un->...tn", member, of_units)


def _eliminate(found: Dependence, chunk: Chunk, at: Vec3) -> tuple[Factor, Vec3]:
    """The points' own systems: L^-1, and L^-1 times their right sides, (tiles, points) each."""
    products = [total(row[i] * row[j] for row in found.by_point) for i in range(3) for j in range(i, 3)]
    slopes = [total(row[i] * r for row, r in zip(found.by_point, found.residual, strict=True)) for i in range(3)]
    *normal, sx, sy, sz = _of_tiles(jnp.stack([c.sum(axis=1) for c in (*products, *slopes)]), chunk)
    off = tuple(a - b for a, b in zip(chunk.place, at, strict=True))
    factor = inverse_lower(tuple(n + p for n, p in zip(normal, chunk.prior, strict=True)))
    return factor, forward(factor, tuple(s + p for s, p in zip((sx, sy, sz), pull(chunk.prior, off), strict=True)))


def pull(prior: tuple[Component, ...], off: Vec3) -> Vec3:
    """Information times an offset."""
    p00, p01, p02, p11, p12, p22 = prior
    rows = (p00, p01, p02), (p01, p11, p12), (p02, p12, p22)
    x, y, z = (total(p * o for p, o in zip(row, off, strict=True)) for row in rows)
    return x, y, z


def forward(factor: Factor, v: Any) -> Vec3:
    """L^-1 v."""
    k00, k10, k11, k20, k21, k22 = factor
    return k00 * v[0], k10 * v[0] + k11 * v[1], k20 * v[0] + k21 * v[1] + k22 * v[2]


def backward(factor: Factor, v: Any) -> Vec3:
    """L^-T v."""
    k00, k10, k11, k20, k21, k22 = factor
    return k00 * v[0] + k10 * v[1] + k20 * v[2], k11 * v[1] + k21 * v[2], k22 * v[2]


def _add_chunk(normal: Normal, chunk: Chunk, at: Vec3, rows: Rows, reversible: bool) -> Normal:
    size, width = len(rows.rest), len(rows.window)
    off = tuple(a - b for a, b in zip(chunk.place, at, strict=True))
    pulled = total((p * o).sum() for p, o in zip(pull(chunk.prior, off), off, strict=True))
    corner = normal.corner + _square(rows.rest.reshape(size, -1)) - _square(rows.point_rest.reshape(size, -1))
    corner = corner.at[-1, -1].add(pulled)
    if width == 0:
        return Normal(normal.half, normal.border, corner)

    def add_unit(u, carry):
        half, border = carry
        own = (rows.window[None, :, None, u] * rows.motion[:, None, :, u]).reshape(6 * width, -1)
        seen, start = rows.seen[u], chunk.start[u]
        block = 0.5 * (_square(own) - _square(seen))
        side = own @ rows.rest[:, :, u].reshape(size, -1).T - seen @ rows.point_rest[:, :, chunk.tile[u]].reshape(size, -1).T
        half = _add(half, block.reshape(6, width, 6, width), (0, start, 0, start))
        return half, _add(border, side.reshape(6, width, size), (0, start, 0))

    def add_pair(k, half):
        a, b = chunk.pair[k, 0], chunk.pair[k, 1]
        block = -(rows.seen[a] @ rows.seen[b].T)
        return _add(half, block.reshape(6, width, 6, width), (0, chunk.start[a], 0, chunk.start[b]))

    units, pairs = len(rows.seen), len(chunk.pair)
    half, border = rounds(chunk.units, units, add_unit, (normal.half, normal.border), reversible)
    return Normal(rounds(chunk.pairs, pairs, add_pair, half, reversible), border, corner)


def _square(rows: Array) -> Array:
    return rows @ rows.T


def _add(whole: Array, block: Array, at: tuple[Any, ...]) -> Array:
    at = tuple(jnp.asarray(i, dtype=jnp.int32) for i in at)
    return jax.lax.dynamic_update_slice(whole, jax.lax.dynamic_slice(whole, at, block.shape) + block, at)
