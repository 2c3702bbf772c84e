"""Corrections in time at a joint: bias, drift, spline, orientation images.

All are one link: a small motion (turn, shift) that is a weighted sum of coefficients, with weights that depend on time.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..algebra.vectors import IDENTITY, ZERO, Component, Vec3
from ..rules import RESULTS, WhiskjaxError
from ..rules.results import choose
from .camera import parameter
from .link import AbstractLink
from .pose import Pose
from .rotations import rotation_from_vector
from .shot import Shot


class AbstractBasis(eqx.Module):
    """Weights of the coefficients as a function of time."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of coefficients."""

    @abc.abstractmethod
    def weights(self, t: Component) -> list[tuple[Component, Component]]:
        """Pairs (coefficient index, weight) that act at each time."""

    @abc.abstractmethod
    def check(self, t: Component) -> RESULTS:
        """Whether the basis reaches each time."""


class Bias(AbstractBasis):
    """One coefficient, the same at all times."""

    @property
    def size(self) -> int:
        """One."""
        return 1

    def weights(self, t):
        """Weight one."""
        return [(0, 1)]

    def check(self, t) -> RESULTS:
        """Everywhere."""
        return RESULTS.successful


class Drift(AbstractBasis):
    """Two coefficients: the value at `start_s`, and the change over `span_s` (paper 001, equation 6: a + b (t - t0))."""

    start_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    span_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    @property
    def size(self) -> int:
        """Two."""
        return 2

    def weights(self, t):
        """One, and the share of the span that has passed."""
        return [(0, 1), (1, (t - self.start_s) / self.span_s)]

    def check(self, t) -> RESULTS:
        """Everywhere: a drift is a line."""
        return RESULTS.successful


class _Uniform(AbstractBasis):
    """Nodes at start_s + k * spacing_s."""

    start_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    spacing_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    nodes: int = eqx.field(static=True)

    def __check_init__(self):
        if self.nodes < 4:
            raise WhiskjaxError(f"four neighbouring coefficients act at a time, so at least 4 are needed, not {self.nodes}")

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.nodes

    def _place(self, t):
        """Index of the first of the four acting nodes, and the position u in [0, 1] between the middle two."""
        x = (t - self.start_s) / self.spacing_s
        i = jnp.clip(jnp.floor(x).astype(jnp.int32) - 1, 0, self.nodes - 4)
        return i, x - i.astype(x.dtype) - 1

    @abc.abstractmethod
    def _four(self, u: Component) -> tuple[Component, ...]:
        """Weights of the four neighbours."""

    def weights(self, t):
        """The four neighbours."""
        i, u = self._place(t)
        return [(i + k, w) for k, w in enumerate(self._four(u))]


class OrientationImages(_Uniform):
    """Corrections at orientation images, interpolated by the cubic through the four nearest (Lagrange weights, paper 001).

    Node k lies at start_s + k * spacing_s; the first and last intervals use the cubic of the nearest four nodes.
    """

    def _four(self, u):
        a, b, c, d = u + 1, u, u - 1, u - 2
        return -b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6

    def check(self, t) -> RESULTS:
        """From the first to the last orientation image."""
        x = (t - self.start_s) / self.spacing_s
        inside = (x >= 0) & (x <= self.nodes - 1)
        return choose(inside, RESULTS.successful, RESULTS.time_outside_trajectory)


class Spline(_Uniform):
    """Uniform cubic B-spline: coefficient k belongs to start_s + k * spacing_s, and the second derivative is continuous.

    Reaches from the second node to the last but one.
    """

    def _four(self, u):
        v = 1 - u
        return v * v * v / 6, (4 - 3 * u * u * (2 - u)) / 6, (4 - 3 * v * v * (2 - v)) / 6, u * u * u / 6

    def check(self, t) -> RESULTS:
        """From the second to the last but one coefficient."""
        x = (t - self.start_s) / self.spacing_s
        inside = (x >= 1) & (x <= self.nodes - 2)
        return choose(inside, RESULTS.successful, RESULTS.time_outside_trajectory)


class Correction(AbstractLink):
    """A small motion of the joint it stands at, varying in time: p_outer = exp([turn(t)]x) p_inner + shift(t).

    `turn_rad` and `shift_m` are the coefficients of the basis, (k, 3) each; None is exactly zero.
    """

    basis: AbstractBasis
    turn_rad: Float[Array, "k 3"] | None = eqx.field(default=None, converter=parameter)
    shift_m: Float[Array, "k 3"] | None = eqx.field(default=None, converter=parameter)

    def __check_init__(self):
        for name, c in (("turn_rad", self.turn_rad), ("shift_m", self.shift_m)):
            if c is not None and c.shape != (self.basis.size, 3):
                raise WhiskjaxError(f"{name} has shape {c.shape}, expected ({self.basis.size}, 3): one row for each coefficient")

    def _sum(self, coefficients: Float[Array, "k 3"], t: Component) -> Vec3:
        terms = self.basis.weights(t)
        return tuple(sum(w * coefficients[:, axis][i] for i, w in terms) for axis in range(3))

    def pose(self, shot: Shot) -> Pose:
        """The correction at each shot's time."""
        t = shot.need("time_s", "which a correction needs")
        rotation = IDENTITY if self.turn_rad is None else rotation_from_vector(self._sum(self.turn_rad, t))
        return Pose(rotation, ZERO if self.shift_m is None else self._sum(self.shift_m, t))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the basis reaches the shot's time."""
        return self.basis.check(shot.need("time_s", "which a correction needs"))
