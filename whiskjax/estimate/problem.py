"""A calibration as numbers: groups of observations that image through the same options, and whitened residuals.

Unknowns are whitened, value = mean + scale * u, so that the identity damping of Levenberg-Marquardt fits all of them.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..algebra.vectors import Component, Vec2, Vec3, add, mul
from ..chain.bake import bake
from ..chain.imaging import image
from ..chain.parameters import Parameters
from ..chain.sensor import Sensor
from ..chain.shot import KEYS, Shot
from ..rules import WhiskjaxError, arrays_of, is_traced
from ..rules.sizes import rounded
from .given import Knowledge, given, posed
from .losses import AbstractLoss
from .observations import Observations
from .surveys import Shared


class Group(eqx.Module):
    """Observations that are imaged by the same code; keys that are Python ints choose links and cameras before tracing.

    `weight` is the lower triangle (w00, w10, w11) that whitens the residual; zero for padding, so that the number of observations
    is not part of what is compiled. A group of check points `decides` nothing: normal equations pass it by.
    """

    shot: Shot
    point: Vec3
    pixel: Vec2
    weight: tuple[Component, ...]
    decides: bool = eqx.field(static=True, default=True)

    def whiten(self, x: Component, y: Component) -> Vec2:
        """The lower triangle of the weights applied to a pair in pixels: a residual, or derivatives of it."""
        w00, w10, w11 = self.weight
        return mul(w00, x), add(mul(w10, x), mul(w11, y))


class Problem(eqx.Module):
    """Everything that a solver needs, as a pytree; `shared` where several rays see one point, whose survey error is one."""

    sensor: Sensor
    groups: tuple[Group, ...]
    unknowns: Parameters
    loss: AbstractLoss | None
    shared: Shared | None = None

    def baked(self) -> "Problem":
        """The same problem with every other link already evaluated; one sensor serves all groups."""
        sensor, groups = self.sensor, []
        for group in self.groups:
            sensor, shot = bake(self.sensor, group.shot, self.unknowns.links)
            groups.append(dataclasses.replace(group, shot=shot))
        return dataclasses.replace(self, sensor=sensor, groups=tuple(groups))

    @property
    def size(self) -> int:
        """How many observations there are, padding included."""
        return sum(len(group.pixel[0]) for group in self.groups)

    def put(self, u: Float[Array, " unknowns"]) -> Sensor:
        """The sensor with whitened unknowns put in."""
        return self.unknowns.put(self.sensor, u)


def residual(group: Group, sensor: Sensor) -> Vec2:
    """Whitened residual measured - projected of a group, as components."""
    x, y = image(sensor, group.shot, group.point)
    return group.whiten(group.pixel[0] - x, group.pixel[1] - y)


@eqx.filter_jit  # a solver asks for it in several places: trace it once
def residuals(u: Float[Array, " unknowns"], problem: Problem) -> tuple[list[Vec2], Float[Array, " unknowns"]]:
    """All whitened residuals of a baked problem: observations, under the robust loss, and priors."""
    sensor = problem.put(u)
    observed = [residual(group, sensor) for group in problem.groups]
    if problem.shared is not None:
        observed = problem.shared.independent(observed)
    if problem.loss is not None:
        factors = [problem.loss.factor(x * x + y * y) for x, y in observed]
        observed = [(f * x, f * y) for f, (x, y) in zip(factors, observed, strict=True)]
    return observed, problem.unknowns.root @ u


class Layout(NamedTuple):
    """Which observations are imaged by the same code: for each group the keys that are chosen before tracing, whether it decides,
    and its observations, int32 in bytes, so that a layout can be static. `point`: which point each observation sees, where the
    errors of points count and are known to be one."""

    groups: tuple[tuple[tuple[tuple[str, int], ...], bool, bytes], ...]
    point: bytes | None = None

    @classmethod
    def of(cls, sensor: Sensor, observations: Observations, split: bool) -> "Layout":
        """One group for each swing, view and image that the sensor tells apart, check points by themselves; or one for all.

        **Raises:** `WhiskjaxError` where the observations lack a key that the sensor tells apart.
        """
        told_apart = sensor.key_names()
        for key in told_apart if split else ():
            if observations.key(key) is None:
                raise WhiskjaxError(f"the sensor tells its {key}s apart, but the observations carry no {key}")
        choosing = [key for key in KEYS if split and key in told_apart]
        columns = [observations.key(key) for key in choosing]
        decides = observations.is_control if split else np.ones(len(observations), dtype=bool)
        codes = np.column_stack([*columns, decides]).astype(int)
        groups = []
        for code in np.unique(codes, axis=0):
            index = np.flatnonzero((codes == code).all(axis=1)).astype(np.int32)
            keys = tuple((key, int(c)) for key, c in zip(choosing, code, strict=False))
            groups.append((keys, bool(code[-1]), index.tobytes()))
        if observations.point_covariance_m2 is None or observations.point is None or is_traced(observations.point):
            return cls(tuple(groups))
        # What check points share is nothing to those who decide.
        own = len(observations) + np.arange(len(observations))
        return cls(tuple(groups), np.where(decides, observations.point, own).astype(np.int32).tobytes())

    @property
    def indices(self) -> list[np.ndarray]:
        """The observations of each group."""
        return [np.frombuffer(index, dtype=np.int32) for *_, index in self.groups]

    def deciding(self, n: int) -> Bool[np.ndarray, " n"]:
        """Which of n observations decide."""
        return np.isin(np.arange(n), np.concatenate([i for (_, d, _), i in zip(self.groups, self.indices, strict=True) if d]))


def _groups(observations: Observations, layout: Layout) -> tuple[Group, ...]:
    groups = []
    for (keys, decides, _), index in zip(layout.groups, layout.indices, strict=True):
        padded = np.concatenate([index, np.full(rounded(len(index), 8) - len(index), index[0])])
        fields: dict[str, Any] = dict(keys)
        for key in ("time_s", *KEYS):
            if key not in fields and (value := observations.key(key)) is not None:
                fields[key] = value[padded]
        zero = np.zeros((len(padded), 3))
        columns = (_columns(a) for a in (observations.point_m[padded], observations.pixel_px[padded], zero))
        groups.append(Group(Shot(**fields), *columns, decides=decides))
    return tuple(groups)


def _columns(a: Any) -> tuple[Array, ...]:
    if is_traced(a):
        return tuple(a[:, i] for i in range(a.shape[1]))
    return tuple(np.ascontiguousarray(a.T))


def pose_problem(
    sensor: Sensor,
    observations: Observations,
    unknowns: Knowledge,
    loss: AbstractLoss | None = None,
    split: bool = True,
    layout: Layout | None = None,
) -> tuple[Problem, Float[np.ndarray, " unknowns"], list[np.ndarray]]:
    """A calibration as a `Problem`, all weights still zero.

    **Arguments:**

    - `split`: make one group for each swing, view and image that the sensor tells apart, check points by themselves. Then only
      the unknowns that act on a group are differentiated for it, which is fastest to run; one group is fastest to compile.
    - `layout`: the groups, where keys and roles are traced.

    **Returns:** the problem, the whitened start, and for each group the indices of its observations.
    """
    sensor, parameters, u = posed(sensor, given("calibrate", "unknowns", unknowns))
    sensor.refuse_aligned("calibrate")
    layout = layout or Layout.of(sensor, observations, split)
    return Problem(sensor, _groups(observations, layout), parameters, loss), u, layout.indices


def weigh(problem: Problem, weight: Float[np.ndarray, "n 3"], indices: list[np.ndarray]) -> Problem:
    """The problem with the lower triangle (w00, w10, w11) of each observation put in, zero to leave it out."""
    groups = []
    for group, index in zip(problem.groups, indices, strict=True):
        padding = ((0, group.point[0].shape[0] - len(index)), (0, 0))
        groups.append(dataclasses.replace(group, weight=_columns(arrays_of(weight).pad(weight[index], padding))))
    return dataclasses.replace(problem, groups=tuple(groups))


def by_observation(groups: Sequence[Any], indices: list[np.ndarray], n: int) -> Any:
    """Back from arrays (..., padded) of each group to one array (n, ...), a row an observation."""
    math = arrays_of(list(groups))
    rows = [math.moveaxis(math.asarray(of)[..., : len(index)], -1, 0) for of, index in zip(groups, indices, strict=True)]
    if len(rows) == 1:
        return rows[0]
    return math.concatenate(rows)[np.argsort(np.concatenate(indices))]
