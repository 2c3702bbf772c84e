"""The residuals of an adjusted block, and what its fit takes of a pattern of errors.

Of the normal matrix [S' W; W^T V] of motions and unknowns beside points, the block has the inverse of S = S' - W V^-1 W^T. With
P = J_p^T a and Q = J_s^T a the fit takes P^T V^-1 P + Z^T S^-1 Z of a pattern a, Z = Q - W V^-1 P: rows are sparse, and points
have blocks of three.
"""

from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import block_array, csr_array, diags_array, issparse

from ...chain.stations import AbstractStations
from ...rules import compiled
from ..fitted import AbstractFitted, Gram
from .block import Block
from .prepare import Prepared, Ready, State
from .rays import depend

_EXACT = 3e8  # products: below them the diagonal is reckoned entry by entry, above it is probed
_PROBES = 32


class BlockFitted(AbstractFitted):
    """**Arguments:** `used`: rays that took part; `inverse`: of the reduced normal matrix, motions first."""

    def __init__(self, prepared: Prepared, state: State, used: Bool[np.ndarray, " rays"], inverse: Float[np.ndarray, "m m"]):
        block = prepared.block
        self._weight = np.where(used[:, None], 1 / block.sigma_px, 0.0).ravel()
        found = _rows(prepared.ready, state)
        residual, by_point, by_rest = (prepared.by_ray(part) for part in found)
        by_motion, by_unknown = by_rest[..., :6], by_rest[..., 6:]
        self.residual = (self._weight * np.nan_to_num(residual).ravel()).reshape(-1, 2)
        self._inverse = inverse
        weight = self._weight[:, None]
        self._by_point = _by_point(block, weight * np.nan_to_num(by_point).reshape(-1, 3))
        rest = weight * np.nan_to_num(by_unknown).reshape(len(weight), -1)
        motion = weight * np.nan_to_num(by_motion).reshape(-1, 6)
        moving = _by_station(prepared, state, motion)
        self._by_rest = block_array([[moving, csr_array(rest)]], format="csr") if moving.shape[1] else csr_array(rest)
        self._blocks = _points_inverse(block, self._by_point)
        self._own = _on_the_diagonal(self._blocks)
        self._crossed = (self._by_rest.T @ self._by_point @ self._own).tocsr()  # W V^-1

    def whitened(self, pattern_px: Any) -> Any:
        """Errors of the pixels over the sigmas."""
        return (diags_array(self._weight) @ pattern_px).tocsc() if issparse(pattern_px) else self._weight[:, None] * pattern_px

    def gram(self, pattern: Any) -> Gram:
        """Of whitened patterns."""
        of_points, of_rest = self._by_point.T @ pattern, self._by_rest.T @ pattern
        left = _dense(of_rest - self._crossed @ of_points)
        taken = _dense(of_points.T @ (self._own @ of_points)) + left.T @ (self._inverse @ left)
        return Gram(_dense(pattern.T @ pattern), taken)

    def points(self, index: Int[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "m 3n"]]:
        """Of some points V^-1, what their own rays leave of them, and W V^-1, how they follow motions and unknowns."""
        columns = (3 * index[:, None] + np.arange(3)).ravel()
        return self._blocks[index], _dense(self._crossed[:, columns])

    @cached_property
    def taken(self) -> Float[np.ndarray, "n 2 2"]:
        """What the fit takes of each ray's own error; of a large block what motions and unknowns take of it, which is little, is
        told by probes (Hutchinson 1990)."""
        n = len(self.residual)
        own = self._by_point @ self._own
        blocks = np.empty((n, 2, 2))
        for a in range(2):
            for b in range(2):
                blocks[:, a, b] = own[a::2].multiply(self._by_point[b::2]).sum(axis=1)
        left = (self._by_rest - self._by_point @ self._crossed.T).tocsr()
        if left.shape[1] == 0:
            return blocks
        if left.shape[0] * left.shape[1] ** 2 < _EXACT:
            dense = left.toarray().reshape(n, 2, -1)
            return blocks + dense @ self._inverse @ dense.swapaxes(1, 2)
        probe = np.random.default_rng(0).choice([-1.0, 1.0], size=(n, 2, _PROBES))
        answer = (left @ (self._inverse @ (left.T @ probe.reshape(2 * n, -1)))).reshape(n, 2, -1)
        shared = np.einsum("nak,nbk->nab", probe, answer) / _PROBES
        shared = (shared + shared.swapaxes(1, 2)) / 2
        return blocks + shared


def _evaluated(ready: Ready, state: State) -> Any:
    """Residuals, derivatives by the point, and by motions (zero where there are none) and unknowns, chunk by chunk."""
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)

    def of(inputs: Any) -> Any:
        chunk, at = inputs
        point = tuple(jnp.broadcast_to(c[chunk.tile][:, None, :], chunk.pixel[0].shape) for c in at)
        found = depend(sensor, chunk.shot, point, chunk.pixel, ready.unknowns.stations, ready.unknowns.others)
        none = (jnp.zeros_like(found.residual[0]),) * 6
        rest = [
            (*(ready.unknowns.sigma[i] * c for i, c in enumerate(by or none)), *others)
            for by, others in zip(found.by_motion or (none, none), found.by_unknown, strict=True)
        ]
        rows = lambda pair: jnp.stack([jnp.stack(row, -1) for row in pair], -2)
        return jnp.stack(found.residual, -1), rows(found.by_point), rows(rest)

    return jax.lax.map(of, (ready.tiles.chunks, state.points))


_rows = compiled(_evaluated, lambda ready, state: ready.rays)


def _by_point(block: Block, rows: Float[np.ndarray, "coordinates 3"]) -> Any:
    columns = np.repeat(3 * block.point, 2)[:, None] + np.arange(3)
    return _sparse(rows, columns, 3 * len(block.role))


def _by_station(prepared: Prepared, state: State, rows: Float[np.ndarray, "coordinates 6"]) -> Any:
    stations = state.x.shape[1]
    if not stations:
        return csr_array((len(rows), 0))
    name = prepared.ready.unknowns.stations
    assert name is not None
    link: AbstractStations = prepared.ready.sensor[name]
    rays, found = len(prepared.block), csr_array((len(rows), 6 * stations))
    for station, weight in link.acting(prepared.block.shots()):
        at, share = (np.repeat(np.broadcast_to(np.asarray(of), (rays,)), 2) for of in (station, weight))
        found = found + _sparse(rows * share[:, None], at[:, None] + stations * np.arange(6), 6 * stations)
    return found


def _sparse(values: Float[np.ndarray, "rows some"], columns: Any, size: int) -> Any:
    rows = np.broadcast_to(np.arange(len(values))[:, None], values.shape)
    return csr_array((values.ravel(), (rows.ravel(), np.broadcast_to(columns, values.shape).ravel())), (len(values), size))


def _points_inverse(block: Block, by_point: Any) -> Float[np.ndarray, "points 3 3"]:
    """V^-1, blocks of three; zero where nothing says where a point is."""
    normal = np.array(block.information(), dtype=float)
    product = (by_point.T @ by_point).tocoo()
    same = product.coords[0] // 3 == product.coords[1] // 3
    rows, columns = product.coords[0][same], product.coords[1][same]
    np.add.at(normal, (rows // 3, rows % 3, columns % 3), product.data[same])
    inverse = np.zeros_like(normal)
    known = np.abs(np.linalg.det(normal)) > 0
    known &= block.seen
    inverse[known] = np.linalg.inv(normal[known])
    return inverse


def _on_the_diagonal(blocks: Float[np.ndarray, "points 3 3"]) -> Any:
    at = 3 * np.arange(len(blocks))[:, None, None]
    rows, columns = np.broadcast_arrays(at + np.arange(3)[:, None], at + np.arange(3)[None, :])
    return csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), (3 * len(blocks),) * 2)


def _dense(matrix: Any) -> np.ndarray:
    return matrix.toarray() if issparse(matrix) else np.asarray(matrix)
