"""Rays of a block and everything that they depend on, from one sweep through the chain.

An unknown of a link moves a point as it passes that link, and the sweep knows what every such move does to the pixel: only the
one link is differentiated, not the chain behind it.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...algebra.vectors import Component, Vec2, Vec3, apply, vsub
from ...chain.address import Address, put, read
from ...chain.by import By
from ...chain.imaging import apparent
from ...chain.joints import joint_derivatives
from ...chain.link import Given
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...chain.stations import AbstractStations, motion

Places = tuple[tuple[Address, ...], ...]


class Dependence(NamedTuple):
    """Residuals of rays in pixels, and derivatives of the *pixel*, for x and y each.

    `by_motion`: by the six numbers (turn, shift) of the stations' link; `by_unknown`: by each other unknown.
    """

    residual: Vec2
    by_point: tuple[Vec3, ...]
    by_motion: tuple[tuple[Component, ...], ...]
    by_unknown: tuple[tuple[Component, ...], ...]


class _Passage(NamedTuple):
    """A link as the sweep met it: the point outside of it, and the derivative of the pixel behind it."""

    outer: Vec3
    rows: tuple[Vec3, ...]


def depend(
    sensor: Sensor, shot: Shot, point: Vec3, pixel: Vec2, stations: str | None, places: Places, certain: Array
) -> Dependence:
    """Residual = measured - projected of rays, with all derivatives; every component has the shape of the rays.

    **Arguments:** `stations`: the link whose stations are unknown, or None; `places`: where each of the other unknowns lives;
    `certain`: True, which the compiler does not know.
    """
    shape = pixel[0].shape

    def full(value: Any) -> Any:
        return jax.tree.map(lambda c: jnp.broadcast_to(jnp.asarray(c, dtype=float), shape), value)

    through, moved = sensor, None
    if stations is not None:
        link: AbstractStations = sensor[stations]
        moved = once(lambda: full(motion(link, shot)), certain)
        pose = once(lambda: full(link.moved(shot, *moved)), certain)
        through, shot = _given(sensor, shot, stations, pose)
    links = {place.link for of in places for place in of} | ({stations} if stations is not None else set())

    def seen():
        found = joint_derivatives(through, shot, point)
        outer = dict(zip((*sensor.names, "camera"), found.points.values(), strict=True)) | {"refraction": point}
        met = {name: _Passage(outer[name], found.derivatives.get(name, ())) for name in sorted(links)}
        return full((vsub(pixel, found.pixel), found.derivatives["earth"], met))

    residual, by_point, met = once(seen, certain)
    by_motion: Any = ((), ())
    if stations is not None and moved is not None:
        by_motion = tuple(zip(*_by_motion(sensor[stations], shot, moved, met[stations]), strict=True))
    columns = _by_unknowns(sensor, shot, met, places)
    return Dependence(residual, by_point, by_motion, tuple(zip(*columns, strict=True)) if columns else ((), ()))


def once(of: Callable[[], Any], certain: Array) -> Any:
    """of(), evaluated once: XLA on the CPU evaluates a chain again in each loop that uses it, but not across a conditional."""
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(of))
    return jax.lax.cond(certain, of, lambda: nothing)


def _given(sensor: Sensor, shot: Shot, name: str, pose: Any) -> tuple[Sensor, Shot]:
    """The same with one link's pose carried by the shot."""
    links = {n: Given(len(shot.poses)) if n == name else link for n, link in zip(sensor.names, sensor.links, strict=True)}
    return Sensor(links, sensor.camera, sensor.refraction), dataclasses.replace(shot, poses=(*shot.poses, pose))


def _by_motion(link: AbstractStations, shot: Shot, moved: tuple[Vec3, Vec3], met: _Passage) -> list[Vec2]:
    """The pixel by turn x, y, z and shift x, y, z."""
    six = (*moved[0], *moved[1])

    def passed(*values):
        return link.moved(shot, values[:3], values[3:]).into(met.outer)

    def column(k: int) -> Vec2:
        direction = [jnp.ones_like(c) if i == k else jnp.zeros_like(c) for i, c in enumerate(six)]
        return apply(met.rows, jax.jvp(passed, six, tuple(direction))[1])

    return [column(k) for k in range(6)]


def _by_unknowns(sensor: Sensor, shot: Shot, met: dict[str, _Passage], places: Places) -> list[Vec2]:
    """The pixel by each unknown; contributions of its places add up."""
    found: dict[Address, Vec2] = {}
    groups: dict[tuple[str, str], list[Address]] = {}
    for place in (place for of in places for place in of):
        option = place.path[0] if isinstance(sensor[place.link], By) else ""
        groups.setdefault((place.link, option), []).append(place)
    for (name, option), members in groups.items():
        node = sensor[name]
        if name not in ("camera", "refraction") and isinstance(node, AbstractStations):
            found |= _by_stations(node, shot, met[name], members)
        else:
            found |= _by_group(sensor, shot, met[name], name, option, members)
    columns = []
    for of in places:
        x, y = zip(*(found[place] for place in of), strict=True)
        columns.append((sum(x), sum(y)))
    return columns


def _by_stations(link: AbstractStations, shot: Shot, met: _Passage, members: list[Address]) -> dict[Address, Vec2]:
    """Of single stations' numbers: they act as the motion does, with the station's weight."""
    shape = met.outer[0].shape
    moved = jax.tree.map(lambda c: jnp.broadcast_to(jnp.asarray(c, dtype=float), shape), motion(link, shot))
    six = _by_motion(link, shot, moved, met)
    acting = link.acting(shot)
    found: dict[Address, Vec2] = {}
    for place in members:
        station, axis = place.index
        weight = sum(jnp.where(jnp.asarray(i) == station, w, 0.0) for i, w in acting)
        column = six[axis + 3 * (place.path[0] == "shift_m")]
        found[place] = weight * column[0], weight * column[1]
    return found


def _by_group(sensor: Sensor, shot: Shot, met: _Passage, name: str, option: str, members: list[Address]) -> dict[Address, Vec2]:
    """Of numbers that live in one link, or in one option of a `By`: where another option acts they do nothing."""
    acts: Any = True
    if option:
        chooser: By = sensor[name]
        key = shot.need(chooser.key, "which tells the options apart")
        index = chooser.names.index(option)
        acts = jnp.asarray(key) == index
        shot = dataclasses.replace(shot, **{chooser.key: index})  # the one option, chosen before tracing

    def passed(values: Array):
        changed = put(sensor, members, list(values))
        if name == "camera":
            return changed.camera_at(shot).pixel(met.outer)
        if name == "refraction":
            return apparent(changed, shot, met.outer)
        return changed[name].pose(shot).into(met.outer)

    values = jnp.stack([read(sensor, place) for place in members])
    moves = jax.vmap(lambda direction: jax.jvp(passed, (values,), (direction,))[1])(jnp.eye(len(members)))

    def column(move: Any) -> Vec2:
        x, y = move if name == "camera" else apply(met.rows, move)
        return jnp.where(acts, x, 0.0), jnp.where(acts, y, 0.0)

    x, y = jax.vmap(column)(moves)
    return {place: (x[i], y[i]) for i, place in enumerate(members)}
