"""Errors of recorded poses that looks have in common: constant ones, and those that wander, as states behind the target's.

A state is one component of one statement, whitened: an error in its own sigmas. From look to look it keeps phi = exp(-dt / tau)
of itself and gains 1 - phi^2 (Gelb 1974, equation 4.5-8), and it moves the pixel as the motion of its frame does (chain/joints).
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import Component, Mat3, Vec2, mul
from ..chain.joints import JointDerivatives
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..earth.surface import AbstractSurface
from ..estimate.errors import FrameErrors, unit_motion
from ..estimate.level import frame_from_level
from ..estimate.memory import FADING, WHITE, steps
from ..rules import WhiskjaxError, is_traced
from .update import Covariance, State


class Remembered(eqx.Module):
    """States of errors; every array has the looks as its axis.

    `sigma`: of each state, zero at looks for which another state of the same component stands; `keep`: phi since the look
    before, 0 for the first and where the error is drawn anew.
    """

    frames: tuple[str, ...] = eqx.field(static=True, default=())
    components: tuple[int, ...] = eqx.field(static=True, default=())
    of: tuple[int, ...] = eqx.field(static=True, default=())  # which statement
    sigma: tuple[Component, ...] = ()
    keep: tuple[Component, ...] = ()

    @property
    def size(self) -> int:
        """How many states there are."""
        return len(self.frames)

    def effects(self, swept: JointDerivatives, turned: tuple[Mat3 | None, ...]) -> tuple[Vec2, ...]:
        """What one sigma of each does to the pixel of the recorded pose, in pixels."""
        each = zip(self.frames, self.components, self.of, self.sigma, strict=True)
        moved = ((sigma, swept.follows(frame, unit_motion(k, turned[i]))) for frame, k, i, sigma in each)
        return tuple((mul(sigma, x), mul(sigma, y)) for sigma, (x, y) in moved)

    def predict(self, state: State, covariance: Covariance) -> tuple[State, Covariance]:
        """The states, the last ones of all, one look later."""
        n = len(state)
        first = n - self.size
        phi: list[Component] = [1] * first + list(self.keep)
        moved = tuple(mul(p, x) for p, x in zip(phi, state, strict=True))
        wider = [[mul(mul(phi[i], phi[j]), covariance[i][j]) for j in range(n)] for i in range(n)]
        for i in range(first, n):
            wider[i][i] = wider[i][i] + (1 - phi[i] * phi[i])
        return moved, tuple(tuple(row) for row in wider)

    def kernel(self) -> Float[Array, "states looks looks"]:
        """The correlation of each between looks: the product of phi on the way from one to the other."""
        found = []
        for keep in self.keep:
            known = keep > 0
            way, anew = jnp.cumsum(jnp.log(jnp.where(known, keep, 1.0))), jnp.cumsum(~known)
            same = anew[:, None] == anew[None, :]
            found.append(jnp.where(same, jnp.exp(-jnp.abs(way[:, None] - way[None, :])), 0.0))
        return jnp.stack(found)


def remember(errors: Sequence[FrameErrors], shot: Shot, looks: int) -> Remembered:
    """The states of statements that are not white, for looks in the order of time.

    Errors drawn anew for a key whose values come one after the other have one state, which begins anew; where a value comes back,
    as swings do, each value has a state of its own.

    **Raises:** `WhiskjaxError` where looks lack a time or a key, or a key is traced.
    """
    found: list[tuple[str, int, int, Component, Component]] = []
    for i, one in enumerate(errors):
        lasting = [k for k in one.acting if one.memory[k] != WHITE]
        if not lasting:
            continue
        time = None
        if any(one.memory[k] == FADING for k in lasting):
            time = jnp.broadcast_to(shot.need("time_s", f"by which errors of {one.frame} are forgotten"), (looks,))
        group = _groups(one, shot, looks)
        values, begins = np.unique(group), 1 + np.count_nonzero(np.diff(group))
        for k in lasting:
            if begins == len(values):
                keep = steps(one.memory[k], one.correlation_s[k], time, jnp.asarray(group), looks)
                found.append((one.frame, k, i, one.sigma[k], keep))
                continue
            keep = steps(one.memory[k], one.correlation_s[k], time, jnp.zeros(looks), looks)
            found += [(one.frame, k, i, mul(one.sigma[k], jnp.asarray(group == v, dtype=float)), keep) for v in values]
    if not found:
        return Remembered()
    frames, components, of, sigma, keep = zip(*found, strict=True)
    return Remembered(frames, components, of, sigma, keep)


def _groups(one: FrameErrors, shot: Shot, looks: int) -> np.ndarray:
    key: Any = one.key(shot)
    if is_traced(key):
        raise WhiskjaxError(
            f"locate: errors of {one.frame} are drawn anew for each {one.anew}, and that key of the looks is traced; keys are "
            "static, since they say how many states there are"
        )
    return np.broadcast_to(np.asarray(key), (looks,))


def levels(errors: Sequence[FrameErrors], sensor: Sensor, shot: Shot, surface: AbstractSurface) -> tuple[Mat3 | None, ...]:
    """Of each statement in level axes the rotation from east, north, up at its frame into the frame's axes; None for the others.

    **Raises:** `WhiskjaxError` where nobody knows what is up.
    """
    return tuple(frame_from_level(e.frame, sensor.pose(shot, e.frame), surface) if e.axes == "level" else None for e in errors)
