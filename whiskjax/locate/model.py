"""What a state says about a look: where the target is imaged, how that follows the state, and how noisy it is.

Elementwise, so that a filter asks for one look after the other and a batch for all at once.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Mat3, Vec2, Vec3, add, mul, scale, vadd
from ..chain.joints import joint_derivatives
from ..chain.records import Records
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.turn import Readings
from ..estimate.errors import FrameErrors
from ..rules.results import is_successful
from .noise import variance_px2
from .nuisance import Nuisance
from .update import Rows, State


class Expected(NamedTuple):
    """A look beside a state, in sigmas of the pixel: residual measured - predicted, its derivatives by the state, the covariance
    (r00, r01, r11) of its noise, and whether it counts: it was measured, and the target is in front of the camera. One that does
    not count has residual and derivatives zero."""

    residual: Vec2
    rows: Rows
    noise: Vec3
    counts: Bool[Array, "..."]


class Model(eqx.Module):
    """The looks at a target, ready to be compared with states: (x, y, z) from the anchor, velocity if it moves, nuisances.

    Axes are those of the world. `sensor` is made ready and `shots` carry the poses; `step_s` is the time since the look before,
    `since_s` that since the last look of all (not positive), `density` the wander of the velocity: None where the target stands.
    """

    sensor: Sensor
    shots: Shot
    pixel_px: Vec2
    sigma_px: Vec2
    errors: tuple[FrameErrors, ...]
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
        point = vadd(self.anchor_m, state[:3])
        swept = joint_derivatives(sensor, self.shots, point)
        x, y = zip(*self.nuisance.rows(sensor, self.shots, point, swept), strict=True) if u else ((), ())
        seen = is_successful(sensor.camera_at(self.shots).check_direction(swept.points[sensor.names[-1]]))
        missed = jnp.isnan(self.pixel_px[0]) | jnp.isnan(self.pixel_px[1])
        counts = seen & ~missed
        # Quotients, which XLA on the CPU keeps, where it would evaluate the check and the projection again at every use.
        weight = tuple(jnp.where(counts, 1.0, 0.0) / sigma for sigma in self.sigma_px)
        residual = tuple(
            jnp.where(counts, z - h, 0.0) / sigma for z, h, sigma in zip(self.pixel_px, swept.pixel, self.sigma_px, strict=True)
        )
        by_point, still = swept.derivatives["earth"], (0,) * (self.kinematic - 3)
        rows = tuple(scale(w, (*row, *still, *more)) for w, row, more in zip(weight, by_point, (x, y), strict=True))
        r00, r01, r11 = variance_px2(self.errors, swept)
        (a, b), one = weight, jnp.ones(())
        noise = add(one, mul(a, mul(a, r00))), mul(a, mul(b, r01)), add(one, mul(b, mul(b, r11)))
        return Expected(residual, rows, noise, counts)

    def split(self) -> tuple["Model", "Model"]:
        """What each look has of its own (arrays whose first axis is the looks), and what all share; `eqx.combine` joins them."""
        series = jax.tree.map(_is_series, (self.shots, self.pixel_px, self.sigma_px, self.errors, self.step_s, self.since_s))
        aligned = jax.tree.map(_aligned, self.sensor, is_leaf=lambda node: isinstance(node, _ALIGNED))
        shots, pixel, sigma, errors, step, since = series
        shared: Any = False  # of what the looks share, nothing is their own
        return eqx.partition(self, Model(aligned, shots, pixel, sigma, errors, shared, shared, step, since, shared))


_ALIGNED = (Records, Readings)


def _is_series(leaf: Any) -> bool:
    return eqx.is_array(leaf) and leaf.ndim > 0


def _aligned(node: Any) -> Any:
    """Records and readings are aligned with the looks; whatever else a live link holds is not."""
    return jax.tree.map(_is_series, node) if isinstance(node, _ALIGNED) else False
