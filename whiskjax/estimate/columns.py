"""Residuals of a group and their derivatives by the unknowns that act on it, from one sweep through the chain."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.vectors import Vec2, Vec3, neg
from ..chain.joints import joint_derivatives
from ..chain.parameters import passages
from ..rules import once
from .problem import Group, Problem


class Swept(NamedTuple):
    """Whitened residuals (x, y) of a group, their derivatives `by` the unknowns of `order`, and points in the camera frame."""

    residual: Vec2
    by: tuple[Float[Array, "acting n"], Float[Array, "acting n"]]
    order: tuple[int, ...]
    inside: Vec3


def columns(problem: Problem, group: Group, u: Float[Array, " unknowns"]) -> Swept:
    """What one sweep finds of a group at whitened unknowns."""
    n, unknowns = group.point[0].shape, problem.unknowns
    w00, w10, w11 = group.weight

    def seen():
        sensor = problem.put(u)
        found = joint_derivatives(sensor, group.shot, group.point)
        met = passages(sensor, group.point, found, unknowns.links)
        met = {name: passage._replace(rows=_whitened_rows(group, passage.rows)) for name, passage in met.items()}
        residual = tuple(z - h for z, h in zip(group.pixel, found.pixel, strict=True))
        inside = found.points[sensor.names[-1]]
        told = group.whiten(*residual), met, inside
        return jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a, dtype=float), n), told)

    residual, met, inside = once(seen)
    if "camera" in met:
        met["camera"] = met["camera"]._replace(rows=((neg(w00), 0), (neg(w10), neg(w11))))
    parts = unknowns.columns(problem.put(u), group.shot, met)
    parts = [part._replace(x=_full(part.x, n), y=_full(part.y, n)) for part in parts]
    order = tuple(k for part in parts for k in part.which)
    acting = tuple(sorted(set(order)))
    if len(order) == len(acting):  # no unknown lives in two links: nothing to add up
        by = jnp.concatenate([part.x for part in parts]), jnp.concatenate([part.y for part in parts])
        return Swept(residual, by, order, inside)
    x = y = jnp.zeros((len(acting), *n))
    for part in parts:
        place = jnp.array([acting.index(k) for k in part.which])
        x, y = x.at[place].add(part.x), y.at[place].add(part.y)
    return Swept(residual, (x, y), acting, inside)


def _full(column: Array, n: tuple[int, ...]) -> Array:
    return jnp.broadcast_to(column, (column.shape[0], *n))


def _whitened_rows(group: Group, rows: Any) -> Any:
    """Minus the two rows of a derivative of the pixel, whitened: those of the residual; None, for the camera, stays None."""
    if rows is None:
        return None
    x, y = zip(*(group.whiten(neg(a), neg(b)) for a, b in zip(*rows, strict=True)), strict=True)
    return x, y
