"""What a state says about a look: where the target is imaged, how that follows the state, and how noisy it is.

Elementwise, so that a filter asks for one look after the other and a batch for all at once.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Mat3, Vec2, Vec3, add, mul, vadd
from ..chain.records import Records
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.sweep import sweep
from ..chain.turn import Readings
from ..rules.results import is_successful
from .noise import FrameNoise, variance_px2
from .nuisance import Nuisance
from .update import Rows, State


class Expected(NamedTuple):
    """Residual measured - predicted in px, its derivatives by the state, the covariance (r00, r01, r11) of its noise, and whether
    the look counts: it was measured, and the target is in front of the camera."""

    residual_px: Vec2
    rows: Rows
    noise_px2: Vec3
    counts: Bool[Array, "..."]


class Model(eqx.Module):
    """The looks at a target, ready to be compared with states: (x, y, z) from the anchor, velocity if it moves, nuisances.

    Axes are those of the world. `sensor` is baked and `shots` carry the poses; `step_s` is the time since the look before, `since_s`
    that since the last look of all (not positive); `density` the wander of the velocity, in the axes of the world.
    """

    sensor: Sensor
    shots: Shot
    pixel_px: Vec2
    sigma_px: Vec2
    noise: tuple[FrameNoise, ...]
    nuisance: Nuisance
    anchor_m: Vec3
    step_s: Component | None
    since_s: Component | None
    density: Mat3 | None

    @property
    def kinematic(self) -> int:
        """How many numbers of the state are the target's own: position, and velocity where it moves."""
        return 3 if self.density is None else 6

    @property
    def share(self) -> tuple[int, ...]:
        """1 for what is estimated, 0 for what is only considered."""
        return (1,) * self.kinematic + self.nuisance.share

    def expect(self, state: State) -> Expected:
        """Compare the looks with a state at their time."""
        u = state[self.kinematic :]
        sensor = self.nuisance.put(self.sensor, u)
        swept = sweep(sensor, self.shots, vadd(self.anchor_m, state[:3]))
        x, y = zip(*self.nuisance.rows(sensor, self.shots, swept, u), strict=True) if u else ((), ())
        by_point = swept.derivatives["earth"]
        still = (0,) * (self.kinematic - 3)
        missed = jnp.isnan(self.pixel_px[0]) | jnp.isnan(self.pixel_px[1])
        residual = tuple(jnp.where(missed, 0.0, z - h) for z, h in zip(self.pixel_px, swept.pixel, strict=True))
        r00, r01, r11 = variance_px2(self.noise, swept)
        noise = add(r00, mul(self.sigma_px[0], self.sigma_px[0])), r01, add(r11, mul(self.sigma_px[1], self.sigma_px[1]))
        seen = sensor.camera_at(self.shots).check_direction(swept.points[sensor.names[-1]])
        return Expected(residual, ((*by_point[0], *still, *x), (*by_point[1], *still, *y)), noise, is_successful(seen) & ~missed)

    def split(self) -> tuple["Model", "Model"]:
        """What each look has of its own (arrays whose first axis is the looks), and what all share; `eqx.combine` joins them."""
        series = jax.tree.map(_is_series, (self.shots, self.pixel_px, self.sigma_px, self.noise, self.step_s, self.since_s))
        aligned = jax.tree.map(_aligned, self.sensor, is_leaf=lambda node: isinstance(node, _ALIGNED))
        shots, pixel, sigma, noise, step, since = series
        return eqx.partition(self, Model(aligned, shots, pixel, sigma, noise, False, False, step, since, False))


_ALIGNED = (Records, Readings)


def _is_series(leaf: Any) -> bool:
    return eqx.is_array(leaf) and leaf.ndim > 0


def _aligned(node: Any) -> Any:
    """Records and readings are aligned with the looks; whatever else a live link holds is not."""
    return jax.tree.map(_is_series, node) if isinstance(node, _ALIGNED) else False
