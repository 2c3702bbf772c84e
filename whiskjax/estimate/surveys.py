"""Points that several rays see: each was surveyed once, and what it is off it is off in all of them.

The measurements r of a point's rays have the covariance V = D + F S F^T: D of each ray alone, F the derivatives of the pixels
by the point, S the covariance of its coordinates. With v = D^-1/2 r, G = D^-1/2 F and H the sum of G^T G over the rays that take
part, no root of S is needed, so that a point may be exact in some direction or all:

    e = v - G S (M + M^1/2)^-1 t,   M = 1 + H S,   t = sum of G^T v

are independent of variance 1, |e|^2 = r^T V^-1 r; they are v times the symmetric root of the inverse of its covariance, of all
such roots the one that keeps each residual closest to what it was, in whatever order rays and axes come. What the rays that take
part say of a ray's survey error is S M^-1 t, of covariance S M^-1. Both are Woodbury's identity (1950).

A point that one ray sees needs none of this: its survey error is part of that ray's own covariance.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..algebra.vectors import Vec2
from ..rules import arrays_of, is_traced
from ..rules.sizes import rounded

# Of Denman and Beavers, scaled: enough for eigenvalues from 1 to 1e12; and from where on a step, which squares, leaves rounding.
_STEPS, _SAME = 12, 1e-9


class Surveys(eqx.Module):
    """The points that several rays see.

    - `of`: which of them each ray sees, (n,); of no meaning where `follows` is zero.
    - `follows`: the derivative of the pixel by the point, px per metre, zero where no other ray sees it, (n, 2, 3).
    - `covariance_m2`: of their coordinates, (points, 3, 3).
    - `alone_px2`: the covariance of each measurement but for its sigmas and for what it shares, (n, 2, 2).
    """

    of: Int[Any, " n"]
    follows: Float[Any, "n 2 3"]
    covariance_m2: Float[Any, "points 3 3"]
    alone_px2: Float[Any, "n 2 2"]

    def are_shared_by(self, used: Bool[Any, " n"]) -> bool:
        """Whether several of the used rays may see one point."""
        if arrays_of((self.of, self.follows, used)) is not np:
            return True
        seen = self.of[used & (self.follows != 0).any(axis=(1, 2))]
        return bool((np.bincount(seen, minlength=1) > 1).any())

    def joint(self, weight: Float[Any, "n 3"], share: Float[Any, " n"]) -> "Joint":
        """What rays of one point have in common, where each takes part by its `share`.

        **Arguments:** `weight`: lower triangles that whiten each ray by itself, without what it shares.
        """
        math = arrays_of((self, weight, share))
        by = triangles(weight) @ self.follows
        seen = math.einsum("n,nia,nib->nab", share, by, by)
        m = math.eye(3)[None] + _summed(seen, self.of, len(self.covariance_m2)) @ self.covariance_m2
        left = self.covariance_m2 @ math.linalg.inv(m)
        return Joint(weight, by, self.of, share, self.covariance_m2, left, self.covariance_m2 @ math.linalg.inv(m + _root(m)))

    def explained(
        self, inverse: Float[Array, "n 2 2"], rows: Float[Array, "n 2 k"]
    ) -> tuple[Float[Array, "points 3 3"], Float[Array, "k k"]]:
        """M of each point, and how much less R^T V^-1 R is than R^T D^-1 R.

        **Arguments:** `inverse`: D^-1, zero for rays that take no part; `rows`: R.
        """
        by = inverse @ self.follows
        seen = _summed(by.swapaxes(1, 2) @ rows, self.of, len(self.covariance_m2))
        m = jnp.eye(3)[None] + _summed(by.swapaxes(1, 2) @ self.follows, self.of, len(seen)) @ self.covariance_m2
        return m, jnp.einsum("pak,pab,pbl->kl", seen, self.covariance_m2 @ jnp.linalg.inv(m), seen)


class Joint(NamedTuple):
    """Rays of common points at given weights: `by` is G; S, S M^-1 and S (M + M^1/2)^-1 of each point, in m^2."""

    weight: Float[Any, "n 3"]
    by: Float[Any, "n 2 3"]
    of: Int[Any, " n"]
    share: Float[Any, " n"]
    before_m2: Float[Any, "points 3 3"]
    left_m2: Float[Any, "points 3 3"]
    taken_m2: Float[Any, "points 3 3"]

    def independent(self, v: Float[Any, "n 2 *m"]) -> Float[Any, "n 2 *m"]:
        """Of what was whitened ray by ray: numbers that no survey error correlates (of the rays that take part)."""
        return self._without(v, self.taken_m2)

    def given_others(self, v: Float[Any, "n 2 *m"]) -> Float[Any, "n 2 *m"]:
        """Less what the rays that take part say of the survey error: V^-1 r of those, the error of the prediction of others."""
        return self._without(v, self.left_m2)

    def part(self, covariance_m2: Float[Any, "points 3 3"]) -> Float[Any, "n 2 2"]:
        """What a covariance of the points adds to the covariance of each ray."""
        return self.by @ covariance_m2[self.of] @ self.by.swapaxes(1, 2)

    def _without(self, v: Any, covariance_m2: Any) -> Any:
        math, flat = arrays_of((v, self)), v.reshape(len(v), 2, -1)
        seen = self.share[:, None, None] * (self.by.swapaxes(1, 2) @ flat)
        found = covariance_m2 @ _summed(seen, self.of, len(covariance_m2))
        return (flat - math.matmul(self.by, found[self.of])).reshape(v.shape)


class Shared(eqx.Module):
    """The same for the groups of a problem, as components: G as rows x and y, (3, rays) each, of every group; and the points."""

    by: tuple[tuple[Float[Array, "3 rays"], Float[Array, "3 rays"]], ...]
    of: tuple[Int[Array, " rays"], ...]
    taken_m2: Float[Array, "points 3 3"]

    @classmethod
    def of_groups(cls, joint: Joint, indices: list[np.ndarray], sizes: list[int]) -> "Shared":
        """From all rays, of which each group has some, padded with rays that see nothing."""
        math, by, of = arrays_of(joint), [], []
        for index, size in zip(indices, sizes, strict=True):
            padded = math.pad(joint.by[index], ((0, size - len(index)), (0, 0), (0, 0)))
            by.append((jnp.asarray(padded[:, 0].T), jnp.asarray(padded[:, 1].T)))
            of.append(jnp.asarray(arrays_of(joint.of).pad(joint.of[index], (0, size - len(index)))))
        return cls(tuple(by), tuple(of), jnp.asarray(joint.taken_m2))

    def independent(self, parts: list[Vec2]) -> list[Vec2]:
        """As of `Joint`, of each group's x and y, (..., rays)."""
        total: Any = 0.0
        for (bx, by), of, (x, y) in zip(self.by, self.of, parts, strict=True):
            seen = jnp.einsum("an,...n->na...", bx, x) + jnp.einsum("an,...n->na...", by, y)
            total = total + _summed(seen, of, len(self.taken_m2))
        found, left = jnp.einsum("pab,pb...->pa...", self.taken_m2, total), []
        for (bx, by), of, (x, y) in zip(self.by, self.of, parts, strict=True):
            left.append(tuple(z - jnp.einsum("an,na...->...n", b, found[of]) for b, z in ((bx, x), (by, y))))
        return left


def common_surveys(
    point: Int[Any, " n"] | None, covariance_m2: Float[Any, "n 3 3"], follows: Float[Any, "n 2 3"], fixed_px2: Float[Any, "n 2 2"]
) -> Surveys | None:
    """The points that several rays see, or None where none is known to be.

    **Arguments:** `point`: equal for rays of one point, None where every ray sees its own; `fixed_px2`: the covariance that is no
    survey error.
    """
    n = len(follows)
    if point is None:
        return None
    if is_traced(point):
        count = jnp.zeros(n, dtype=int).at[point].add(1)
        one = jnp.zeros(n, dtype=int).at[point].max(jnp.arange(n))  # any of its rays: all say the same of the point
        is_common, of, whose = count[point] > 1, point, one
    else:
        is_common = np.bincount(point)[point] > 1
        if not is_traced(covariance_m2):
            is_common &= (covariance_m2 != 0).any(axis=(1, 2))  # an exact point has no error to share
        if not is_common.any():
            return None
        _, first, number = np.unique(point[is_common], return_index=True, return_inverse=True)
        of = np.zeros(n, dtype=np.int32)
        of[is_common] = number.ravel()
        whose = np.flatnonzero(is_common)[first]
        whose = np.append(whose, np.repeat(whose[:1], rounded(len(whose)) - len(whose)))  # more points, that nobody sees
    math = arrays_of((follows, is_common))
    shared = math.where(is_common[:, None, None], follows, 0.0)
    alone = arrays_of((fixed_px2, covariance_m2, is_common)).where(
        is_common[:, None, None], fixed_px2, fixed_px2 + point_part(follows, covariance_m2)
    )
    return Surveys(of, shared, covariance_m2[whose], alone)


def point_part(follows: Float[Any, "n 2 3"], covariance_m2: Float[Any, "n 3 3"]) -> Float[Any, "n 2 2"]:
    """Covariance in the image, in px^2, that comes from the points' coordinates."""
    return follows @ covariance_m2 @ follows.swapaxes(-1, -2)


def triangles(weight: Float[Any, "n 3"]) -> Float[Any, "n 2 2"]:
    """The lower triangles (w00, w10, w11) that whiten pairs of pixel coordinates, as matrices."""
    math, (w00, w10, w11) = arrays_of(weight), weight.T
    return math.stack([math.stack([w00, math.zeros_like(w00)], -1), math.stack([w10, w11], -1)], -2)


def _summed(of_rays: Any, of: Int[Any, " n"], points: int) -> Any:
    """Sums over the rays of each point; rays along the first axis."""
    if arrays_of((of_rays, of)) is np and not isinstance(of_rays, jax.Array):
        total = np.zeros((points, *of_rays.shape[1:]))
        np.add.at(total, of, of_rays)
        return total
    return jnp.zeros((points, *of_rays.shape[1:])).at[of].add(of_rays)


def _root(m: Float[Any, "points 3 3"]) -> Float[Any, "points 3 3"]:
    """The root of matrices with real eigenvalues, 1 or more (Denman and Beavers 1976, scaled by determinants: Higham 1997)."""
    math = arrays_of(m)

    def step(_: Any, xy: tuple[Any, Any]) -> tuple[Any, Any]:
        x, y = xy
        g = (math.linalg.det(x) * math.linalg.det(y))[:, None, None] ** (-1 / 6)
        return (g * x + math.linalg.inv(g * y)) / 2, (g * y + math.linalg.inv(g * x)) / 2

    xy = m, math.broadcast_to(math.eye(3), m.shape)
    if math is jnp:
        return jax.lax.fori_loop(0, _STEPS, step, xy)[0]
    for i in range(_STEPS):
        last, xy = xy, step(i, xy)
        if np.abs(xy[0] - last[0]).max() <= _SAME * np.abs(xy[0]).max():
            break
    return xy[0]
