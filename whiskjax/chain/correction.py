"""Corrections in time at a joint: bias, drift, spline, orientation images.

All are one link: a small motion (turn, shift) that is a weighted sum of coefficients, with weights that depend on time.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import IDENTITY, ZERO, Component, Vec3
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, is_traced, need
from ..rules.results import choose
from .camera import parameter
from .part import AbstractPart
from .pose import Pose
from .rotations import rotation_from_vector
from .shot import Shot
from .stations import AbstractStations, motion


class AbstractBasis(AbstractPart):
    """Weights of the coefficients as a function of time."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of coefficients."""

    @property
    def segments(self) -> tuple[int, ...]:
        """Numbers of coefficients that follow each other in time without a break."""
        return (self.size,)

    @property
    def node_s(self) -> Float[np.ndarray, " nodes"] | None:
        """The time of every coefficient, on the host; None where they belong to no times."""
        return None

    @property
    def epoch_s(self) -> Float[np.ndarray, " nodes"] | None:
        """As many times, on the host: values there determine the coefficients. None where these belong to no times."""
        return None

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
    """Two coefficients: the value at `start_s`, and the change over `span_s` (Wang et al. 2018, equation 6: a + b (t - t0))."""

    given: ClassVar = ("start_s", "span_s")
    start_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    span_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __init__(self, start_s: Float[Numbers, ""], span_s: Float[Numbers, ""]):
        """**Raises:** `WhiskjaxError` where one is no number of seconds, or the span is not positive."""
        arrays = Arrays("Drift")
        self.start_s = arrays.take("start_s", start_s, "", absolute=True, finite=True)
        self.span_s = arrays.take("span_s", span_s, "", absolute=True, finite=True, above=0.0)

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


class AbstractUniform(AbstractBasis):
    """Nodes at start_s + k * spacing_s; several segments in time, strips say, each with its own start and number of nodes.

    The coefficients of all segments follow each other in one array.
    """

    given: ClassVar = ("start_s", "spacing_s")
    start_s: Float[Array, " segments"] = eqx.field(converter=jnp.atleast_1d)
    spacing_s: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    nodes: tuple[int, ...] = eqx.field(static=True)

    def __init__(self, start_s: Float[Numbers, "*segments"], spacing_s: Float[Numbers, ""], nodes: int | Sequence[int]):
        """**Arguments:** seconds, and numbers of nodes; one start and one number of nodes for each segment.

        **Raises:** `WhiskjaxError` for fewer than four nodes, segments that overlap, and what is no such number.
        """
        arrays = Arrays(type(self).__name__)
        self.start_s = arrays.take("start_s", start_s, "segments" if np.ndim(start_s) else "", absolute=True, finite=True)
        self.spacing_s = arrays.take("spacing_s", spacing_s, "", absolute=True, finite=True, above=0.0)
        count = arrays.take_whole("nodes", nodes, "segments" if np.ndim(nodes) else "", meaning="a number of nodes")
        self.nodes = tuple(int(n) for n in np.atleast_1d(count))

    def __check_init__(self):
        if self.start_s.shape != (len(self.nodes),):
            raise WhiskjaxError(f"{self.start_s.shape[0]} starts for {len(self.nodes)} numbers of nodes: one of each a segment")
        if min(self.nodes) < 4:
            raise WhiskjaxError(f"four neighbouring coefficients act at a time, so at least 4 are needed, not {min(self.nodes)}")
        if is_traced(self.start_s) or is_traced(self.spacing_s):
            return
        start, spacing = np.asarray(self.start_s), float(self.spacing_s)
        end = start + spacing * (np.array(self.nodes) - 1)
        late = np.flatnonzero(start[1:] < end[:-1])
        if late.size:
            i = int(late[0]) + 1
            raise WhiskjaxError(
                f"segment {i} starts at {start[i]:g} s, before segment {i - 1} ends at {end[i - 1]:g} s: "
                "give the strips in the order in which they were flown"
            )

    @property
    def size(self) -> int:
        """Number of nodes of all segments."""
        return sum(self.nodes)

    @property
    def segments(self) -> tuple[int, ...]:
        """Numbers of nodes."""
        return self.nodes

    @property
    def node_s(self) -> Float[np.ndarray, " nodes"]:
        """The time of every node, on the host."""
        starts = zip(np.asarray(self.start_s), self.nodes, strict=True)
        return np.concatenate([start + float(self.spacing_s) * np.arange(n) for start, n in starts])

    @property
    @abc.abstractmethod
    def epoch_s(self) -> Float[np.ndarray, " nodes"]:
        """As many times as there are coefficients, on the host: values there determine the coefficients."""

    def _place(self, t):
        """Index of the first of the four acting nodes, the position u in [0, 1] between the middle two, and x.

        x is the number of spacings since the segment's start, and comes with the number of the segment's last node.
        """
        start, first, last = self.start_s[0], 0, self.nodes[0] - 1
        for i in range(1, len(self.nodes)):
            here = t >= self.start_s[i]
            start = jnp.where(here, self.start_s[i], start)
            first = jnp.where(here, sum(self.nodes[:i]), first)
            last = jnp.where(here, self.nodes[i] - 1, last)
        x = (t - start) / self.spacing_s
        i = jnp.clip(jnp.floor(x).astype(jnp.int32) - 1, 0, last - 3)
        return i + first, x - i.astype(x.dtype) - 1, x, last

    @abc.abstractmethod
    def _four(self, u: Component) -> tuple[Component, ...]:
        """Weights of the four neighbours."""

    def weights(self, t):
        """The four neighbours."""
        i, u, *_ = self._place(t)
        return [(i + k, w) for k, w in enumerate(self._four(u))]


class OrientationImages(AbstractUniform):
    """Corrections at orientation images, interpolated by the cubic through the four nearest (Lagrange weights, Wang et al. 2018).

    Node k lies at start_s + k * spacing_s; the first and last intervals use the cubic of the nearest four nodes.
    """

    @property
    def epoch_s(self):
        """The orientation images."""
        return self.node_s

    def _four(self, u):
        a, b, c, d = u + 1, u, u - 1, u - 2
        return -b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6

    def check(self, t) -> RESULTS:
        """From the first to the last orientation image."""
        *_, x, last = self._place(t)
        inside = (x >= 0) & (x <= last)
        return choose(inside, RESULTS.successful, RESULTS.time_outside_trajectory)


class Spline(AbstractUniform):
    """Uniform cubic B-spline: coefficient k belongs to start_s + k * spacing_s, and the second derivative is continuous.

    Reaches from the second node to the last but one.
    """

    @property
    def epoch_s(self):
        """The inner nodes, and the middle of the first and the last interval between them."""
        parts, ends = [], np.cumsum(self.nodes)
        for t in np.split(self.node_s, ends[:-1]):
            middle = 0.5 * (t[1] + t[2]), 0.5 * (t[-3] + t[-2])
            parts.append(
                np.sort(np.concatenate([t[1:-1], middle if len(t) > 4 else [t[1] + (t[2] - t[1]) * f for f in (1 / 3, 2 / 3)]]))
            )
        return np.concatenate(parts)

    def _four(self, u):
        v = 1 - u
        return v * v * v / 6, (4 - 3 * u * u * (2 - u)) / 6, (4 - 3 * v * v * (2 - v)) / 6, u * u * u / 6

    def check(self, t) -> RESULTS:
        """From the second to the last but one coefficient."""
        *_, x, last = self._place(t)
        inside = (x >= 1) & (x <= last - 1)
        return choose(inside, RESULTS.successful, RESULTS.time_outside_trajectory)


class Correction(AbstractStations):
    """A small motion of the joint it stands at, varying in time: p_outer = exp([turn(t)]x) p_inner + shift(t).

    `turn_rad` and `shift_m` are the coefficients of the basis, (k, 3) each; None is exactly zero.
    """

    basis: AbstractBasis
    turn_rad: Float[Array, "k 3"] | None = eqx.field(converter=parameter)
    shift_m: Float[Array, "k 3"] | None = eqx.field(converter=parameter)

    def __init__(
        self,
        basis: AbstractBasis,
        turn_rad: Float[Numbers, "k 3"] | None = None,
        shift_m: Float[Numbers, "k 3"] | None = None,
    ):
        """**Raises:** `WhiskjaxError` where there is not a row for each coefficient, or turns are in degrees."""
        need("Correction", "basis", basis, AbstractBasis, "Bias(), Spline(...) or another")
        arrays, shape = Arrays("Correction"), f"{basis.size} 3"
        row = "one row for each coefficient"
        self.basis = basis
        self.turn_rad = arrays.take("turn_rad", turn_rad, shape, optional=True, finite=True, within_rad=2 * np.pi, meaning=row)
        self.shift_m = arrays.take("shift_m", shift_m, shape, optional=True, finite=True, meaning=row)

    @property
    def stations(self) -> int:
        """Number of coefficients."""
        return self.basis.size

    @property
    def segments(self) -> tuple[int, ...]:
        """Those of the basis."""
        return self.basis.segments

    @property
    def node_s(self) -> Float[np.ndarray, " stations"] | None:
        """Those of the basis."""
        return self.basis.node_s

    @property
    def epoch_s(self) -> Float[np.ndarray, " stations"] | None:
        """Those of the basis."""
        return self.basis.epoch_s

    @property
    def motions(self) -> tuple[Float[Array, "stations 3"] | None, Float[Array, "stations 3"] | None]:
        """`turn_rad` and `shift_m`."""
        return self.turn_rad, self.shift_m

    @property
    def is_timed(self) -> bool:
        """Yes."""
        return True

    def acting(self, shot: Shot) -> list[tuple[Component, Component]]:
        """The coefficients that act at each shot's time."""
        return self.basis.weights(shot.need("time_s", "which a correction needs"))

    def moved(self, shot: Shot, turn: Vec3, shift: Vec3) -> Pose:
        """The pose exp([turn]x), shift."""
        return Pose(IDENTITY if turn is ZERO else rotation_from_vector(turn), shift)

    def pose(self, shot: Shot) -> Pose:
        """The correction at each shot's time."""
        return self.moved(shot, *motion(self, shot))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the basis reaches the shot's time."""
        return self.basis.check(shot.need("time_s", "which a correction needs"))
