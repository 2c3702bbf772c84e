"""Numbers of the sensor that all looks share: estimated with the target, or only considered."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Vec2, Vec3, apply
from ..chain.address import Address, put
from ..chain.imaging import apparent
from ..chain.joints import JointDerivatives
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..estimate.calibrate import Calibration
from ..estimate.unknown import Unknown, admit
from ..rules import WhiskjaxError


class Nuisance(eqx.Module):
    """Unknowns behind the target in the state, whitened: value = mean + scale u, with the correlation of u as covariance.

    `share` is 1 for what is estimated and 0 for what is considered: its gain is zero, but its covariance counts (Schmidt 1966).
    """

    mean: Float[Array, " k"]
    scale: Float[Array, " k"]
    correlation: Float[Array, "k k"]
    share: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    places: tuple[tuple[Address, ...], ...] = eqx.field(static=True)

    @property
    def links(self) -> tuple[str, ...]:
        """The links that they change."""
        return tuple(dict.fromkeys(p.link for places in self.places for p in places))

    def put(self, sensor: Sensor, u: Sequence[Component]) -> Sensor:
        """The sensor with whitened values put in."""
        pairs = [(p, self.mean[k] + self.scale[k] * u[k]) for k, places in enumerate(self.places) for p in places]
        return put(sensor, [p for p, _ in pairs], [v for _, v in pairs]) if pairs else sensor

    def rows(self, sensor: Sensor, shot: Shot, point: Vec3, swept: JointDerivatives, u: Sequence[Component]) -> list[Vec2]:
        """Derivative of the pixel by each of them: what it does to the point that passes its link, through the chain behind it.

        **Arguments:** `sensor`, `swept`: with `u` put in; `point`: the target, in the world.
        """
        outer = dict(zip((*sensor.names, "camera"), swept.points.values(), strict=True)) | {"refraction": point}
        return [self._row(sensor, shot, swept, outer, u, k) for k in range(len(self.places))]

    def _row(
        self, sensor: Sensor, shot: Shot, swept: JointDerivatives, outer: dict[str, Any], u: Sequence[Component], k: int
    ) -> Vec2:
        x: Component = 0.0
        y: Component = 0.0
        for place in self.places[k]:

            def passed(value: Component, place: Address = place) -> Any:
                changed = put(sensor, [place], [self.mean[k] + self.scale[k] * value])
                if place.link == "camera":
                    return changed.camera_at(shot).pixel(outer["camera"])
                if place.link == "refraction":
                    return apparent(changed, shot, outer["refraction"])
                return changed[place.link].pose(shot).into(outer[place.link])

            value = jnp.asarray(u[k])
            move = jax.jvp(passed, (value,), (jnp.ones_like(value),))[1]
            dx, dy = move if place.link == "camera" else apply(swept.derivatives[place.link], move)
            x, y = x + dx, y + dy
        return x, y


def gather(sensor: Sensor, estimate: Sequence[Unknown], consider: Sequence[Unknown] | Calibration) -> tuple[Sensor, Nuisance]:
    """The sensor with room for all of them, and their joint prior.

    **Arguments:** `consider`: unknowns with priors, independent of each other, or a calibration, whose posterior is their joint
    prior.

    **Raises:** `WhiskjaxError` where one has no prior, or two share a name or a place.
    """
    for x in (*estimate, *(() if isinstance(consider, Calibration) else consider)):
        if x.sigma is None:
            raise WhiskjaxError(f"locate: {x.name} has no prior sigma, and a filter starts from a prior")
    mean, sigma, correlation = _moments(estimate)
    share = (1,) * len(estimate)
    if isinstance(consider, Calibration):
        if not consider.posterior.is_determined:
            raise WhiskjaxError("locate: the calibration to be considered did not determine all of its unknowns")
        considered = consider.unknowns
        more = consider.value, consider.posterior.sigma, consider.posterior.correlation
    else:
        considered, more = tuple(consider), _moments(consider)
    everything = (*estimate, *considered)
    if everything:
        sensor = admit(sensor, everything)
    k = len(mean)
    joint = np.eye(len(everything))
    joint[:k, :k], joint[k:, k:] = correlation, more[2]
    nuisance = Nuisance(
        jnp.concatenate([mean, more[0]]),
        jnp.concatenate([sigma, more[1]]),
        jnp.asarray(joint),
        (*share, *(0,) * len(considered)),
        tuple(x.name for x in everything),
        tuple(x.places for x in everything),
    )
    return sensor, nuisance


def _moments(unknowns: Sequence[Unknown]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mean = np.array([x.mean for x in unknowns], dtype=float)
    return mean, np.array([x.sigma for x in unknowns], dtype=float), np.eye(len(unknowns))
