"""What a state says about a look: where the target is imaged, how that follows the state, and how noisy it is.

Elementwise, so that a filter asks for one look after the other and a batch for all at once.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component, Mat3, Vec2, Vec3, add, dot, mul, scale, vadd
from ..chain.joints import joint_derivatives
from ..chain.records import Records
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..chain.turn import Readings
from ..estimate.errors import FrameErrors
from ..rules.results import is_successful
from .noise import variance_px2
from .nuisance import Nuisance
from .remembered import Remembered
from .update import Rows, State


class Expected(NamedTuple):
    """A look beside a state, in sigmas of the pixel: residual measured - predicted, its derivatives by the state, the covariance
    (r00, r01, r11) of its noise, and whether it counts: it was measured, and the target is in front of the camera. One that does
    not count has residual and derivatives zero. `effects`: what a sigma of each remembered error does to the pixel of the
    recorded pose, where the state holds none of them."""

    residual: Vec2
    rows: Rows
    noise: Vec3
    counts: Bool[Array, "..."]
    effects: Rows = ((), ())


class Model(eqx.Module):
    """The looks at a target, ready to be compared with states: (x, y, z) from the anchor, velocity if it moves, nuisances, and
    behind them, for a filter, the errors that looks have in common.

    Axes are those of the world. `sensor` is made ready and `shots` carry the poses; `step_s` is the time since the look before,
    `since_s` that since the last look of all (not positive), `density` the wander of the velocity: None where the target stands.
    """

    sensor: Sensor
    shots: Shot
    pixel_px: Vec2
    sigma_px: Vec2
    errors: tuple[FrameErrors, ...]
    turned: tuple[Mat3 | None, ...]  # of errors in level axes, into the frame's
    remembered: Remembered
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

    @property
    def size(self) -> int:
        """How many numbers the state has without remembered errors."""
        return self.kinematic + len(self.nuisance.share)

    def expect(self, state: State) -> Expected:
        """Compare the looks with a state at their time; one without remembered errors takes them for zero."""
        u, z = state[self.kinematic : self.size], state[self.size :]
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
        effects = self.remembered.effects(swept, self.turned)
        effects = scale(weight[0], tuple(x for x, _ in effects)), scale(weight[1], tuple(y for _, y in effects))
        # The recorded pose is off by the error, and so is the pixel that it predicts: the true one lies the other way.
        by_errors = tuple(scale(-1, e) for e in effects) if z else ((), ())
        if z:
            residual = tuple(add(r, dot(e, z)) for r, e in zip(residual, effects, strict=True))
        each = zip(weight, by_point, (x, y), by_errors, strict=True)
        rows: Any = tuple((*scale(w, (*row, *still, *more)), *last) for w, row, more, last in each)
        r00, r01, r11 = variance_px2(self.errors, self.turned, swept)
        (a, b), one = weight, jnp.ones(())
        noise = add(one, mul(a, mul(a, r00))), mul(a, mul(b, r01)), add(one, mul(b, mul(b, r11)))
        return Expected(residual, rows, noise, counts, ((), ()) if z else effects)

    def split(self) -> tuple["Model", "Model"]:
        """What each look has of its own (arrays whose first axis is the looks), and what all share; `eqx.combine` joins them."""
        own = self.shots, self.pixel_px, self.sigma_px, self.errors, self.turned, self.remembered, self.step_s, self.since_s
        series = jax.tree.map(_is_series, own)
        aligned = jax.tree.map(_aligned, self.sensor, is_leaf=lambda node: isinstance(node, _ALIGNED))
        shots, pixel, sigma, errors, turned, remembered, step, since = series
        shared: Any = False  # of what the looks share, nothing is their own
        looks = Model(aligned, shots, pixel, sigma, errors, turned, remembered, shared, shared, step, since, shared)
        return eqx.partition(self, looks)


_ALIGNED = (Records, Readings)


def _is_series(leaf: Any) -> bool:
    return eqx.is_array(leaf) and leaf.ndim > 0


def _aligned(node: Any) -> Any:
    """Records and readings are aligned with the looks; whatever else a live link holds is not."""
    return jax.tree.map(_is_series, node) if isinstance(node, _ALIGNED) else False
