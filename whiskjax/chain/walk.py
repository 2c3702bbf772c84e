"""Every time within a window when a point crosses the detector line.

A scan mirror with flyback sees the ground again and again, a strip flown in turbulence may go back over it: the ends of the
window say little. So the window is walked through from one recorded sample to the next, between which everything moves evenly,
and each change of sign is looked into. Far from the line it walks in strides that the rates of the chain cannot turn into a
crossing.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..algebra.vectors import Component, Vec3, norm
from ..rules import first_failure
from ..rules.results import is_successful
from .bracket import CLOSE, MOST_STEPS, Bracket, between
from .imaging import finite, into_camera
from .knots import take
from .link import Moves
from .sensor import Sensor
from .shot import Shot

# A stride is this share of what the recorded rates allow, for what is not recorded: corrections in time, lever arms, curved
# detectors, splines that overshoot.
_SHARE = 0.5
# However dense the samples are, no more steps than that.
_SHORTEST = 1e-7


# What a crossing is worth: one in front of the camera, on the detector, while the chain is recorded; any other. While a link
# leaps from one sample to the next nothing is seen: nobody knows when, and no line was recorded.
SEEN, BESIDE, NOTHING = 2, 1, 0


class Crossings(NamedTuple):
    """What a walk finds, for each point: the worth of its best crossings, how many there are, and the time of the first of them.

    `is_lost`: whether there is a change of sign at which no crossing was found.
    """

    worth: Int[Array, "..."]
    count: Int[Array, "..."]
    time_s: Component
    is_lost: Bool[Array, "..."]


class _Walk(NamedTuple):
    """Where each point's walk is: at a time, with the miss there and the next stop; or closing a bracket behind that time."""

    t: Component
    miss: Component
    stop: Component
    bracket: Bracket
    is_closing: Bool[Array, "..."]
    is_done: Bool[Array, "..."]
    found: Crossings


def crossings(
    sensor: Sensor,
    shot: Shot,
    point: Vec3,
    start_s: Component,
    stop_s: Component,
    clip: bool,
    leave: Bool[Array, "..."] | bool = False,
) -> Crossings:
    """Walk through the windows of all points at once.

    **Arguments:** `start_s`, `stop_s`: of the full batch shape; `clip`: count what falls on the detector alone; `leave`: points
    that are not asked.
    """
    moves = sensor.moves(shot)

    def step(now: _Walk) -> _Walk:
        t = jnp.where(now.is_closing, now.bracket.look, now.stop)
        at = dataclasses.replace(shot, time_s=t)
        camera = sensor.camera_at(at)
        q = into_camera(sensor, at, point)
        miss = camera.miss(q)
        is_close, was_close = jnp.abs(miss) <= CLOSE, jnp.abs(now.miss) <= CLOSE
        # From one rear half to the other the miss jumps from one infinity to the other, which is no crossing.
        behind = (jnp.abs(miss) > 1) & (jnp.abs(now.miss) > 1)
        opens = ~now.is_closing & (now.miss * miss < 0) & ~is_close & ~was_close & ~behind
        arrives = ~now.is_done & is_close & (now.is_closing | ~was_close)
        gives_up = now.is_closing & ~is_close & ~(now.bracket.steps < MOST_STEPS)
        pixel = camera.pixel(q)
        is_seen = is_successful(first_failure(sensor.check(at), camera.check_direction(q), finite(*pixel)))
        if clip:
            is_seen = is_seen & camera.sees(pixel)
        worth = jnp.where(arrives & ~_leaps(moves, t), jnp.where(is_seen, SEEN, BESIDE), NOTHING)
        better, as_good = worth > now.found.worth, arrives & (worth == now.found.worth)
        found = Crossings(
            jnp.maximum(worth, now.found.worth).astype(jnp.int32),
            jnp.where(better, 1, now.found.count + as_good.astype(jnp.int32)),
            jnp.where(better, t, now.found.time_s),
            now.found.is_lost | (gives_up & (jnp.abs(miss) < 1)),
        )

        def pick(closing: Component, walking: Component) -> Component:
            return jnp.where(now.is_closing, closing, walking)

        is_closing = pick(~is_close & ~gives_up, opens)
        reached = pick(now.t, t)
        bracket = jax.tree.map(pick, now.bracket.closed(t, miss), between(now.t, now.miss, t, miss, 0 * now.bracket.steps))
        following = pick(now.stop, jnp.minimum(_next_stop(moves, t, miss, norm(q), stop_s - start_s), stop_s))
        new = _Walk(reached, pick(now.miss, miss), following, bracket, is_closing, ~is_closing & ~(reached < stop_s), found)
        return jax.tree.map(lambda old, new: jnp.where(now.is_done, old, new), now, new)

    zero = jnp.zeros_like(start_s)
    no, none = zero.astype(bool), zero.astype(jnp.int32)
    nowhere = between(start_s, zero, start_s, zero, none)
    first = _Walk(start_s, zero + jnp.nan, start_s, nowhere, no, no | leave, Crossings(none, none, start_s, no))
    return jax.lax.while_loop(lambda now: ~jnp.all(now.is_done), step, first).found


def _next_stop(moves: Moves, t: Component, miss: Component, distance: Component, window_s: Component) -> Component:
    """The next recorded sample; or, further on, where the point can at the earliest be on the line."""
    sample = jnp.full_like(t, jnp.inf)
    for record in moves.recorded:
        sample = jnp.minimum(sample, record.knots.next_after(t + record.delay_s) - record.delay_s)
    # While the platform makes a third of the way to the point, its motion turns the direction at most half as fast again.
    rate = moves.turn_radps + 1.5 * moves.speed_mps / distance
    stride = _SHARE * 2 * jnp.arctan(jnp.abs(miss)) / jnp.maximum(rate, 1e-12)
    stride = jnp.minimum(stride, distance / (3 * jnp.maximum(moves.speed_mps, 1e-12)))
    following = jnp.maximum(jnp.maximum(sample, t + stride), t + _SHORTEST * window_s)
    return jnp.where(jnp.isfinite(miss), following, jnp.inf)


def _leaps(moves: Moves, t: Component) -> Bool[Array, "..."]:
    """Whether some link leaps at these times."""
    found = jnp.zeros(t.shape, dtype=bool)
    for record in moves.recorded:
        if record.leaps is not None:
            found = found | take(record.leaps, record.knots.locate(t + record.delay_s)[0])
    return found
