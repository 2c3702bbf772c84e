"""What is to be estimated: one number, where it lives, and what is known of it beforehand."""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.address import Address, is_in_degrees, make_room, parse, put, read
from ..chain.sensor import Sensor
from ..rules import Arrays, Numbers, WhiskjaxError, need
from ..rules.spread import LEAST_SCALE, MOST_SCALE, refuse_sigmas


class Unit(NamedTuple):
    """The unit shown to people: `shown = factor * inside`."""

    name: str
    factor: float


_UNITS = {
    "_m": Unit("m", 1.0),
    "_rad": Unit("deg", math.degrees(1.0)),
    "_s": Unit("ms", 1e3),
    "_px": Unit("px", 1.0),
}
_NO_UNIT = Unit("1", 1.0)
_FARTHEST = 1e12  # prior sigmas from the prior mean


@dataclasses.dataclass(frozen=True)
class Unknown:
    """One number to be estimated.

    **Arguments:**

    - `name`: for people, as "omega_pos_left".
    - `where`: its place in the sensor, as "platform.left.angles_rad[0]", or several places that share the one number. Files and
      results write "platform.left.angles_deg[0]": that is taken too, with the numbers below in degrees, and is turned into
      radians here.
    - `mean`, `sigma`: a-priori knowledge as a 1-sigma, in the unit of the place (metres, radians or degrees, seconds, pixels).
      Both or neither.
    - `scale`: without a prior, the size of a typical change; it whitens the unknown and does not pull on it.

    The iteration starts from the value that the sensor holds. The unit follows from the field's suffix.
    """

    name: str
    where: str | tuple[str, ...]
    mean: float | None = None
    sigma: float | None = None
    scale: float | None = None

    def __post_init__(self):
        need("Unknown", "name", self.name, str)
        if not self.name.strip():
            raise WhiskjaxError(f"an Unknown is named {self.name!r}; results and messages need a word for it")
        need(f"Unknown {self.name}", "where", self.where, (str, tuple, list), "a place as 'camera.focal_px', or several")
        if not self.places:
            raise WhiskjaxError(f"unknown {self.name}: where is empty; a place is needed, as 'camera.focal_px'")
        arrays = Arrays(f"Unknown {self.name}")
        for field in ("mean", "sigma", "scale"):
            value = arrays.take(field, getattr(self, field), "", optional=True)
            object.__setattr__(self, field, None if value is None else float(value))
        self._to_radians()
        if (self.mean is None) != (self.sigma is None):
            raise WhiskjaxError(f"unknown {self.name}: a prior has both a mean and a sigma; without a prior give a scale")
        if (self.sigma is None) == (self.scale is None):
            raise WhiskjaxError(f"unknown {self.name}: give either a prior (mean and sigma) or a scale")
        size = self.sigma if self.sigma is not None else self.scale
        if not (size is not None and math.isfinite(size) and size > 0):
            raise WhiskjaxError(f"unknown {self.name}: sigma or scale must be a positive number, not {size}")
        if self.mean is not None and not math.isfinite(self.mean):
            raise WhiskjaxError(f"unknown {self.name}: the prior mean is {self.mean}")
        if self.places[0].path[-1] == "focal_px":
            arrays.take("mean", self.mean, "", optional=True, above=0.0)
        if self.places[0].path[-1].endswith("_rad"):
            arrays.take("mean", self.mean, "", optional=True, within_rad=2 * math.pi)
        what = "scale" if self.sigma is None else "prior sigma"
        if self.mean is not None and not abs(self.mean) <= MOST_SCALE:
            raise WhiskjaxError(f"unknown {self.name}: a prior mean of {self.mean:g} is no number to reckon with")
        refuse_sigmas(np.array([size]), lambda _: f"unknown {self.name}: its {what}", least=LEAST_SCALE, most=MOST_SCALE)

    def _to_radians(self) -> None:
        """From degrees, where the place is written in them."""
        where = (self.where,) if isinstance(self.where, str) else tuple(self.where)
        written = {is_in_degrees(text) for text in where}
        if len(written) > 1:
            raise WhiskjaxError(
                f"unknown {self.name}: {', '.join(where)} share one number: write all in degrees, or all in radians"
            )
        if not written.pop():
            return
        inner = tuple(place.inner for place in self.places)
        object.__setattr__(self, "where", inner[0] if isinstance(self.where, str) else inner)
        for field in ("mean", "sigma", "scale"):
            if (value := getattr(self, field)) is not None:
                object.__setattr__(self, field, math.radians(value))

    @property
    def places(self) -> tuple[Address, ...]:
        """Where the number lives, parsed."""
        return tuple(parse(text) for text in ((self.where,) if isinstance(self.where, str) else self.where))

    @property
    def unit(self) -> Unit:
        """The unit for people, from the suffix of the field."""
        field = self.places[0].path[-1]
        return next((unit for suffix, unit in _UNITS.items() if field.endswith(suffix)), _NO_UNIT)

    @property
    def size(self) -> float:
        """What whitens it: the prior sigma, or the scale."""
        size = self.sigma if self.sigma is not None else self.scale
        assert size is not None  # __post_init__ asked for one of the two
        return size


def need_unknowns(owner: str, name: str, unknowns: Sequence[Unknown]) -> None:
    """**Raises:** `WhiskjaxError` where these are no unknowns; `owner` is whose argument they are."""
    if isinstance(unknowns, Unknown):
        raise WhiskjaxError(f"{owner}: {name} is one Unknown, but a list of them is expected: [{unknowns.name}]")
    need(owner, name, unknowns, Sequence)
    for i, unknown in enumerate(unknowns):
        need(owner, f"{name}[{i}]", unknown, Unknown)


def admit(sensor: Sensor, unknowns: Sequence[Unknown]) -> Sensor:
    """The sensor with a number wherever an unknown lives.

    **Raises:** `WhiskjaxError` where there is no sensor, no unknown, a name or a place is used twice, or a place does not exist.
    """
    if not unknowns:
        raise WhiskjaxError("there is nothing to estimate: give at least one Unknown")
    need_unknowns("admit", "unknowns", unknowns)
    names, places = set(), set()
    for unknown in unknowns:
        if unknown.name in names:
            raise WhiskjaxError(f"two unknowns are named {unknown.name}")
        names.add(unknown.name)
        for place in unknown.places:
            if place in places:
                raise WhiskjaxError(f"unknown {unknown.name}: {place.text} is already estimated by another unknown")
            places.add(place)
            sensor = make_room(sensor, place)
    return sensor


def assign(sensor: Sensor, unknowns: Sequence[Unknown], values: Float[Numbers, " unknowns"]) -> Sensor:
    """The sensor with unknowns set to values (k,) in the units of their fields; differentiable in the values.

    The way from a vector of parameters to an image: `jax.jacfwd(lambda v: project(assign(sensor, unknowns, v), shot, point))`.
    """
    need("assign", "sensor", sensor, Sensor)
    need_unknowns("assign", "unknowns", unknowns)
    value = jnp.asarray(Arrays("assign").take("values", values, str(len(unknowns)), meaning="one number for each unknown"))
    pairs = [(place, value[k]) for k, unknown in enumerate(unknowns) for place in unknown.places]
    return put(admit(sensor, unknowns), [place for place, _ in pairs], [v for _, v in pairs])


def whitened(
    unknowns: Sequence[Unknown], start: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Mean and scale of each unknown, and the start value in scales from the mean: value = mean + scale * u.

    **Raises:** `WhiskjaxError` naming the first that starts so far from its prior mean that float64 holds no difference.
    """
    mean = np.array([s if x.mean is None else x.mean for x, s in zip(unknowns, start, strict=True)])
    scale = np.array([x.size for x in unknowns])
    u = (start - mean) / scale
    far = ~(np.abs(u) <= _FARTHEST)
    if far.any():
        i = int(np.argmax(far))
        raise WhiskjaxError(
            f"unknown {unknowns[i].name}: the sensor starts at {start[i]:g}, {abs(u[i]):.3g} prior sigmas from its prior mean "
            f"{mean[i]:g}: no measurement can tell them apart; look at mean, sigma and their unit"
        )
    return mean, scale, u


def start_of(sensor: Sensor, unknown: Unknown) -> float:
    """The value that the sensor holds, in the field's unit."""
    return float(read(sensor, unknown.places[0]))
