"""Residuals of rays and covariance of points at the solution, streamed over the chunks as the normal equations are."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...algebra.vectors import vsub
from ...chain.imaging import into_camera
from ...rules import compiled, first_failure
from ...rules.rounds import rounds
from .normal import chunk_rows
from .prepare import Ready, State


class Seen(NamedTuple):
    """Residuals measured - projected of rays in pixels, and the codes of those that the sensor cannot have made."""

    residual_px: Float[Array, "chunks units rays points 2"]
    code: Int[Array, "chunks units rays points"]


def _evaluate(ready: Ready, state: State) -> Seen:
    """Every ray at a state: its point has to lie in front of the camera, and inside of what its distortion can undo."""
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)

    def of(inputs):
        chunk, at = inputs
        point = tuple(jnp.broadcast_to(c[chunk.tile][:, None, :], chunk.pixel[0].shape) for c in at)
        camera, q = sensor.camera_at(chunk.shot), into_camera(sensor, chunk.shot, point)
        code = jax.tree.leaves(first_failure(sensor.check(chunk.shot), camera.check_direction(q)))[0]
        x, y = vsub(chunk.pixel, camera.pixel(q))
        return x, y, code + jnp.zeros(x.shape, dtype=jnp.int32)

    x, y, code = jax.lax.map(of, (ready.tiles.chunks, state.points))
    return Seen(jnp.stack([x, y], -1), code)


def _covariances(
    ready: Ready, state: State, inverse: Float[Array, "m m"], reversible: bool = False
) -> Float[Array, "chunks tiles points 3 3"]:
    """Covariance of the points, m^2: V^-1 + V^-1 W^T S^-1 W V^-1 = L^-T (1 + Z S^-1 Z^T) L^-1.

    **Arguments:** `inverse`: of the reduced normal matrix S; `reversible`: whether reverse mode has to pass.
    """
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)
    stations, q = state.x.shape[1], state.u.shape[0]
    width = ready.tiles.width if stations else 0
    m = 6 * stations
    blocks = inverse[:m, :m].reshape(6, stations, 6, stations)
    border, corner = inverse[:m, m:].reshape(6, stations, q), inverse[m:, m:]
    zero = jnp.asarray(0, dtype=jnp.int32)

    def of(inputs):
        chunk, at = inputs
        rows = chunk_rows(sensor, ready.unknowns, chunk, at, width)
        rest = rows.point_rest[:q]
        points = rest.shape[-1]

        def folded(half, other):
            """(columns, 3, points) twice -> (3, 3, points), summed over the columns."""
            return jnp.einsum("cip,cjp->ijp", half.reshape(-1, 3, points), other.reshape(-1, 3, points))

        def product(a, b):
            """Z S^-1 Z^T of two units."""
            block = jax.lax.dynamic_slice(blocks, (zero, chunk.start[a], zero, chunk.start[b]), (6, width, 6, width))
            return folded(block.reshape(6 * width, -1).T @ rows.seen[a], rows.seen[b])

        def add_unit(u, inner):
            cross = jax.lax.dynamic_slice(border, (zero, chunk.start[u], zero), (6, width, q)).reshape(6 * width, q)
            mixed = folded(cross.T @ rows.seen[u], rest[:, :, chunk.tile[u]])
            return inner.at[:, :, chunk.tile[u]].add(product(u, u) + mixed + jnp.swapaxes(mixed, 0, 1))

        def add_pair(k, inner):
            a, b = chunk.pair[k, 0], chunk.pair[k, 1]
            mixed = product(a, b)
            return inner.at[:, :, chunk.tile[a]].add(mixed + jnp.swapaxes(mixed, 0, 1))

        inner = jnp.eye(3)[:, :, None, None] + jnp.einsum("qitp,qr,rjtp->ijtp", rest, corner, rest)
        if width:
            inner = rounds(chunk.units, len(rows.seen), add_unit, inner, reversible)
            inner = rounds(chunk.pairs, len(chunk.pair), add_pair, inner, reversible)
        k00, k10, k11, k20, k21, k22 = rows.factor
        none = jnp.zeros_like(k00)
        lower = jnp.stack([jnp.stack(row, -1) for row in ((k00, none, none), (k10, k11, none), (k20, k21, k22))], -2)
        return jnp.einsum("tpki,kltp,tplj->tpij", lower, inner, lower)

    return jax.lax.map(of, (ready.tiles.chunks, state.points))


evaluate = compiled(_evaluate, lambda ready, state: ready.rays)
covariances = compiled(_covariances, lambda ready, state, inverse, reversible=False: ready.rays)
