"""Recorded times: which two samples surround a time, without extrapolation and without bridging gaps."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, require_x64
from ..rules.results import choose
from .part import AbstractPart
from .samples import blocks

_MOST_STEPS = 8
# Buckets that every record may have, however few its samples; 4 for each sample where that is more.
_MOST_BUCKETS = 1 << 22


def take(values: Float[Array, " n"], i: Int[Array, "..."]) -> Float[Array, "..."]:
    """values[i] for indices that are known to lie inside: no clamping, no wrapping of negative ones."""
    return values.at[i].get(mode="promise_in_bounds", wrap_negative_indices=False)


class Knots(AbstractPart):
    """Strictly increasing sample times, with a table that finds the interval of a time in a few loads.

    The span is cut into buckets about as wide as the closest samples; a bucket knows the last sample before it, and the few
    samples inside it are stepped over. POS at an even rate needs one step, where a binary search needs log2(n).
    """

    given: ClassVar = ("time_s", "buckets_per_s", "one")
    time_s: Float[Array, " n"]
    is_gap: Bool[Array, " n-1"]
    before_bucket: Int[Array, " m"]
    buckets_per_s: Float[Array, ""]
    one: Float[Array, ""]  # a number that the compiler does not know
    steps: int = eqx.field(static=True)
    max_gap_s: float = eqx.field(static=True)

    def __init__(self, time_s: Float[Numbers, " n"], max_gap_s: float, what: str):
        """**Arguments:**

        - `time_s`: strictly increasing, seconds, at least two.
        - `max_gap_s`: a longer interval is a gap, and asking for a time inside it fails.
        - `what`: whose times these are, for messages.

        **Raises:** `WhiskjaxError` naming the first sample that is not finite or not later than the one before it;
        `RuntimeError` where float64 is off.
        """
        require_x64(what)  # an epoch in float32 is wrong by minutes
        arrays = Arrays(what)
        t = np.asarray(arrays.take("time_s", time_s, "n", absolute=True, finite=True))
        if len(t) < 2:
            arrays.refuse("time_s", f"has shape {t.shape}; at least two sample times are needed to interpolate")
        arrays.take("max_gap_s", max_gap_s, "", above=0.0)
        steps = np.diff(t)
        if (steps <= 0).any():
            i = int(np.argmax(steps <= 0))
            kind = "repeats" if steps[i] == 0 else "is earlier than"
            raise WhiskjaxError(
                f"{what}: times must increase, but the time of sample {i + 1} ({t[i + 1]!r} s) {kind} that of sample {i} "
                f"({t[i]!r} s); sort the samples and remove duplicates"
            )
        span = t[-1] - t[0]
        # A little narrower than the closest samples: then a bucket holds at most one of them.
        most = min(64 * len(t), max(4 * len(t), _MOST_BUCKETS))
        buckets = int(np.clip(np.ceil(1.01 * span / steps.min()), 1, most))
        width = span / buckets
        # A hair early and a hair late, so that rounding of the bucket number can only cost a step, never skip a sample.
        hair = 1e-6 * width
        last = lambda edge: np.clip(np.searchsorted(t, edge, side="right") - 1, 0, len(t) - 2)
        before_bucket, most_inside = np.empty(buckets, dtype=np.int32), 0
        for rows in blocks(buckets):
            number = np.arange(rows.start, rows.stop)
            before = last(t[0] + number * width - hair)
            after = last(t[0] + (number + 1) * width + hair)
            before_bucket[rows] = before
            most_inside = max(most_inside, int((after - before).max()))
        self.time_s = jnp.asarray(t)
        self.is_gap = jnp.asarray(steps > max_gap_s)
        self.before_bucket = jnp.asarray(before_bucket)
        self.buckets_per_s = jnp.asarray(buckets / span)
        self.one = jnp.asarray(1.0)
        self.steps = most_inside
        self.max_gap_s = float(max_gap_s)

    def _interval(self, t: Float[Array, "..."]) -> Int[Array, "..."]:
        """Index of the sample at or before each time, of the nearest interval outside the record."""
        last = self.time_s.shape[0] - 2
        if self.steps > _MOST_STEPS:
            return jnp.clip(jnp.searchsorted(self.time_s, t, side="right").astype(jnp.int32) - 1, 0, last)
        bucket = ((t - self.time_s[0]) * self.buckets_per_s).astype(jnp.int32)
        i = take(self.before_bucket, jnp.clip(bucket, 0, self.before_bucket.shape[0] - 1))
        for _ in range(self.steps):
            i = jnp.minimum(i + (take(self.time_s, i + 1) <= t).astype(jnp.int32), last)
        # XLA on the CPU repeats the whole search in each of the gathers that use the index (an optimization barrier does not stop
        # it), but it never repeats a division.
        return (i.astype(jnp.float64) / self.one).astype(jnp.int32)

    def locate(self, t: Float[Array, "..."]) -> tuple[Int[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
        """Index of the sample at or before each time, the fraction of the interval that has passed, and its length in seconds.

        Outside the record the nearest interval is used; `check` is what refuses such times.
        """
        i = self._interval(t)
        start = take(self.time_s, i)
        length = take(self.time_s, i + 1) - start
        return i, (t - start) / length, length

    def next_after(self, t: Float[Array, "..."]) -> Float[Array, "..."]:
        """The first sample time later than each time; infinite where the record has ended."""
        following = take(self.time_s, self._interval(t) + 1)
        return jnp.where(t < self.time_s[0], self.time_s[0], jnp.where(following > t, following, jnp.inf))

    def check(self, t: Float[Array, "..."]) -> RESULTS:
        """Whether each time can be interpolated: inside the record, and in no gap (the samples beside a gap are usable)."""
        i, w, _ = self.locate(t)
        outside = ~((t >= self.time_s[0]) & (t <= self.time_s[-1]))
        gap = take(self.is_gap, i) & (w > 0) & (w < 1)
        return choose(
            outside,
            RESULTS.time_outside_trajectory,
            choose(gap, RESULTS.time_in_gap, RESULTS.successful),
        )
