"""Every number of a sensor that might be wrong: all that can be estimated, whether somebody does or not."""

import math
from collections.abc import Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .address import Address
from .by import By
from .part import AbstractPart
from .sensor import Sensor

_LONGEST = 16  # entries of an array: longer ones are records


def free_numbers(sensor: Sensor) -> tuple[Address, ...]:
    """Lever arms, angles, delays, focal lengths, coefficients and so on, in the order of the chain; every option of a `By`.

    Records (samples of a trajectory, readings of an encoder, motions at stations, tables) are none, nor what says what a part is.
    """
    own = tuple(place for name in (*sensor.names, "camera") for place in _within(name, (), sensor[name]))
    return own if sensor.refraction is None else (*own, Address("refraction", ("scale",), ()))


def _within(link: str, path: tuple[str, ...], part: object) -> Iterator[Address]:
    if isinstance(part, By):
        for name, option in zip(part.names, part.options, strict=True):
            yield from _within(link, (*path, name), option)
        return
    if not isinstance(part, eqx.Module):
        return
    is_part = isinstance(part, AbstractPart)
    for field in vars(part):
        leaf = getattr(part, field)
        if isinstance(leaf, AbstractPart) and (not is_part or part.may_hold(field)):
            yield from _within(link, (*path, field), leaf)
        if not is_part or not part.may_hold(field):
            continue
        if leaf is None:
            shape = None if (room := part.absent(field)) is None else room.shape
        elif isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating):
            shape = leaf.shape
        else:
            shape = () if type(leaf) is int else None  # structural
        if shape is not None and math.prod(shape) <= _LONGEST:
            for index in np.ndindex(shape):
                yield Address(link, (*path, field), tuple(map(int, index)))
