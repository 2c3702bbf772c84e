"""A bracket around the time when something vanishes, and how it closes.

Regula falsi with the weight of Anderson and Bjorck (1973), and a bisection where five steps have not brought the value down to a
sixteenth: Newton cycles at the kinks of linearly interpolated POS, and a strip flown in turbulence is far from a straight line.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..algebra.vectors import Component

# Searching stops where the miss (tangent of half the angle beside the line) is this small, a few 1e-5 px; one Newton step with
# the exact derivative then squares what is left.
CLOSE, MOST_STEPS, _BISECT_EVERY = 1e-9, 80, 5


class Bracket(NamedTuple):
    """Two times between which a value changes its sign, and (weighted) values there; `near` is the time of the last look."""

    far: Component
    far_value: Component
    near: Component
    near_value: Component
    before: Component  # the last value but five
    steps: Component  # looks so far, one number for all brackets or one each

    @property
    def is_close(self) -> Bool[Array, "..."]:
        """Whether the last look met zero; also where the value is no number, and nothing is to be found."""
        return ~(jnp.abs(self.near_value) > CLOSE)

    @property
    def look(self) -> Component:
        """Where to look next."""
        rise = self.near_value - self.far_value
        t = self.near - self.near_value * (self.near - self.far) / jnp.where(rise == 0, 1.0, rise)
        slow = self._looks_back & (jnp.abs(self.near_value) > self.before / 16)
        return jnp.where(slow, 0.5 * (self.far + self.near), t)

    @property
    def _looks_back(self) -> Component:
        return self.steps % _BISECT_EVERY == _BISECT_EVERY - 1

    def closed(self, t: Component, value: Component) -> "Bracket":
        """The smaller bracket, once the value at the time `look` is known."""
        other_side = value * self.near_value <= 0
        m = 1 - value / jnp.where(self.near_value == 0, 1.0, self.near_value)
        weight = jnp.where(m > 0, m, 0.5)
        return Bracket(
            jnp.where(other_side, self.near, self.far),
            jnp.where(other_side, self.near_value, weight * self.far_value),
            t,
            value,
            jnp.where(self._looks_back, jnp.abs(self.near_value), self.before),
            self.steps + 1,
        )


def between(start: Component, start_value: Component, stop: Component, stop_value: Component, steps: Component = 0) -> Bracket:
    """The bracket of two times, not looked into yet."""
    return Bracket(start, start_value, stop, stop_value, jnp.abs(stop_value), steps)


def close(value: Callable[[Component], Component], bracket: Bracket, wanted: Bool[Array, "..."]) -> Bracket:
    """Close all wanted brackets at once; those that have arrived stay."""

    def searching(bracket: Bracket) -> Bool[Array, ""]:
        return (bracket.steps < MOST_STEPS) & jnp.any(wanted & ~bracket.is_close)

    def step(bracket: Bracket) -> Bracket:
        stays = bracket.is_close
        t = jnp.where(stays, bracket.near, bracket.look)
        new = bracket.closed(t, jnp.where(stays, bracket.near_value, value(t)))
        return new._replace(far_value=jnp.where(stays, bracket.far_value, new.far_value))

    return jax.lax.while_loop(searching, step, bracket)
