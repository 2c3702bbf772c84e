"""What is known of numbers beforehand: each by itself, or jointly, as an earlier answer left them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.address import node_at
from ..chain.parameters import Parameters
from ..chain.sensor import Sensor
from ..rules import Arrays, WhiskjaxError, is_traced, need, on_device
from .estimate import Estimate
from .unknown import Unknown, admit

_FARTHEST = 1e12  # prior sigmas from the prior mean
_LEAST = 1e-13  # eigenvalue of a correlation: below it is what rounding leaves of zero

# What a verb takes as unknowns, or as numbers to be considered.
Knowledge = Any  # Sequence[Unknown | Estimate | answer] | Estimate | answer


class Given(NamedTuple):
    """Numbers with their priors, and the correlation of those, (k, k)."""

    unknowns: tuple[Unknown, ...]
    correlation: Float[Any, "k k"]

    @property
    def is_joint(self) -> bool:
        """Whether some priors hang together."""
        return is_traced(self.correlation) or bool((self.correlation != np.eye(len(self.unknowns))).any())


def given(owner: str, name: str, items: Any) -> Given:
    """An argument of somebody as numbers with joint priors: unknowns, estimates (or answers that have one), or a list of both.

    **Raises:** `WhiskjaxError` where an item is neither, an estimate did not determine its numbers, or its covariance is not
    positive definite.
    """
    if isinstance(items, Given):
        return items
    if isinstance(items, Unknown):
        raise WhiskjaxError(f"{owner}: {name} is one Unknown, but a list of them is expected: [{items.name}]")
    if isinstance(getattr(items, "estimate", items), Estimate):
        items = [items]
    need(owner, name, items, Sequence)
    if all(isinstance(item, Unknown) for item in items):
        return Given(tuple(items), np.eye(len(items)))
    unknowns: list[Unknown] = []
    blocks = []
    for i, item in enumerate(items):
        item = getattr(item, "estimate", item)
        if isinstance(item, Estimate):
            if np.ndim(item.value) > 1:
                raise WhiskjaxError(f"{owner}: {name}[{i}] is the answer of many runs: hand on that of one")
            unknowns += item.unknowns
            blocks.append(_correlation(owner, f"{name}[{i}]", item))
        else:
            need(owner, f"{name}[{i}]", item, Unknown)
            unknowns.append(item)
            blocks.append(np.eye(1))
    return Given(tuple(unknowns), _diagonal(blocks))


def joined(*parts: Given) -> Given:
    """All of them, one behind the other, independent of each other."""
    return Given(tuple(x for part in parts for x in part.unknowns), _diagonal([part.correlation for part in parts]))


def _correlation(owner: str, name: str, of: Estimate) -> Any:
    correlation = of.correlation
    if not is_traced(correlation):
        correlation = np.asarray(correlation)
        correlation = (correlation + correlation.T) / 2
        if not np.isfinite(correlation).all() or not np.linalg.eigvalsh(correlation)[0] > _LEAST:
            Arrays(owner).refuse(name, "has a covariance that is not positive definite, which is no joint prior")
    return correlation


def _diagonal(blocks: Sequence[Any]) -> Any:
    """Blocks along the diagonal of a matrix."""
    size = [len(block) for block in blocks]
    first = np.cumsum([0, *size])
    math: Any = jnp if any(is_traced(block) for block in blocks) else np
    rows = [math.pad(b, ((0, 0), (at, int(first[-1]) - at - n))) for b, at, n in zip(blocks, first, size, strict=False)]
    return math.concatenate(rows) if rows else np.zeros((0, 0))


def posed(sensor: Sensor, priors: Given) -> tuple[Sensor, Parameters, Any]:
    """The sensor with room for the numbers, the numbers, and where they start: whitened, as the sensor holds them.

    **Raises:** `WhiskjaxError` where a name or a place is used twice or does not exist, or a number starts so far from its prior
    mean that float64 holds no difference.
    """
    unknowns = priors.unknowns
    if unknowns:
        sensor = admit(sensor, unknowns)
    start = held(sensor, unknowns)
    mean = _joined([s if x.mean is None else x.mean for x, s in zip(unknowns, start, strict=True)])
    scale = _joined([x.size for x in unknowns])
    u = (start - mean) / scale
    if not is_traced(u) and not (near := np.abs(u) <= _FARTHEST).all():
        i = int(np.argmin(near))
        raise WhiskjaxError(
            f"unknown {unknowns[i].name}: the sensor starts at {start[i]:g}, {abs(u[i]):.3g} prior sigmas from its prior mean "
            f"{mean[i]:g}: no measurement can tell them apart; look at mean, sigma and their unit"
        )
    root: Any = np.diag([float(x.sigma is not None) for x in unknowns])
    if is_traced(priors.correlation):
        root = root @ jnp.linalg.inv(jnp.linalg.cholesky(priors.correlation))
    elif priors.is_joint:
        root = root @ np.linalg.inv(np.linalg.cholesky(priors.correlation))
    names, places = tuple(x.name for x in unknowns), tuple(x.places for x in unknowns)
    return sensor, Parameters(on_device(mean), on_device(scale), on_device(root), names, places), u


def held(sensor: Sensor, unknowns: Sequence[Unknown]) -> Any:
    """What the sensor holds of each number, in the units of the fields, (k,)."""
    leaves: dict[Any, Any] = {}
    found = []
    for place in (x.places[0] for x in unknowns):
        key = place.link, place.path
        if key not in leaves:
            leaf = node_at(sensor, place)
            leaves[key] = leaf if is_traced(leaf) else np.asarray(leaf)
        found.append(leaves[key][place.index])
    return _joined(found)


def _joined(numbers: Sequence[Any]) -> Any:
    if any(is_traced(n) for n in numbers):
        return jnp.stack([jnp.asarray(n, dtype=float) for n in numbers])
    return np.array(numbers, dtype=float)
