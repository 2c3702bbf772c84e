"""Rays of a block and everything that they depend on, from one sweep through the chain."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ...algebra.vectors import Component, Vec2, Vec3, vsub
from ...chain.joints import joint_derivatives
from ...chain.link import Given
from ...chain.parameters import Parameters, by_motion, passages
from ...chain.sensor import Sensor
from ...chain.shot import Shot
from ...chain.stations import AbstractStations, motion
from ...rules import once


class Dependence(NamedTuple):
    """Residuals of rays in pixels, and derivatives of the *pixel*, for x and y each.

    `by_motion`: by the six numbers (turn, shift) of the stations' link; `by_unknown`: by each other unknown,
    whitened.
    """

    residual: Vec2
    by_point: tuple[Vec3, ...]
    by_motion: tuple[tuple[Component, ...], ...]
    by_unknown: tuple[tuple[Component, ...], ...]


def depend(sensor: Sensor, shot: Shot, point: Vec3, pixel: Vec2, stations: str | None, unknowns: Parameters) -> Dependence:
    """Residual = measured - projected of rays, with all derivatives; every component has the shape of the rays.

    **Arguments:** `sensor`: with everything put in; `stations`: the link whose stations are unknown, or None; `unknowns`: the
    others.
    """
    shape = pixel[0].shape

    def full(value: Any) -> Any:
        return jax.tree.map(lambda c: jnp.broadcast_to(jnp.asarray(c, dtype=float), shape), value)

    through, moved, carried = sensor, None, shot
    if stations is not None:
        link: AbstractStations = sensor[stations]
        moved = once(lambda: full(motion(link, shot)))
        pose = once(lambda: full(link.moved(shot, *moved)))
        through, carried = _given(sensor, shot, stations, pose)
    links = {*unknowns.links, *(() if stations is None else (stations,))}

    def seen():
        found = joint_derivatives(through, carried, point)
        return full((vsub(pixel, found.pixel), found.derivatives["earth"], passages(sensor, point, found, links)))

    residual, by_point, met = once(seen)
    by_six: Any = ((), ())
    if stations is not None and moved is not None:
        by_six = tuple(zip(*by_motion(sensor[stations], shot, moved, met[stations]), strict=True))
    x, y = ([jnp.zeros(shape)] * len(unknowns) for _ in range(2))
    for part in unknowns.columns(sensor, shot, met):
        for i, k in enumerate(part.which):
            x[k], y[k] = x[k] + part.x[i], y[k] + part.y[i]
    return Dependence(residual, by_point, by_six, (tuple(x), tuple(y)))


def _given(sensor: Sensor, shot: Shot, name: str, pose: Any) -> tuple[Sensor, Shot]:
    """The same with one link's pose carried by the shot."""
    links = {n: Given(len(shot.poses)) if n == name else link for n, link in zip(sensor.names, sensor.links, strict=True)}
    return Sensor(links, sensor.camera, sensor.refraction), dataclasses.replace(shot, poses=(*shot.poses, pose))
