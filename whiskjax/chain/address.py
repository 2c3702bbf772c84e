"""Where a number lives in a sensor: "platform.left.angles_deg[0]", as files, results and messages call it.

The sensor holds radians: its field is `angles_rad`, and a place may be written so too. Which of the two somebody writes says the
unit of the numbers that go with it.
"""

import dataclasses
import re
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..algebra.vectors import is_structural
from ..rules import WhiskjaxError
from .by import By
from .correction import Correction
from .sensor import Sensor
from .trajectory import PosePerImage


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


# What a part is, or where it is recorded: signs, the scale of a polynomial's argument, sizes, tables.
_GIVEN = {"along_sign", "across_sign", "half_width_px", "samples_px", "size_px", "sample_px", "time_s", "max_gap_s"}
_INNER, _SHOWN = re.compile("_rad$"), re.compile("_deg$")
_FORM = re.compile(r"^([A-Za-z_]\w*(?:\.[\w-]+)+)(?:\[((?:0|[1-9][0-9]*)(?:\s*,\s*(?:0|[1-9][0-9]*))*)\])?$")


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


def _step(node: Any, name: str, text: str) -> Any:
    if isinstance(node, By):
        return node[name]
    fields = [f.name for f in dataclasses.fields(node)] if dataclasses.is_dataclass(node) else []
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
    if leaf is None or is_structural(leaf, 0):
        return jnp.zeros(())
    return leaf[address.index] if address.index else leaf


_WHERE_ABSENT_IS_ZERO = {"lever_arm_m": (3,), "angles_rad": (3,), "distortion": (5,), "deformation_px": (2, 4)}


def _zeros_like_field(node: Any, name: str) -> Any:
    """What an absent parameter means, as an array that can hold an unknown; None where no number means the same."""
    if name in ("turn_rad", "shift_m"):
        if isinstance(node, Correction):
            return jnp.zeros((node.basis.size, 3))
        if isinstance(node, PosePerImage):
            return jnp.zeros((node.position_m[0].shape[0], 3))
    shape = _WHERE_ABSENT_IS_ZERO.get(name)
    return None if shape is None else jnp.zeros(shape)


def make_room(sensor: Sensor, address: Address) -> Sensor:
    """The same sensor, with a real number at the address where there was a structural zero or None.

    **Raises:** `WhiskjaxError` where the place holds no number, or the index lies outside the array.
    """
    node = sensor[address.link]
    for name in address.path[:-1]:
        node = _step(node, name, address.text)
    leaf = _step(node, address.path[-1], address.text)
    if leaf is None or is_structural(leaf, 0):
        leaf = jnp.zeros(()) if leaf is not None else _zeros_like_field(node, address.path[-1])
        if leaf is not None:
            sensor = eqx.tree_at(lambda s: node_at(s, address), sensor, leaf, is_leaf=lambda x: x is None)
    if address.path[-1] in _GIVEN or not (isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating)):
        raise WhiskjaxError(f"{address.text} is not a number that can be estimated")
    if len(address.index) != leaf.ndim or any(i >= n for i, n in zip(address.index, leaf.shape, strict=True)):
        raise WhiskjaxError(f"{address.text}: the array there has shape {leaf.shape}; name one of its entries, as [0]")
    return sensor


def put(sensor: Sensor, addresses: list[Address], values: list[Any]) -> Sensor:
    """The sensor with numbers put in; entries of one array are set together."""
    by_leaf: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for k, a in enumerate(addresses):
        by_leaf.setdefault((a.link, a.path), []).append(k)
    firsts = [addresses[ks[0]] for ks in by_leaf.values()]
    leaves = []
    for first, ks in zip(firsts, by_leaf.values(), strict=True):
        leaf = node_at(sensor, first)
        if leaf.ndim == 0:
            leaf = jnp.asarray(values[ks[-1]], dtype=leaf.dtype)
        elif leaf.ndim == 1:
            entries = {addresses[k].index[0]: values[k] for k in ks}
            leaf = jnp.stack([entries.get(i, leaf[i]) for i in range(leaf.shape[0])])
        else:
            for k in ks:
                leaf = leaf.at[addresses[k].index].set(values[k])
        leaves.append(leaf)
    return eqx.tree_at(lambda s: [node_at(s, a) for a in firsts], sensor, leaves)
