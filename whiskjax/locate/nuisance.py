"""Numbers of the sensor that all looks share: estimated with the target, or only considered."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Vec2, Vec3
from ..chain.joints import JointDerivatives
from ..chain.parameters import Parameters, passages
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..estimate.given import given, joined, posed
from ..rules import WhiskjaxError


class Nuisance(eqx.Module):
    """Numbers behind the target in the state, whitened, and the correlation of their priors.

    `share` is 1 for what is estimated and 0 for what is considered: its gain is zero, but its covariance counts (Schmidt 1966).
    """

    numbers: Parameters
    correlation: Float[Array, "k k"]
    share: tuple[int, ...] = eqx.field(static=True)

    def put(self, sensor: Sensor, u: Sequence[Component]) -> Sensor:
        """The sensor with whitened values put in."""
        return self.numbers.put(sensor, u)

    def rows(self, sensor: Sensor, shot: Shot, point: Vec3, found: JointDerivatives) -> list[Vec2]:
        """Derivative of the pixel by each of them.

        **Arguments:** `sensor`, `found`: with the numbers put in; `point`: the target, in the world.
        """
        rows: list[Vec2] = [(0.0, 0.0)] * len(self.numbers)
        for part in self.numbers.columns(sensor, shot, passages(sensor, point, found, self.numbers.links)):
            for i, k in enumerate(part.which):
                rows[k] = rows[k][0] + part.x[i], rows[k][1] + part.y[i]
        return rows


def gather(sensor: Sensor, estimate: Any, consider: Any) -> tuple[Sensor, Nuisance]:
    """The sensor with room for all of them, and their joint prior.

    **Arguments:** each a list of unknowns with priors and of estimates, whose posterior is a joint prior.

    **Raises:** `WhiskjaxError` where one has no prior, or two share a name or a place.
    """
    estimated, considered = given("locate", "estimate", estimate), given("locate", "consider", consider)
    both = joined(estimated, considered)
    for x in both.unknowns:
        if x.sigma is None:
            raise WhiskjaxError(f"locate: {x.name} has no prior sigma, and a filter starts from a prior")
    sensor, numbers, _ = posed(sensor, both)
    share = (1,) * len(estimated.unknowns) + (0,) * len(considered.unknowns)
    return sensor, Nuisance(numbers, jnp.asarray(both.correlation), share)
