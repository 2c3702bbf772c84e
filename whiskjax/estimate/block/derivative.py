"""How the solution of a block follows all that went into it: the implicit derivative, to every order.

The cost is half the sum of whitened squares of rays, control points, POS and priors. At the solution its slope by the stations'
motions, the unknowns and the points is zero, and stays so: dz = -H^-1 (dg/da) da, with the whole Hessian H, whatever the
iteration did. A ray sees one point, so the points' part of H is 3x3 blocks, and they are eliminated (Schur 1917): for m motions
and unknowns the Hessian takes m + 3 directions, however many points there are. It is dense in m: for blocks of thousands of
stations the memory is that of m x 3 points numbers.

Of line cameras whose rays are timed anew, the equation is that of the block with the times held at the first solution: a pixel
that moves across the line moves the offset, not the moment (crossing.py).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...algebra.implicit import stationary
from ...algebra.vectors import total
from ...chain.imaging import image
from .normal import pull
from .prepare import Ready, State
from .tiles import Chunk

_IDENTITY = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)


class _Place(NamedTuple):
    """Motions and unknowns in one vector, and the points, (3, chunks, tiles, points)."""

    y: Float[Array, " m"]
    point: Float[Array, "3 ..."]


def held(ready: Any) -> Any:
    """The same numbers, that nothing follows."""
    arrays, rest = eqx.partition(ready, eqx.is_array)
    return eqx.combine(jax.lax.stop_gradient(arrays), rest)


def followed(ready: Ready, state: State) -> State:
    """The state at which the cost is least, with its derivatives by every array of the block.

    **Arguments:** `state`: as the iteration found it.
    """
    size = state.x.size

    def slope(z: _Place, ready: Ready) -> _Place:
        at = lambda z: half_cost(ready, State(z.y[:size].reshape(state.x.shape), z.y[size:], tuple(z.point)))
        return jax.grad(at)(z)

    z = _Place(jnp.concatenate([state.x.ravel(), state.u]), jnp.stack(state.points))
    z = stationary(slope, z, ready, solve=_by_schur)
    return State(z.y[:size].reshape(state.x.shape), z.y[size:], tuple(z.point))


def half_cost(ready: Ready, state: State) -> Float[Array, ""]:
    """Half the sum of squared whitened residuals of rays, control points, POS and priors."""
    sensor = ready.unknowns.put(ready.sensor, state.x, state.u)

    def of(chunk: Chunk, at: Any, holds: Array) -> Array:
        point = tuple(jnp.broadcast_to(c[chunk.tile][:, None, :], chunk.pixel[0].shape) for c in at)
        found = image(sensor, chunk.shot, point)
        rays = total((w * (m - p)) ** 2 for w, m, p in zip(chunk.weight, chunk.pixel, found, strict=True))
        # A chunk that only fills up an array holds each of its points where it is.
        place = tuple(jnp.where(holds, p, jax.lax.stop_gradient(a)) for p, a in zip(chunk.place, at, strict=True))
        off = tuple(a - b for a, b in zip(place, at, strict=True))
        prior = tuple(jnp.where(holds, p, one) for p, one in zip(chunk.prior, _IDENTITY, strict=True))
        pulled = total(p * o for p, o in zip(pull(prior, off), off, strict=True))
        return jnp.where(holds, rays, 0.0).sum() + pulled.sum()

    chunks = ready.tiles.chunks
    holds = jnp.arange(chunks.units.shape[0]) < ready.tiles.count
    seen = jax.vmap(of)(chunks, state.points, holds).sum()
    recorded = ready.recorded(state.x)
    prior = ready.unknowns.others.root @ state.u
    return 0.5 * (seen + (recorded**2).sum() + prior @ prior)


def _by_schur(slope: Callable[[_Place], _Place], z: _Place, change: _Place) -> _Place:
    """-H^-1 change, the points eliminated."""
    m, shape = z.y.shape[0], z.point.shape
    _, along = jax.linearize(slope, z)
    directions = _Place(
        jnp.concatenate([jnp.eye(m), jnp.zeros((3, m))]),
        jnp.concatenate(
            [jnp.zeros((m, *shape)), jnp.broadcast_to(jnp.eye(3).reshape(3, 3, *(1,) * len(shape[1:])), (3, *shape))]
        ),
    )
    columns = jax.vmap(along)(directions)
    own = jnp.moveaxis(columns.point[m:].reshape(3, 3, -1), 2, 0)  # (points, direction, axis), symmetric
    mixed = jnp.moveaxis(columns.point[:m].reshape(m, 3, -1), 2, 0)  # (points, m, axis)
    right = change.point.reshape(3, -1).T
    inverse = jnp.linalg.inv(own)
    reach = mixed @ inverse
    reduced = columns.y[:m] - jnp.einsum("pmi,pni->mn", reach, mixed)
    y = jnp.linalg.solve(reduced, change.y - jnp.einsum("pmi,pi->m", reach, right))
    point = jnp.einsum("pij,pj->pi", inverse, right - jnp.einsum("pmi,m->pi", mixed, y))
    return _Place(-y, -point.T.reshape(shape))
