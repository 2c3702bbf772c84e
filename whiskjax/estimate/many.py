"""Thousands of calibrations in one call, through the same chain as one.

A lane is a calibration: `prepare` and Gauss-Newton steps of the same core, traced, in small chunks (a Levenberg-Marquardt under
vmap runs to its slowest lane and pays for both of its branches), shares of them side by side on all cores. Runs are read, solved
and forgotten share by share, so that memory does not grow with their number.
"""

import dataclasses
import itertools
import math
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..algebra.vectors import stack
from ..chain.extremes import MOST, refuse_extremes
from ..chain.sensor import Sensor
from ..chain.shot import KEYS
from ..rules import RESULTS, Arrays, SensorError, WhiskjaxError, first_failure, need, require_x64
from ..rules.progress import tell
from ..rules.results import codes_of
from .calibration import WORDS
from .checks import CHECKS
from .estimate import Estimate
from .evidence import Evidence
from .given import Given, Knowledge, given, posed
from .lanes import Lanes, solve_lane
from .linearised import LeastSquares, impossible, pixels, prepare, refuse
from .model_test import consistency
from .observations import Observations
from .problem import Layout, Problem, by_observation
from .reason import FAILURE, grades
from .unknown import Unknown

_SHARE = 250  # lanes in one compiled call: fewer pay for the call, more leave a core idle at the end


class Batch(eqx.Module):
    """Calibrations in the order of their runs; residuals measured - projected in pixels, before and after, (runs, n, 2).

    Every array of `estimate` has a leading axis of runs; `jax.tree.map(lambda a: a[i], batch.estimate)` is the answer of one run.
    Where its `result` is not a success the numbers of a run are not to be used.
    """

    estimate: Estimate
    unknowns: tuple[Unknown, ...]
    residual_before_px: Float[np.ndarray, "runs n 2"]
    residual_after_px: Float[np.ndarray, "runs n 2"]

    @property
    def value(self) -> Float[np.ndarray, "runs k"]:
        """Of the unknowns."""
        return self.estimate.value

    @property
    def result(self) -> RESULTS:
        """How each run ended."""
        return self.estimate.result

    @property
    def is_successful(self) -> np.ndarray:
        """Which runs ended well, (runs,)."""
        return codes_of(self.result) == 0

    @cached_property
    def grades(self) -> dict[str, Int[np.ndarray, " runs"]]:
        """The grade that each check gives each run: 0 nothing to say, 1 note, 2 caution, 3 failure.

        Checks of the estimate alone: how it ended, consistency, correlations, priors. What asks for measurements one by one is
        told by `calibrate` of that run.
        """
        mean, sigma = (
            jnp.asarray([math.nan if number is None else number for number in numbers], dtype=float)
            for numbers in ([x.mean for x in self.unknowns], [x.sigma for x in self.unknowns])
        )

        def of(estimate: Estimate) -> dict[str, Array]:
            factor, tail, _ = consistency(estimate.cost, estimate.freedom)
            shift, everyone = (estimate.value - mean) / sigma, np.ones(len(self.unknowns), dtype=bool)
            return grades(CHECKS, Evidence(estimate, everyone, shift, factor, estimate.freedom, tail, WORDS))

        return jax.tree.map(lambda a: np.broadcast_to(a, len(self.value)), jax.jit(jax.vmap(of))(self.estimate))

    @property
    def is_sound(self) -> Bool[np.ndarray, " runs"]:
        """Which runs no check of the estimate fails."""
        return np.max(list(self.grades.values()), axis=0) < FAILURE


class _Solved(NamedTuple):
    """Lanes, and their residuals by observation."""

    estimate: Estimate
    before_px: Float[Any, "lanes n 2"]
    after_px: Float[Any, "lanes n 2"]


def _answered(ready: LeastSquares, lanes: Lanes, deciding: int) -> _Solved:
    """One lane; its result is the worst code of any observation where it starts, or how it ended."""
    numbers, n = ready.problem.unknowns, len(ready.observations)
    after = by_observation([jnp.stack(pair) for pair in lanes.residual_px], ready.indices, n)
    unseen = jnp.asarray(ready.unseen).max().astype(jnp.int32)
    result = first_failure(jax.tree.map(lambda _: unseen, RESULTS.successful), lanes.result)
    has_prior = (numbers.root != 0).any(axis=1)
    estimate = Estimate(
        value=numbers.value(lanes.u),
        covariance=lanes.covariance * jnp.outer(numbers.scale, numbers.scale),
        prior_share=jnp.where(has_prior, lanes.covariance.diagonal(), jnp.nan),
        cost=lanes.cost,
        freedom=2 * deciding + has_prior.sum() - len(numbers.names),
        result=result,
        names=numbers.names,
        places=numbers.places,
    )
    return _Solved(estimate, jnp.asarray(ready.before_px), after)


def _prepared(sensor: Sensor, observations: Observations, priors: Given, layout: Layout) -> tuple[LeastSquares, int]:
    """A lane ready to be solved, its problem that of the observations that decide, and how many do."""
    ready, used = prepare(sensor, observations, priors, None, layout=layout), layout.deciding(len(observations))
    return dataclasses.replace(ready, problem=ready.deciding(used)), int(used.sum())


@eqx.filter_jit
def _solve_runs(own: Any, common: Any, priors: Given, layout: Layout, steps: int, chunk: int) -> _Solved:
    def lane(own: Any) -> _Solved:
        sensor, observations = eqx.combine(own, common)
        ready, deciding = _prepared(sensor, observations, priors, layout)
        return _answered(ready, solve_lane(ready.problem, ready.start, steps), deciding)

    return jax.lax.map(lane, own, batch_size=chunk)


@eqx.filter_jit
def _solve_redrawn(
    pixel_px: Float[Array, "runs n 2"],
    sensor: Sensor,
    observations: Observations,
    priors: Given,
    layout: Layout,
    steps: int,
    chunk: int,
) -> _Solved:
    ready, deciding = _prepared(sensor, observations, priors, layout)

    def lane(pixel: Array) -> _Solved:
        drawn = ready.drawn_anew(pixel)
        return _answered(drawn, solve_lane(drawn.problem, drawn.start, steps), deciding)

    return jax.lax.map(lane, pixel_px, batch_size=chunk)


def calibrate_batch(
    runs: Iterable[tuple[Sensor, Observations]], unknowns: Knowledge, *, steps: int = 6, chunk: int = 10
) -> Batch:
    """Calibrate every run: other seeds, other truths, other flights, of one instrument and one layout of points.

    The same estimate as `calibrate`, to 1e-8 of a prior sigma, without its diagnosis.

    **Arguments:**

    - `runs`: (sensor, observations) of each run; may be a generator, and then no more than some hundreds are held at a time. All
      have the same chain, and the same sequence of images and roles (control, check) among their observations, of which the same
      see one point.
    - `unknowns`: the same for all runs.
    - `steps`, `chunk`: see `solve_lanes`.

    **Returns:** `Batch`.

    **Raises:** `WhiskjaxError` where there is no run, or one of another shape than the first, by its number.
    """
    require_x64("calibrate_batch")
    priors = given("calibrate_batch", "unknowns", unknowns)
    need("calibrate_batch", "runs", runs, Iterable, "pairs (sensor, observations)")
    _ask_whole("calibrate_batch", steps, chunk)

    def shares() -> Iterator[tuple[int, Callable[[], _Solved]]]:
        count, first, varying = 0, None, set()
        runs_left = iter(runs)
        while share := list(itertools.islice(runs_left, _SHARE)):
            columns = []
            for number, pair in enumerate(share, start=count):
                sensor, observations = _run(number, pair)
                if first is None:
                    refuse_extremes(sensor, "calibrate")
                    posed(sensor, priors)  # refuses what makes no sense while numbers are known
                    first = _First.of(sensor, observations, priors)
                columns.append(first.leaves_of(number, sensor, observations))
            assert first is not None
            count += len(share)
            # Numbers that all runs share are not copied for each, and let XLA see that a condition on them is common.
            rows = list(zip(*columns, strict=True))
            varying |= {i for i, row in enumerate(rows) if any(leaf is not row[0] for leaf in row)}
            if not varying:  # runs that are one and the same are lanes all the same
                varying.add(next(i for i, row in enumerate(rows) if isinstance(row[0], jax.Array | np.ndarray)))
            # A shorter share is filled up, so that nothing is compiled for its length.
            fill = np.minimum(np.arange(-(-_SHARE // chunk) * chunk), len(share) - 1)
            stacked = [np.stack([np.asarray(leaf) for leaf in row])[fill] if i in varying else None for i, row in enumerate(rows)]
            if any(_is_extreme(leaf) for leaf in stacked):
                for sensor, _ in share:
                    refuse_extremes(sensor, "calibrate")
            own = [None if leaf is None else jnp.asarray(leaf) for leaf in stacked]
            common = [None if i in varying else _on_device(row[0]) for i, row in enumerate(rows)]
            trees = (jax.tree.unflatten(first.structure, leaves) for leaves in (own, common))
            yield len(share), partial(_solve_runs, *trees, first.priors, first.layout, steps, chunk)

    return _gather(shares(), priors)


def calibrate_redrawn(
    sensor: Sensor,
    observations: Observations,
    unknowns: Knowledge,
    pixel_px: Float[np.ndarray, "runs n 2"],
    *,
    steps: int = 6,
    chunk: int = 10,
) -> Batch:
    """Calibrate one flight again and again, with other image measurements: new noise, or images of other truths.

    Only the measurements differ between lanes, so that ten thousand runs take about a second.

    **Arguments:** as `calibrate_batch`; `pixel_px`: the measurements of each run in place of those of `observations`.

    **Raises:** `WhiskjaxError` where the shape does not fit; `SensorError` naming an observation that cannot be imaged.
    """
    require_x64("calibrate_redrawn")
    priors = _ask("calibrate_redrawn", sensor, observations, unknowns)
    _ask_whole("calibrate_redrawn", steps, chunk)
    arrays = Arrays("calibrate_redrawn")
    pixel_px = np.asarray(arrays.take("pixel_px", pixel_px, f"runs {len(observations)} 2", finite=True))
    if len(pixel_px) == 0:
        arrays.refuse("pixel_px", f"has shape {pixel_px.shape}, expected (runs, {len(observations)}, 2) of at least one run")
    _run(0, (sensor, observations))
    refuse(prepare(sensor, observations, priors, None).unseen, observations)
    first = _First.of(sensor, observations, priors)
    leaves = [_on_device(leaf) for leaf in first.leaves_of(0, sensor, observations)]
    given_once = (*jax.tree.unflatten(first.structure, leaves), first.priors, first.layout, steps, chunk)

    def shares() -> Iterator[tuple[int, Callable[[], _Solved]]]:
        for start in range(0, len(pixel_px), _SHARE):
            drawn = pixel_px[start : start + _SHARE]
            fill = np.minimum(np.arange(-(-_SHARE // chunk) * chunk), len(drawn) - 1)
            yield len(drawn), partial(_solve_redrawn, jnp.asarray(drawn[fill]), *given_once)

    return _gather(shares(), priors)


def images_of(
    sensor: Sensor, observations: Observations, unknowns: Knowledge, values: Float[np.ndarray, "runs k"]
) -> Float[np.ndarray, "runs n 2"]:
    """Where the points of the observations are imaged, at their times, by sensors with other values of the unknowns, in pixels.

    The exact measurements of many truths: add noise, and hand them to `calibrate_redrawn`.

    **Raises:** `WhiskjaxError` where the shape does not fit; `SensorError` naming an observation that cannot be imaged.
    """
    require_x64("images_of")
    priors = _ask("images_of", sensor, observations, unknowns)
    n = len(observations)
    values = Arrays("images_of").take("values", values, f"runs {len(priors.unknowns)}", finite=True)
    ready = prepare(sensor, observations, priors, None)
    refuse(ready.unseen, observations)
    u = (np.asarray(values) - np.asarray(ready.problem.unknowns.mean)) / ready.scale
    residual, codes = (np.asarray(part) for part in _residuals_of(ready.problem, jnp.asarray(u)))
    for run in np.flatnonzero(codes[:, :n].any(axis=1))[:1]:
        raise SensorError(f"images_of: values {run}: {impossible(codes[run, :n], observations)}")
    return observations.pixel_px - residual[:, :n]


@eqx.filter_jit
def _residuals_of(problem: Problem, u: Float[Array, "runs k"]) -> tuple[Float[Array, "runs n 2"], Int[Array, "runs n"]]:
    (group,) = problem.groups

    def one(u: Array) -> tuple[Array, Array]:
        residual, code = pixels(problem, group, u)
        return stack(residual), code

    return jax.lax.map(one, u, batch_size=25)


class _First(NamedTuple):
    """What all runs of a call have in common: the structure of what goes in, and the layout of the observations."""

    structure: Any
    shapes: tuple[Any, ...]
    keys: tuple[Any, ...]
    layout: Layout
    priors: Given

    @classmethod
    def of(cls, sensor: Sensor, observations: Observations, priors: Given) -> "_First":
        """From the first run."""
        leaves, structure = jax.tree.flatten((sensor, observations))
        layout = Layout.of(sensor, observations, split=True)
        # As arrays, so that nothing is compiled for what they happen to be, and common to all lanes.
        numbers = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), priors)
        return cls(structure, tuple(map(_shape, leaves)), _keys(observations), layout, numbers)

    def leaves_of(self, number: int, sensor: Sensor, observations: Observations) -> list[Any]:
        """The arrays of a run.

        **Raises:** `WhiskjaxError` where its structure, the shape of an array, or the layout of its observations is another.
        """
        leaves, structure = jax.tree.flatten((sensor, observations))
        fits = structure == self.structure and tuple(map(_shape, leaves)) == self.shapes
        if not (fits and all(np.array_equal(a, b) for a, b in zip(_keys(observations), self.keys, strict=True))):
            raise WhiskjaxError(
                f"calibrate_batch: run {number} has another chain than run 0, or its observations are others, or in "
                "another order; runs of one call share the images, points, roles and order of their observations"
            )
        return leaves


def _shape(leaf: Any) -> Any:
    """Of an array; exact zeros and ones of the chain stay numbers, and are the same in all runs."""
    return leaf.shape if isinstance(leaf, jax.Array | np.ndarray) else leaf


def _on_device(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf


def _keys(observations: Observations) -> tuple[Any, ...]:
    point = None if observations.point_covariance_m2 is None else observations.point
    return observations.is_control, point, *(observations.key(key) for key in KEYS)


def _is_extreme(stacked: np.ndarray | None) -> bool:
    """Whether some run may hold a number that no instrument has."""
    return stacked is not None and stacked.dtype.kind == "f" and bool(np.nanmax(np.abs(stacked), initial=0) > MOST)


def _run(number: int, pair: Any) -> tuple[Sensor, Observations]:
    """**Raises:** `WhiskjaxError` where that is no run with a control point."""
    need("calibrate_batch", f"run {number}", pair, tuple, "(sensor, observations)")
    if len(pair) != 2:
        raise WhiskjaxError(f"calibrate_batch: run {number} has {len(pair)} parts: (sensor, observations)")
    sensor, observations = pair
    need("calibrate_batch", f"sensor of run {number}", sensor, Sensor)
    need("calibrate_batch", f"observations of run {number}", observations, Observations)
    if not observations.is_control.any():
        raise WhiskjaxError(f"run {number}: all points are check points; at least one control point is needed")
    return sensor, observations


def _gather(shares: Iterable[tuple[int, Callable[[], _Solved]]], priors: Given) -> Batch:
    """Solve shares side by side as they come, and put them together."""
    cores = len(os.sched_getaffinity(0))
    done: list[Future[_Solved]] = []

    def finished(runs: int, solve: Callable[[], _Solved]) -> _Solved:
        return jax.tree.map(lambda a: np.asarray(a)[:runs], solve())

    # One worker more than cores: each leaves a gap whenever it waits for XLA's own pool.
    with ThreadPoolExecutor(cores + 1 if cores > 1 else 1) as pool:
        for runs, solve in shares:
            done.append(pool.submit(finished, runs, solve))
            tell(f"batch: share {len(done)} of up to {_SHARE} runs")
            if len(done) == 1:
                done[0].result()  # compiles; the others find it compiled
            elif len(done) > 2 * cores:
                done[-2 * cores].result()  # do not run ahead of the workers: what waits is held in memory
    if not done:
        raise WhiskjaxError("calibrate_batch: there are no runs")
    whole: _Solved = jax.tree.map(lambda *parts: np.concatenate(parts), *(job.result() for job in done))
    return Batch(whole.estimate, priors.unknowns, whole.before_px, whole.after_px)


def _ask(owner: str, sensor: Sensor, observations: Observations, unknowns: Knowledge) -> Given:
    need(owner, "sensor", sensor, Sensor)
    need(owner, "observations", observations, Observations)
    return given(owner, "unknowns", unknowns)


def _ask_whole(owner: str, steps: int, chunk: int) -> None:
    arrays = Arrays(owner)
    for name, value, meaning in (("steps", steps, "a number of steps"), ("chunk", chunk, "a number of lanes")):
        if not int(arrays.take_whole(name, value, "", meaning=meaning)) > 0:
            arrays.refuse(name, f"is {meaning}, 1 or more, not {value}")
