"""From looks and a guess to a model and a prior belief."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import Component, stack, unstack
from ..chain.bake import ready
from ..chain.sensor import Sensor
from ..earth.surface import AbstractSurface
from ..estimate.errors import FrameErrors
from ..rules import RESULTS
from ..rules.results import is_successful
from .filter import Belief
from .ground import Ground
from .guess import Guess
from .looks import Looks
from .model import Model
from .motion import ConstantVelocity, in_world
from .nuisance import Nuisance
from .remembered import Remembered, levels


class Standing(NamedTuple):
    """What is known of looks before the target is: which have no measurement, which repeat an earlier one, and whether the pose
    is known; each (looks,)."""

    is_missed: Bool[Array, " looks"]
    is_repeat: Bool[Array, " looks"]
    result: RESULTS

    @property
    def is_measured(self) -> Bool[Array, " looks"]:
        """Looks that can say something."""
        return ~self.is_missed & ~self.is_repeat & is_successful(self.result)


class Problem(eqx.Module):
    """All that is given: an instrument, what it saw, and what is known beforehand. `is_repeat`: None where no look can be one;
    `ground`: where the target lies on a surface."""

    sensor: Sensor
    looks: Looks
    guess: Guess
    surface: AbstractSurface
    errors: tuple[FrameErrors, ...]
    nuisance: Nuisance
    motion: ConstantVelocity | None
    remembered: Remembered = Remembered()
    is_repeat: Bool[Array, " looks"] | None = None
    ground: Ground | None = None

    def standing(self) -> Standing:
        """Of the looks."""
        missed = self.looks.is_missed
        result = jax.tree.map(lambda code: code + jnp.zeros(missed.shape, jnp.int32), self.sensor.check(self.looks.shot))
        return Standing(missed, jnp.zeros_like(missed) if self.is_repeat is None else self.is_repeat, result)

    def pose(self) -> tuple[Model, Belief]:
        """The looks, made ready, and the belief before the first of them; both in the axes of the world, from the guess.

        A look whose pose was not recorded, or that repeats an earlier one, is as good as missed.
        """
        anchor = unstack(self.guess.point_m)
        level = self.surface.level(anchor)
        sensor, shots = ready(self.sensor, self.looks.shot, self.nuisance.numbers.links)
        to_world = as_matrix(level)
        place, spread = jnp.zeros(3), to_world @ self.guess.covariance_enu_m2 @ to_world.T
        if self.ground is not None:
            place, spread = self.ground.given(self.guess.point_m, spread)
        blocks = [spread]
        step = since = density = None
        if self.motion is not None:
            time = self.looks.shot.need("time_s", "and a target moves with the time")
            step, since = jnp.diff(time, prepend=time[:1]), time - time[-1]
            density = in_world(self.motion.acceleration_enu, level)
            blocks.append(to_world @ jnp.diag(self.motion.sigma_enu_mps**2) @ to_world.T)
        covariance = jax.scipy.linalg.block_diag(*blocks, self.nuisance.correlation)
        n = covariance.shape[0]
        mean = (*unstack(place), *(jnp.zeros(()),) * (n - 3))
        prior = Belief(mean, tuple(tuple(covariance[i, j] for j in range(n)) for i in range(n)))
        known = is_successful(self.sensor.check(self.looks.shot))
        if self.is_repeat is not None:
            known = known & ~self.is_repeat
        # The sum over a single entry takes it out; an index would be made a transposed copy of all runs under vmap.
        pixel = tuple(jnp.where(known, self.looks.pixel_px[:, i : i + 1].sum(axis=1), jnp.nan) for i in (0, 1))
        sigma = unstack(self.looks.sigma_px)
        turned = levels(self.errors, self.sensor, self.looks.shot, self.surface)
        parts = self.errors, turned, self.remembered, self.nuisance, anchor, step, since, density
        return Model(sensor, shots, pixel, sigma, *parts), prior


def as_matrix(rows: Sequence[Sequence[Component]]) -> Float[Array, "... n n"]:
    """A matrix of components, of any batch shape, as an array."""
    return jnp.stack([stack(row) for row in rows], axis=-2)
