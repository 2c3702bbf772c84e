"""What is to be estimated: one number, where it lives, and what is known of it beforehand."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.address import Address, is_in_degrees, make_room, parse, put
from ..chain.sensor import Sensor
from ..rules import Arrays, Numbers, WhiskjaxError, is_traced, need
from ..rules.spread import LEAST_SCALE, MOST_SCALE, refuse_sigmas


class Unit(NamedTuple):
    """The unit shown to people: `shown = factor * inside`."""

    name: str
    factor: float


METRE, ANGLE = Unit("m", 1.0), Unit("deg", math.degrees(1.0))
_UNITS = {
    "_m": METRE,
    "_rad": ANGLE,
    "_s": Unit("ms", 1e3),
    "_px": Unit("px", 1.0),
}
_NO_UNIT = Unit("1", 1.0)


def unit_of(place: Address) -> Unit:
    """The unit for people of the number at a place, from the suffix of the field."""
    field = place.path[-1]
    return next((unit for suffix, unit in _UNITS.items() if field.endswith(suffix)), _NO_UNIT)


class Unknown(eqx.Module):
    """One number to be estimated.

    **Arguments:**

    - `name`: for people, as "omega_pos_left".
    - `where`: its place in the sensor, as "platform.left.angles_rad[0]", or several places that share the one number. Files and
      results write "platform.left.angles_deg[0]": that is taken too, with the numbers below in degrees, and is turned into
      radians here.
    - `mean`, `sigma`: a-priori knowledge as a 1-sigma, in the unit of the place (metres, radians or degrees, seconds, pixels).
      Both or neither.
    - `scale`: without a prior, the size of a typical change; it whitens the unknown and does not pull on it.

    The iteration starts from the value that the sensor holds. The unit follows from the field's suffix. Mean, sigma and scale may
    be traced: answers can be differentiated by what was known beforehand.
    """

    name: str = eqx.field(static=True)
    where: str | tuple[str, ...] = eqx.field(static=True)
    mean: Any = None
    sigma: Any = None
    scale: Any = None

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
            setattr(self, field, value if value is None or is_traced(value) else float(value))
        self._to_radians()
        if (self.mean is None) != (self.sigma is None):
            raise WhiskjaxError(f"unknown {self.name}: a prior has both a mean and a sigma; without a prior give a scale")
        if (self.sigma is None) == (self.scale is None):
            raise WhiskjaxError(f"unknown {self.name}: give either a prior (mean and sigma) or a scale")
        if not is_traced(self.size) and not (math.isfinite(self.size) and self.size > 0):
            raise WhiskjaxError(f"unknown {self.name}: sigma or scale must be a positive number, not {self.size}")
        if not is_traced(self.mean):
            self._check_mean(arrays)
        if not is_traced(self.size):
            what = "scale" if self.sigma is None else "prior sigma"
            label = f"unknown {self.name}: its {what}"
            refuse_sigmas(np.array([self.size]), lambda _: label, least=LEAST_SCALE, most=MOST_SCALE)

    def _check_mean(self, arrays: Arrays) -> None:
        if self.mean is not None and not math.isfinite(self.mean):
            raise WhiskjaxError(f"unknown {self.name}: the prior mean is {self.mean}")
        if self.places[0].path[-1] == "focal_px":
            arrays.take("mean", self.mean, "", optional=True, above=0.0)
        if self.places[0].path[-1].endswith("_rad"):
            arrays.take("mean", self.mean, "", optional=True, within_rad=2 * math.pi)
        if self.mean is not None and not abs(self.mean) <= MOST_SCALE:
            raise WhiskjaxError(f"unknown {self.name}: a prior mean of {self.mean:g} is no number to reckon with")

    def _to_radians(self) -> None:
        """From degrees, where the place is written in them."""
        where = (self.where,) if isinstance(self.where, str) else tuple(self.where)
        written = {is_in_degrees(text) for text in where}
        if len(written) > 1:
            raise WhiskjaxError(
                f"unknown {self.name}: {', '.join(where)} share one number: write all in degrees, or all in radians"
            )
        in_degrees, inner = written.pop(), tuple(place.inner for place in self.places)
        self.where = inner[0] if isinstance(self.where, str) else inner
        for field in ("mean", "sigma", "scale") if in_degrees else ():
            if (value := getattr(self, field)) is not None:
                setattr(self, field, value * (math.pi / 180) if is_traced(value) else math.radians(value))

    @property
    def places(self) -> tuple[Address, ...]:
        """Where the number lives, parsed."""
        return tuple(parse(text) for text in ((self.where,) if isinstance(self.where, str) else self.where))

    @property
    def unit(self) -> Unit:
        """The unit for people, from the suffix of the field."""
        return unit_of(self.places[0])

    @property
    def size(self) -> Any:
        """What whitens it: the prior sigma, or the scale."""
        return self.sigma if self.sigma is not None else self.scale


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
    return make_room(sensor, *(place for unknown in unknowns for place in unknown.places))


def assign(sensor: Sensor, unknowns: Sequence[Unknown], values: Float[Numbers, " unknowns"]) -> Sensor:
    """The sensor with unknowns set to values (k,) in the units of their fields; differentiable in the values.

    The way from a vector of parameters to an image: `jax.jacfwd(lambda v: project(assign(sensor, unknowns, v), shot, point))`.
    """
    need("assign", "sensor", sensor, Sensor)
    need_unknowns("assign", "unknowns", unknowns)
    value = jnp.asarray(Arrays("assign").take("values", values, str(len(unknowns)), meaning="one number for each unknown"))
    pairs = [(place, value[k]) for k, unknown in enumerate(unknowns) for place in unknown.places]
    return put(admit(sensor, unknowns), [place for place, _ in pairs], [v for _, v in pairs])
