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
import numpy as np
from jaxtyping import Array, Float

from ...algebra.symmetric import inverse_lower
from ...algebra.vectors import Component, Vec3, total
from ...chain.sensor import Sensor
from ...chain.stations import AbstractStations
from ..losses import AbstractLoss
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
    """Whitened rows of a chunk. Of rays: `motion` (units, points, rays, 2, 6), `rest` (units, points, rays, 2, q+1) with the
    residuals last, `window` (units, points, rays, width), the weight of each station of the window.

    Of points, Z: `seen` (units, 3 points, 6 width), and `point_rest` (tiles, points, 3, q+1); their factor and L^-1 H^T r.
    """

    motion: Array
    rest: Array
    window: Array
    seen: Array
    point_rest: Array
    factor: Factor
    right: Vec3


def accumulate(sensor: Sensor, unknowns: Unknowns, tiles: Tiles, points: Vec3, loss: AbstractLoss | None) -> tuple[Normal, Vec3]:
    """The normal equations of all rays and control points.

    **Arguments:** `sensor`: with the current values put in; `points`: where the points are taken, (chunks, tiles, points) each.

    **Returns:** the normal equations, and the points moved to their optimum for this sensor.
    """
    stations, size = unknowns.stations_of(sensor), len(unknowns.places) + 1
    nothing = Normal(jnp.zeros((6, stations) * 2), jnp.zeros((6, stations, size)), jnp.zeros((size, size)))

    def add(k, carry):
        normal, points = carry
        chunk, at = tiles.chunk(k), tuple(c[k] for c in points)
        rows = chunk_rows(sensor, unknowns, chunk, at, tiles.width, loss)
        normal = _add_chunk(normal, chunk, at, rows)
        moved = tuple(a + s for a, s in zip(at, backward(rows.factor, rows.right), strict=True))
        return normal, tuple(jax.lax.dynamic_update_index_in_dim(c, m, k, 0) for c, m in zip(points, moved, strict=True))

    return jax.lax.fori_loop(0, tiles.count, add, (nothing, points))


def chunk_rows(sensor: Sensor, unknowns: Unknowns, chunk: Chunk, at: Vec3, width: int, loss: AbstractLoss | None) -> Rows:
    """Everything about one chunk that its products are made of."""
    shape = chunk.pixel[0].shape
    point = tuple(jnp.broadcast_to(c[chunk.tile][:, :, None], shape) for c in at)
    certain = chunk.units >= 0
    found = depend(sensor, chunk.shot, point, chunk.pixel, unknowns.stations, unknowns.places, certain)
    found = _whitened(found, unknowns, chunk, loss)
    factor, right = _eliminate(found, chunk, at)
    lower = jnp.stack([jnp.stack(forward(_of_units(factor, chunk), row), -1) for row in found.by_point], -2)
    pairs = zip(found.by_unknown, found.residual, strict=True)
    rest = jnp.stack([jnp.stack([*row, r], -1) for row, r in pairs], -2)
    point_rest = jax.ops.segment_sum(jnp.einsum("uprai,upraq->upiq", lower, rest), chunk.tile, shape[0])
    point_rest = point_rest.at[..., -1].set(jnp.stack(right, -1))
    if unknowns.stations is None:
        none = jnp.zeros((*shape, 2, 0))
        return Rows(none, rest, none[..., 0, :], jnp.zeros((shape[0], 3 * shape[1], 0)), point_rest, factor, right)
    motion = jnp.stack([jnp.stack(row, -1) for row in found.by_motion], -2)
    window = _window(sensor[unknowns.stations], chunk, width)

    def spread(_, unit):
        lower, motion, window = unit
        z = lower[..., 0, :, None] * motion[..., 0, None, :] + lower[..., 1, :, None] * motion[..., 1, None, :]
        seen = total(window[:, r, None, None, :] * z[:, r, :, :, None] for r in range(shape[2]))
        return None, seen.reshape(3 * shape[1], -1)

    _, seen = jax.lax.scan(spread, None, (lower, motion, window))
    return Rows(motion, rest, window, seen, point_rest, factor, right)


def _whitened(found: Dependence, unknowns: Unknowns, chunk: Chunk, loss: AbstractLoss | None) -> Dependence:
    """Residuals and derivatives over their sigmas, by whitened unknowns; points stay in metres."""
    weight = chunk.weight
    if loss is not None:
        x, y = (w * r for w, r in zip(weight, found.residual, strict=True))
        root = jnp.sqrt(loss.weight(x * x + y * y))
        weight = tuple(w * root for w in weight)

    def over(rows: Any, scale: Any) -> Any:
        return tuple(tuple(w * scale[i] * c for i, c in enumerate(row)) for w, row in zip(weight, rows, strict=True))

    return Dependence(
        tuple(w * r for w, r in zip(weight, found.residual, strict=True)),
        over(found.by_point, (1.0, 1.0, 1.0)),
        over(found.by_motion, unknowns.sigma),
        over(found.by_unknown, unknowns.scale),
    )


def _window(link: AbstractStations, chunk: Chunk, width: int) -> Array:
    """The weight of each station of the unit's window."""
    seat = jnp.arange(width)
    weights = jnp.zeros((*chunk.pixel[0].shape, width))
    for station, weight in link.acting(chunk.shot):
        local = (station - chunk.start[:, None, None])[..., None]
        spread = jnp.broadcast_to(jnp.asarray(weight, dtype=float), chunk.pixel[0].shape)[..., None]
        weights = weights + jnp.where(local == seat, spread, 0.0)
    return weights


def _eliminate(found: Dependence, chunk: Chunk, at: Vec3) -> tuple[Factor, Vec3]:
    """The points' own systems: L^-1, and L^-1 times their right sides, (tiles, points) each."""
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]

    def of_points(c: Component) -> Component:
        return jax.ops.segment_sum(c.sum(axis=2), chunk.tile, c.shape[0])

    normal = [of_points(total(row[i] * row[j] for row in found.by_point)) for i, j in pairs]
    slope = [of_points(total(row[i] * r for row, r in zip(found.by_point, found.residual, strict=True))) for i in range(3)]
    off = tuple(a - b for a, b in zip(chunk.place, at, strict=True))
    factor = inverse_lower(tuple(n + p for n, p in zip(normal, chunk.prior, strict=True)))
    return factor, forward(factor, tuple(s + p for s, p in zip(slope, _pull(chunk.prior, off), strict=True)))


def _pull(prior: tuple[Component, ...], off: Vec3) -> Vec3:
    """Information times an offset."""
    p00, p01, p02, p11, p12, p22 = prior
    rows = (p00, p01, p02), (p01, p11, p12), (p02, p12, p22)
    x, y, z = (total(p * o for p, o in zip(row, off, strict=True)) for row in rows)
    return x, y, z


def _of_units(of_tiles: tuple[Component, ...], chunk: Chunk) -> tuple[Component, ...]:
    """Numbers of points, for the rays of every unit."""
    return tuple(c[chunk.tile][:, :, None] for c in of_tiles)


def forward(factor: Factor, v: Any) -> Vec3:
    """L^-1 v."""
    k00, k10, k11, k20, k21, k22 = factor
    return k00 * v[0], k10 * v[0] + k11 * v[1], k20 * v[0] + k21 * v[1] + k22 * v[2]


def backward(factor: Factor, v: Any) -> Vec3:
    """L^-T v."""
    k00, k10, k11, k20, k21, k22 = factor
    return k00 * v[0] + k10 * v[1] + k20 * v[2], k11 * v[1] + k21 * v[2], k22 * v[2]


def _add_chunk(normal: Normal, chunk: Chunk, at: Vec3, rows: Rows) -> Normal:
    size = rows.rest.shape[-1]
    own, points = rows.rest.reshape(-1, size), rows.point_rest.reshape(-1, size)
    off = tuple(a - b for a, b in zip(chunk.place, at, strict=True))
    pulled = total((p * o).sum() for p, o in zip(_pull(chunk.prior, off), off, strict=True))
    corner = (normal.corner + own.T @ own - points.T @ points).at[-1, -1].add(pulled)
    width = rows.window.shape[-1]

    def add_unit(u, carry):
        half, border = carry
        motion, window, seen, rest = (a[u] for a in (rows.motion, rows.window, rows.seen, rows.rest))
        own = (window[:, :, None, None, :] * motion[..., None]).reshape(-1, 6 * width)
        point_rest = rows.point_rest[chunk.tile[u]].reshape(-1, size)
        block = 0.5 * (own.T @ own - seen.T @ seen)
        side = own.T @ rest.reshape(-1, size) - seen.T @ point_rest
        start = chunk.start[u]
        half = _add(half, block.reshape(6, width, 6, width), (0, start, 0, start))
        return half, _add(border, side.reshape(6, width, size), (0, start, 0))

    def add_pair(k, half):
        a, b = chunk.pair[k, 0], chunk.pair[k, 1]
        block = -(rows.seen[a].T @ rows.seen[b])
        return _add(half, block.reshape(6, width, 6, width), (0, chunk.start[a], 0, chunk.start[b]))

    if width == 0:
        return Normal(normal.half, normal.border, corner)
    half, border = jax.lax.fori_loop(0, chunk.units, add_unit, (normal.half, normal.border))
    return Normal(jax.lax.fori_loop(0, chunk.pairs, add_pair, half), border, corner)


def _add(whole: Array, block: Array, at: tuple[Any, ...]) -> Array:
    at = tuple(jnp.asarray(i, dtype=jnp.int32) for i in at)
    return jax.lax.dynamic_update_slice(whole, jax.lax.dynamic_slice(whole, at, block.shape) + block, at)


def information_of(covariance_m2: Float[np.ndarray, "points 3 3"], known: np.ndarray) -> Float[np.ndarray, "points 6"]:
    """Upper triangles of the inverse covariances, zero where nothing is known; a sigma below a micrometre counts as one."""
    inverse = np.zeros((len(known), 3, 3))
    inverse[known] = np.linalg.inv(covariance_m2[known] + 1e-12 * np.eye(3))
    return np.stack([inverse[:, i, j] for i in range(3) for j in range(i, 3)], axis=-1)
