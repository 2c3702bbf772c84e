"""Residuals of a group and their derivatives by the unknowns that act on it, from one sweep through the chain.

An unknown of a link moves a point as it passes that link, and the sweep knows what every such move does to the pixel: only the
one link is differentiated, not the chain behind it.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Vec2, neg
from ..chain.address import put
from ..chain.imaging import apparent
from ..chain.joints import joint_derivatives
from ..chain.sensor import Sensor
from .problem import Group, Problem


def columns(
    problem: Problem, group: Group, u: Float[Array, " unknowns"]
) -> tuple[Vec2, tuple[Float[Array, "acting n"], Float[Array, "acting n"]], tuple[int, ...]]:
    """**Returns:** whitened residuals (x, y) of a group, their derivatives, and by which unknowns, in the order of columns."""
    n = group.point[0].shape
    acting = problem.acting(group)
    links = tuple(dict.fromkeys(p.link for k in acting for p in problem.places[k]))

    def seen(u: Array):
        found = joint_derivatives(problem.put(u), group.shot, group.point)
        outer = dict(zip((*problem.sensor.names, "camera"), found.points.values(), strict=True)) | {"refraction": group.point}
        residual = tuple(z - h for z, h in zip(group.pixel, found.pixel, strict=True))
        passing = [(outer[name], _whitened_rows(group, found.derivatives.get(name))) for name in links]
        return jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a, dtype=float), n), (group.whiten(*residual), passing))

    residual, passing = _once(seen, problem, u)
    of_link = [_columns_of_link(problem, group, u, name, *parts) for name, parts in zip(links, passing, strict=True)]
    order = [k for _, ks in of_link for k in ks]
    if sorted(order) == sorted(acting):  # no unknown lives in two links: nothing to add up
        x, y = (jnp.concatenate([pair[axis] for pair, _ in of_link]) for axis in (0, 1))
        return residual, (x, y), tuple(order)
    x = y = jnp.zeros((len(acting), *n))
    for (by_x, by_y), ks in of_link:
        place = np.array([acting.index(k) for k in ks])
        x, y = x.at[place].add(by_x), y.at[place].add(by_y)
    return residual, (x, y), acting


def _once(of: Callable[[Array], Any], problem: Problem, u: Array) -> Any:
    """of(u), evaluated once: XLA on the CPU evaluates a chain again in each loop that uses it, but not across a conditional.

    The condition is one that the compiler cannot know to hold: no weight of a prior is negative.
    """
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(of, u))
    return jax.lax.cond(problem.prior[0] >= 0, of, lambda u: nothing, u)


def _columns_of_link(problem: Problem, group: Group, u: Array, name: str, point: Any, rows: Any) -> tuple[Any, tuple[int, ...]]:
    """Columns by the unknowns of one link, or of the camera: what it does to the passing point, through the rows behind it."""
    ks = tuple(k for k in problem.acting(group) if any(p.link == name for p in problem.places[k]))
    places = [(k, p) for k in ks for p in problem.places[k] if p.link == name]

    def passed(v: Array) -> Any:
        value = problem.mean + problem.scale * v
        sensor: Sensor = put(problem.sensor, [p for _, p in places], [value[k] for k, _ in places])
        if name == "camera":
            return group.whiten(*(neg(h) for h in sensor.camera_at(group.shot).pixel(point)))
        if name == "refraction":
            return apparent(sensor, group.shot, point)
        return sensor[name].pose(group.shot).into(point)

    def column(direction: Array) -> Vec2:
        move = jax.jvp(passed, (u,), (direction,))[1]
        if name == "camera":
            return move
        x, y = (sum(h * d for h, d in zip(row, move, strict=True)) for row in rows)
        return -x, -y

    return jax.vmap(column)(jnp.eye(u.shape[0])[np.array(ks)]), ks


def _whitened_rows(group: Group, derivative: Any) -> Any:
    """The two rows of a derivative of the pixel, whitened; None, for the camera, stays None."""
    return (
        None if derivative is None else tuple(zip(*(group.whiten(*pair) for pair in zip(*derivative, strict=True)), strict=True))
    )
