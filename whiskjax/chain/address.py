"""Where a number lives in a sensor: "platform.left.angles_deg[0]", as files, results and messages call it.

The sensor holds radians: its field is `angles_rad`, and a place may be written so too. Which of the two somebody writes says the
unit of the numbers that go with it.
"""

import dataclasses
import re
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..rules import WhiskjaxError, is_traced, on_device
from .by import By
from .part import AbstractPart
from .sensor import Sensor


class Address(NamedTuple):
    """A parsed place: the link (or "camera"), the path of names below it, and the index inside the array."""

    link: str
    path: tuple[str, ...]
    index: tuple[int, ...]

    @property
    def text(self) -> str:
        """As it is written for people, and as flight.toml takes it: angles in degrees."""
        return self._written(_INNER.sub("_deg", self.path[-1]))

    @property
    def inner(self) -> str:
        """As the sensor's fields are called: angles in radians."""
        return self._written(self.path[-1])

    def _written(self, field: str) -> str:
        index = f"[{','.join(map(str, self.index))}]" if self.index else ""
        return ".".join((self.link, *self.path[:-1], field)) + index


_INNER, _SHOWN = re.compile("_rad$"), re.compile("_deg$")
_FORM = re.compile(r"^([A-Za-z_]\w*(?:\.[\w-]+)+)(?:\[((?:0|[1-9][0-9]*)(?:\s*,\s*(?:0|[1-9][0-9]*))*)\])?$")


@cache
def parse(text: str) -> Address:
    """A place, with its angles in degrees or in radians.

    **Raises:** `WhiskjaxError` where the text is not of the form link.field[i] or link.option.field[i].
    """
    match = _FORM.match(text.strip()) if isinstance(text, str) else None
    if match is None:
        raise WhiskjaxError(
            f"{text!r} is no place in a sensor; places look like 'platform.left.angles_deg[0]' or 'camera.focal_px'"
        )
    link, *path = match[1].split(".")
    path[-1] = _SHOWN.sub("_rad", path[-1])
    index = tuple(int(i) for i in match[2].split(",")) if match[2] else ()
    return Address(link, tuple(path), index)


def is_in_degrees(text: str) -> bool:
    """Whether a place is written in degrees, so that the numbers that go with it are."""
    return _SHOWN.search(text.strip().partition("[")[0]) is not None


@cache
def _fields(kind: type) -> tuple[str, ...]:
    return tuple(f.name for f in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()


def _step(node: Any, name: str, text: str) -> Any:
    if isinstance(node, By):
        return node[name]
    fields = _fields(type(node))
    if name not in fields:
        raise WhiskjaxError(f"{text}: {type(node).__name__} has no {name!r}; it has {', '.join(fields)}")
    return getattr(node, name)


def node_at(sensor: Sensor, address: Address) -> Any:
    """The leaf that holds the number (the whole array, not yet indexed)."""
    node = sensor[address.link]
    for name in address.path:
        node = _step(node, name, address.text)
    return node


def read(sensor: Sensor, address: Address) -> Any:
    """The number itself."""
    leaf = node_at(sensor, address)
    if leaf is None:
        return jnp.zeros(())
    if type(leaf) is int:  # structural
        return jnp.asarray(float(leaf))
    return leaf[address.index] if address.index else leaf


def make_room(sensor: Sensor, *addresses: Address) -> Sensor:
    """The same sensor, with real numbers at the addresses where there were structural zeros or ones, or None.

    **Raises:** `WhiskjaxError` where a place holds no number, or the index lies outside the array.
    """
    rooms: dict[tuple[str, tuple[str, ...]], tuple[Address, Any]] = {}
    for address in addresses:
        node = sensor[address.link]
        for name in address.path[:-1]:
            node = _step(node, name, address.text)
        field, where = address.path[-1], (address.link, address.path)
        leaf = _step(node, field, address.text)
        part = node if isinstance(node, AbstractPart) else AbstractPart()
        if where in rooms:
            leaf = rooms[where][1]
        elif leaf is None or (type(leaf) is int and part.may_hold(field)):
            leaf = part.absent(field) if leaf is None else np.asarray(float(leaf))
            if leaf is not None:
                leaf = on_device(leaf)
                rooms[where] = address, leaf
        if field in part.given or not (isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)):
            raise WhiskjaxError(f"{address.text} is not a number that can be estimated")
        if len(address.index) != leaf.ndim or any(i >= n for i, n in zip(address.index, leaf.shape, strict=True)):
            raise WhiskjaxError(f"{address.text}: the array there has shape {leaf.shape}; name one of its entries, as [0]")
    if not rooms:
        return sensor
    firsts, leaves = zip(*rooms.values(), strict=True)
    return eqx.tree_at(lambda s: [node_at(s, a) for a in firsts], sensor, list(leaves), is_leaf=lambda x: x is None)


def put(sensor: Sensor, addresses: list[Address], values: list[Any]) -> Sensor:
    """The sensor with numbers put in; entries of one array are set together."""
    by_leaf: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for k, a in enumerate(addresses):
        by_leaf.setdefault((a.link, a.path), []).append(k)
    firsts = [addresses[ks[0]] for ks in by_leaf.values()]
    leaves = []
    for first, ks in zip(firsts, by_leaf.values(), strict=True):
        leaf = node_at(sensor, first)
        if not any(map(is_traced, (leaf, *(values[k] for k in ks)))):  # nothing to trace, and nothing to compile
            array = np.array(leaf)
            for k in ks:
                array[addresses[k].index] = values[k]
            leaf = jnp.asarray(array)
        elif leaf.ndim == 0:
            leaf = jnp.asarray(values[ks[-1]], dtype=leaf.dtype)
        elif leaf.ndim == 1:
            entries = {addresses[k].index[0]: values[k] for k in ks}
            leaf = jnp.stack([entries.get(i, leaf[i]) for i in range(leaf.shape[0])])
        else:
            for k in ks:
                leaf = leaf.at[addresses[k].index].set(values[k])
        leaves.append(leaf)
    return eqx.tree_at(lambda s: [node_at(s, a) for a in firsts], sensor, leaves)
