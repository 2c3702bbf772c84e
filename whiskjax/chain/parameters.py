"""Numbers of a sensor as one whitened vector: where they live, what is known of them, and what they do to the pixel.

Every estimator sees a sensor so. A number of a link moves a point as it passes that link, and one sweep of `joint_derivatives`
knows what every such move does to the pixel: only the one link is differentiated, not the chain behind it.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Vec2, Vec3, apply
from ..rules import plain
from .address import Address, put, read
from .by import By
from .imaging import apparent
from .joints import JointDerivatives
from .sensor import Sensor
from .shot import Shot
from .stations import MOTIONS, AbstractStations, motion

Places = tuple[tuple[Address, ...], ...]


class Passage(NamedTuple):
    """A link as a ray met it: the point outside of it, and the rows of something by the point inside.

    Rows of what: of the pixel, or of a residual made of it. None for the camera, inside of which is the pixel itself.
    """

    outer: Vec3
    rows: tuple[Sequence[Component], Sequence[Component]] | None


class Columns(NamedTuple):
    """Derivatives (x, y) of something by some of the whitened numbers, (numbers, ...) each, of a shape that
    broadcasts with the shots, and which of them."""

    which: tuple[int, ...]
    x: Float[Array, "some ..."]
    y: Float[Array, "some ..."]


class Parameters(eqx.Module):
    """Numbers of a sensor, whitened: value = mean + scale * u.

    `root` turns u into whitened residuals of the prior, root @ u: the identity for independent priors, the inverse root of the
    correlation for a joint one, zero rows for numbers without a prior. `places` says where each number lives: in one place, or in
    several that share it.
    """

    mean: Float[Array, " k"]
    scale: Float[Array, " k"]
    root: Float[Array, "k k"]
    names: tuple[str, ...] = eqx.field(static=True)
    places: Places = eqx.field(static=True)

    def __len__(self) -> int:
        return len(self.places)

    @property
    def links(self) -> tuple[str, ...]:
        """The links that some number changes; "camera" and "refraction" are among them."""
        return tuple(dict.fromkeys(place.link for of in self.places for place in of))

    @property
    def has_prior(self) -> Any:
        """Which numbers have a prior, (k,)."""
        return (plain(self.root) != 0).any(axis=1)

    @property
    def information(self) -> Float[Array, "k k"]:
        """Of the prior, whitened."""
        return self.root.T @ self.root

    def value(self, u: Float[Array, " k"]) -> Float[Array, " k"]:
        """In the units of the fields."""
        return self.mean + self.scale * u

    def put(self, sensor: Sensor, u: Any) -> Sensor:
        """The sensor with whitened numbers put in."""
        mean, scale = plain(self.mean), plain(self.scale)  # single numbers of a device are slow to read
        pairs = [(place, mean[k] + scale[k] * u[k]) for k, of in enumerate(self.places) for place in of]
        return put(sensor, [place for place, _ in pairs], [value for _, value in pairs]) if pairs else sensor

    def columns(self, sensor: Sensor, shot: Shot, met: Mapping[str, Passage]) -> list[Columns]:
        """What each number does to whatever the passages' rows belong to.

        Numbers that act on none of the shots, because a key that is a Python int chooses another option, are in no part; one with
        places in several links is in several parts, which add up.

        **Arguments:** `sensor`: with the numbers put in; `met`: the passage of every link in `links`, of one shape.
        """
        parts: dict[tuple[str, str, bool], list[tuple[int, Address]]] = {}
        for k, of in enumerate(self.places):
            for place in of:
                node = sensor[place.link]
                of_station = isinstance(node, AbstractStations) and place.path[0] in MOTIONS
                option = place.path[0] if isinstance(node, By) else ""
                parts.setdefault((place.link, option, of_station), []).append((k, place))
        found = []
        for (name, option, of_station), members in parts.items():
            acts, chosen = True, shot
            if option:
                chooser: By = sensor[name]
                key, index = shot.need(chooser.key, "which tells the options apart"), chooser.names.index(option)
                acts = key == index if isinstance(key, int) else jnp.asarray(key) == index
                chosen = dataclasses.replace(shot, **{chooser.key: index})  # the one option, chosen before tracing
            if acts is False:
                continue
            of_link = _of_stations if of_station else _of_link
            which, x, y = of_link(sensor, chosen, name, met[name], members)
            if acts is not True:
                x, y = jnp.where(acts, x, 0.0), jnp.where(acts, y, 0.0)
            size = self.scale[jnp.array(which)].reshape(-1, *(1,) * (x.ndim - 1))
            found.append(Columns(which, size * x, size * y))
        return found


def passages(sensor: Sensor, point: Vec3, found: JointDerivatives, links: Iterable[str]) -> dict[str, Passage]:
    """Some links of a sensor, with the rows of the pixel, as the sweep through a ground point met them."""
    frames = zip((*sensor.names, "camera"), ("earth", *sensor.names), strict=True)
    outer = {link: found.points[frame] for link, frame in frames} | {"refraction": point}
    return {name: Passage(outer[name], found.derivatives.get(name)) for name in sorted(links)}


def by_motion(link: AbstractStations, shot: Shot, moved: tuple[Vec3, Vec3], met: Passage) -> list[Vec2]:
    """Derivatives by turn x, y, z and shift x, y, z of a link with stations, whose motion is `moved`."""
    six = (*moved[0], *moved[1])

    def passed(*values: Component) -> Vec3:
        return link.moved(shot, values[:3], values[3:]).into(met.outer)

    rows = met.rows
    assert rows is not None  # of a link

    _, along = jax.linearize(passed, *six)  # the link is traced once for all six

    def column(k: int) -> Vec2:
        direction = [jnp.ones_like(c) if i == k else jnp.zeros_like(c) for i, c in enumerate(six)]
        return apply(rows, along(*direction))

    return [column(k) for k in range(6)]


def _of_stations(sensor: Sensor, shot: Shot, name: str, met: Passage, members: list[tuple[int, Address]]) -> Columns:
    """By single stations' numbers: they act as the motion of the link does, with the station's weight."""
    link: AbstractStations = sensor[name]
    now = motion(link, shot)
    shape = jnp.broadcast_shapes(*(jnp.shape(c) for c in jax.tree.leaves((met.outer, now))))
    moved = jax.tree.map(lambda c: jnp.broadcast_to(jnp.asarray(c, dtype=float), shape), now)
    x, y = (jnp.stack(jnp.broadcast_arrays(*of)) for of in zip(*by_motion(link, shot, moved, met), strict=True))
    station = np.array([place.index[0] for _, place in members], dtype=np.int32).reshape(-1, *(1,) * len(shape))
    acting = [(jnp.broadcast_to(jnp.asarray(i, dtype=jnp.int32), shape)[None], w) for i, w in link.acting(shot)]
    weight = sum(jnp.where(i == station, jnp.broadcast_to(jnp.asarray(w, dtype=float), shape)[None], 0.0) for i, w in acting)
    axis = jnp.array([place.index[1] + 3 * MOTIONS.index(place.path[0]) for _, place in members])
    return _added(tuple(k for k, _ in members), weight * x[axis], weight * y[axis])


def _added(of: tuple[int, ...], x: Array, y: Array) -> Columns:
    """Columns in which each number stands once."""
    which = tuple(dict.fromkeys(of))
    if len(which) == len(of):
        return Columns(which, x, y)
    place = jnp.array([which.index(k) for k in of])
    nothing = jnp.zeros((len(which), *x.shape[1:]))
    return Columns(which, nothing.at[place].add(x), nothing.at[place].add(y))


def _of_link(sensor: Sensor, shot: Shot, name: str, met: Passage, members: list[tuple[int, Address]]) -> Columns:
    """By the numbers of one link, or of one option of a `By`, of the camera or of the refraction."""
    which = tuple(dict.fromkeys(k for k, _ in members))
    whose = [which.index(k) for k, _ in members]
    places = [place for _, place in members]

    def passed(values: Array) -> Any:
        changed = put(sensor, places, [values[i] for i in whose])
        if name == "camera":
            return changed.camera_at(shot).pixel(met.outer)
        if name == "refraction":
            return apparent(changed, shot, met.outer)
        return changed[name].pose(shot).into(met.outer)

    first = {i: place for i, place in reversed(list(zip(whose, places, strict=True)))}
    values = jnp.stack([read(sensor, first[i]) for i in range(len(which))])

    def column(direction: Array) -> Vec2:
        move = jax.jvp(passed, (values,), (direction,))[1]
        x, y = move if met.rows is None else apply(met.rows, move)
        return jnp.asarray(x, dtype=float), jnp.asarray(y, dtype=float)

    return Columns(which, *jax.vmap(column)(jnp.eye(len(which))))
