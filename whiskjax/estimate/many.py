"""Thousands of calibrations in one call, through the same chain as one.

A lane is a calibration. Lanes are solved by a fixed number of Gauss-Newton steps in small chunks (a Levenberg-Marquardt under
vmap runs to its slowest lane and pays for both of its branches), shares of them side by side on all cores. Runs are read,
prepared and forgotten share by share, so that memory does not grow with their number.
"""

import dataclasses
import itertools
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..algebra.vectors import Vec2
from ..chain.sensor import Sensor
from ..rules import RESULTS, Arrays, SensorError, WhiskjaxError, first_failure, need, require_x64
from ..rules.progress import tell
from ..rules.results import codes_of
from .least_squares import descend, judge
from .linearised import LeastSquares, impossible, pixels, prepare, refuse
from .observations import Observations
from .problem import Problem, by_observation_of_runs
from .unknown import Unknown, need_unknowns

_SHARE = 250  # lanes in one compiled call: fewer pay for the call, more leave a core idle at the end


class Lanes(eqx.Module):
    """Solved lanes, whitened.

    `cost` is the sum of squared whitened residuals and priors, `residual_px` (x, y) of each group, (lanes, n) each.
    """

    u: Float[Array, "lanes k"]
    covariance: Float[Array, "lanes k k"]
    cost: Float[Array, " lanes"]
    residual_px: tuple[Vec2, ...]
    result: RESULTS


@dataclasses.dataclass(frozen=True)
class Batch:
    """Calibrations in the order of their runs; values in the units of the fields, residuals measured - projected in pixels.

    `result` holds a code for each run; where it is not a success the values of that run are not to be used.
    """

    unknowns: tuple[Unknown, ...]
    value: Float[np.ndarray, "runs k"]
    covariance: Float[np.ndarray, "runs k k"]
    cost: Float[np.ndarray, " runs"]
    degrees_of_freedom: int
    residual_before_px: Float[np.ndarray, "runs n 2"]
    residual_after_px: Float[np.ndarray, "runs n 2"]
    result: RESULTS

    @property
    def sigma(self) -> Float[np.ndarray, "runs k"]:
        """1-sigma of each unknown."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def is_successful(self) -> np.ndarray:
        """Which runs ended well, (runs,)."""
        return codes_of(self.result) == 0


def solve_lanes(
    problem: Problem, start: Float[Array, "*lanes k"], steps: int = 6, chunk: int = 10, common: Problem | None = None
) -> Lanes:
    """Solve many baked problems of one shape; pure, to be compiled by the caller.

    **Arguments:**

    - `problem`: every array has a leading axis of lanes.
    - `start`: whitened; (lanes, k), or (k,) for all.
    - `steps`: of Gauss-Newton.
    - `chunk`: lanes that are computed side by side; 10 to 50 run alike.
    - `common`: arrays that all lanes share, where `problem` has None.
    """
    arrays, static = eqx.partition(problem if start.ndim == 1 else (problem, start), eqx.is_array)

    def lane(arrays) -> Lanes:
        one = eqx.combine(arrays, static)
        own, first = (one, start) if start.ndim == 1 else one
        return _solve(own if common is None else eqx.combine(own, common), first, steps)

    return jax.lax.map(lane, arrays, batch_size=chunk)


def _solve(problem: Problem, start: Float[Array, " k"], steps: int) -> Lanes:
    m = start.shape[0]
    here = descend(problem, start, steps)
    u, step, normal = here
    inverse = jax.scipy.linalg.solve_triangular(jnp.linalg.cholesky(normal[:m, :m]), jnp.eye(m), lower=True)
    after, codes = zip(*(pixels(problem, group, u) for group in problem.groups), strict=True)
    worst = jnp.stack([code.max() for code in codes]).max()
    result = first_failure(judge(here), jax.tree.map(lambda _: worst, RESULTS.successful))
    # The last step went to the minimum of the quadratic whose value at its start is the corner of the normal matrix.
    return Lanes(u, inverse.T @ inverse, normal[m, m] + normal[:m, m] @ step, after, result)


_compiled = eqx.filter_jit(solve_lanes)


def calibrate_batch(
    runs: Iterable[tuple[Sensor, Observations]], unknowns: Sequence[Unknown], *, steps: int = 6, chunk: int = 10
) -> Batch:
    """Calibrate every run: other seeds, other truths, other flights, of one instrument and one layout of points.

    The same estimate as `calibrate`, to 1e-8 of a prior sigma, without its diagnosis.

    **Arguments:**

    - `runs`: (sensor, observations) of each run; may be a generator, and then no more than some hundreds are held at a time. All
      have the same chain, and the same sequence of images and roles (control, check) among their observations.
    - `unknowns`: the same for all runs.
    - `steps`, `chunk`: see `solve_lanes`.

    **Returns:** `Batch`.

    **Raises:** `WhiskjaxError` where there is no run, or one of another shape than the first, by its number.
    """
    require_x64("calibrate_batch")
    need_unknowns("calibrate_batch", "unknowns", unknowns)
    need("calibrate_batch", "runs", runs, Iterable, "pairs (sensor, observations)")
    _ask_whole("calibrate_batch", steps, chunk)

    def shares() -> Iterator[tuple[_Share, Problem, Any, Problem | None]]:
        count, shape = 0, None
        runs_left = iter(runs)
        while share := list(itertools.islice(runs_left, _SHARE)):
            ready = []
            for number, pair in enumerate(share, start=count):
                need("calibrate_batch", f"run {number}", pair, tuple, "(sensor, observations)")
                if len(pair) != 2:
                    raise WhiskjaxError(f"calibrate_batch: run {number} has {len(pair)} parts: (sensor, observations)")
                sensor, observations = pair
                need("calibrate_batch", f"sensor of run {number}", sensor, Sensor)
                need("calibrate_batch", f"observations of run {number}", observations, Observations)
                if not observations.is_control.any():
                    raise WhiskjaxError(f"run {number}: all points are check points; at least one control point is needed")
                ready.append(prepare(sensor, observations, unknowns, None, split=True))
                shape = shape or _shape(ready[0])
                if _shape(ready[-1]) != shape:
                    raise WhiskjaxError(
                        f"calibrate_batch: run {number} has another chain than run 0, or its observations are others, or in "
                        "another order; runs of one call share the images, roles and order of their observations"
                    )
            count += len(share)
            stacked = jax.tree.map(_stack, *(_on_host(one) for one in ready))
            # What is one for all lanes also lets XLA see that a condition on it is (columns.py).
            nothing, first = jax.tree.map(lambda _: None, stacked), ready[0].problem.unknowns
            common = eqx.tree_at(_of_priors, nothing, (first.scale, first.root), is_leaf=_is_none)
            stacked = eqx.tree_at(_of_priors, stacked, (None, None))
            start = np.stack([one.start for one in ready])
            before = np.stack([one.before_px for one in ready])
            unseen = np.stack([one.unseen.max() for one in ready])
            yield _Share(ready[0], np.asarray(stacked.unknowns.mean), before, unseen), stacked, start, common

    return _gather(shares(), unknowns, steps, chunk)


def calibrate_redrawn(
    sensor: Sensor,
    observations: Observations,
    unknowns: Sequence[Unknown],
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
    _ask("calibrate_redrawn", sensor, observations, unknowns)
    _ask_whole("calibrate_redrawn", steps, chunk)
    arrays = Arrays("calibrate_redrawn")
    pixel_px = np.asarray(arrays.take("pixel_px", pixel_px, f"runs {len(observations)} 2", finite=True))
    if len(pixel_px) == 0:
        arrays.refuse("pixel_px", f"has shape {pixel_px.shape}, expected (runs, {len(observations)}, 2) of at least one run")
    if not observations.is_control.any():
        raise WhiskjaxError("all points are check points; at least one control point is needed")
    ready = prepare(sensor, observations, unknowns, None, split=True)
    refuse(ready.unseen, observations)
    problem = _on_host(ready)

    def pixel_of(problem: Problem) -> list:
        return [group.pixel for group in problem.groups]

    common = eqx.tree_at(pixel_of, problem, [(None, None)] * len(problem.groups))
    nothing = jax.tree.map(lambda _: None, problem)

    groups = zip(problem.groups, ready.indices, strict=True)
    padded = [np.concatenate([i, np.full(len(group.pixel[0]) - len(i), i[0])]) for group, i in groups]

    def shares() -> Iterator[tuple[_Share, Problem, Any, Problem | None]]:
        for first in range(0, len(pixel_px), _SHARE):
            drawn = pixel_px[first : first + _SHARE]
            own = eqx.tree_at(pixel_of, nothing, [(drawn[:, i, 0], drawn[:, i, 1]) for i in padded], is_leaf=_is_none)
            before = ready.before_px + drawn - observations.pixel_px
            nothing_failed = np.zeros(len(drawn), dtype=np.int32)
            yield _Share(ready, np.asarray(problem.unknowns.mean)[None], before, nothing_failed), own, ready.start, common

    return _gather(shares(), unknowns, steps, chunk)


def images_of(
    sensor: Sensor, observations: Observations, unknowns: Sequence[Unknown], values: Float[np.ndarray, "runs k"]
) -> Float[np.ndarray, "runs n 2"]:
    """Where the points of the observations are imaged, at their times, by sensors with other values of the unknowns, in pixels.

    The exact measurements of many truths: add noise, and hand them to `calibrate_redrawn`.

    **Raises:** `WhiskjaxError` where the shape does not fit; `SensorError` naming an observation that cannot be imaged.
    """
    require_x64("images_of")
    _ask("images_of", sensor, observations, unknowns)
    values = Arrays("images_of").take("values", values, f"runs {len(unknowns)}", finite=True)
    ready = prepare(sensor, observations, unknowns, None)
    refuse(ready.unseen, observations)
    u = (np.asarray(values) - np.asarray(ready.problem.unknowns.mean)) / ready.scale
    residual, codes = _residuals_of(ready.problem, jnp.asarray(u))
    codes = by_observation_of_runs([np.asarray(codes)[:, None]], ready.indices)[:, :, 0].astype(int)
    for run in np.flatnonzero(codes.any(axis=1))[:1]:
        raise SensorError(f"images_of: values {run}: {impossible(codes[run], observations)}")
    residual = np.stack(residual, axis=1)
    return observations.pixel_px - by_observation_of_runs([residual], ready.indices)


@eqx.filter_jit
def _residuals_of(problem: Problem, u: Float[Array, "runs k"]) -> tuple[Vec2, Int[Array, "runs n"]]:
    (group,) = problem.groups
    return jax.lax.map(lambda one: pixels(problem, group, one), u, batch_size=25)


class _Share(NamedTuple):
    """What the solver does not need: the layout of the runs; of each its mean, residuals before, and worst failure code."""

    layout: LeastSquares
    mean: Float[np.ndarray, "#lanes k"]
    before_px: Float[np.ndarray, "lanes n 2"]
    unseen: Int[np.ndarray, " lanes"]


def _gather(
    shares: Iterable[tuple[_Share, Problem, Any, Problem | None]], unknowns: Sequence[Unknown], steps: int, chunk: int
) -> Batch:
    """Solve shares side by side as they come, and put them together."""
    cores = len(os.sched_getaffinity(0))
    done: list[tuple[_Share, Future[Lanes]]] = []
    # One worker more than cores: each leaves a gap whenever it waits for XLA's own pool.
    with ThreadPoolExecutor(cores + 1 if cores > 1 else 1) as pool:
        for share, problem, start, common in shares:
            job = pool.submit(_finished, problem, start, steps, chunk, common)
            done.append((share, job))
            tell(f"batch: share {len(done)} of up to {_SHARE} runs")
            if len(done) == 1:
                job.result()  # compiles; the others find it compiled
            elif len(done) > 2 * cores:
                done[-2 * cores][1].result()  # do not run ahead of the workers: what waits is held in memory
    if not done:
        raise WhiskjaxError("calibrate_batch: there are no runs")
    layout = done[0][0].layout
    solved = [job.result() for _, job in done]
    value = [share.mean + layout.scale * lanes.u for (share, _), lanes in zip(done, solved, strict=True)]
    covariance, cost = (np.concatenate([getattr(lanes, name) for lanes in solved]) for name in ("covariance", "cost"))
    after = [by_observation_of_runs([np.stack(pair, 1) for pair in lanes.residual_px], layout.indices) for lanes in solved]
    unseen = np.concatenate([share.unseen for share, _ in done])
    codes = np.concatenate([codes_of(lanes.result) for lanes in solved])
    used = int(layout.observations.is_control.sum())
    return Batch(
        unknowns=tuple(unknowns),
        value=np.concatenate(value),
        covariance=covariance * np.outer(layout.scale, layout.scale),
        cost=cost,
        degrees_of_freedom=2 * used + int(layout.has_prior.sum()) - len(unknowns),
        residual_before_px=np.concatenate([share.before_px for share, _ in done]),
        residual_after_px=np.concatenate(after),
        result=jax.tree.map(lambda _: np.where(unseen != 0, unseen, codes), RESULTS.successful),
    )


def _finished(problem: Problem, start: Any, steps: int, chunk: int, common: Problem | None) -> Lanes:
    """Lanes as numpy arrays; a shorter share is filled up, so that nothing is compiled for its length."""
    lanes = problem.groups[0].pixel[0].shape[0]
    fill = np.minimum(np.arange(-(-_SHARE // chunk) * chunk), lanes - 1)
    problem = jax.tree.map(lambda a: a[fill] if isinstance(a, np.ndarray) else a, problem)
    start = start if start.ndim == 1 else start[fill]
    solved = _compiled(problem, jnp.asarray(start), steps, chunk, common)
    return jax.tree.map(lambda a: np.asarray(a)[:lanes], solved)


def _shape(ready: LeastSquares) -> tuple:
    """What runs of one call have in common: the chain, its arrays' shapes, and which observations are whose."""
    leaves, tree = jax.tree.flatten(ready.problem)
    arrays = tuple(leaf.shape if eqx.is_array(leaf) else leaf for leaf in leaves)
    return tree, arrays, tuple(tuple(index) for index in ready.indices)


def _ask(owner: str, sensor: Sensor, observations: Observations, unknowns: Sequence[Unknown]) -> None:
    need(owner, "sensor", sensor, Sensor)
    need(owner, "observations", observations, Observations)
    need_unknowns(owner, "unknowns", unknowns)


def _ask_whole(owner: str, steps: int, chunk: int) -> None:
    arrays = Arrays(owner)
    for name, value, meaning in (("steps", steps, "a number of steps"), ("chunk", chunk, "a number of lanes")):
        if not int(arrays.take_whole(name, value, "", meaning=meaning)) > 0:
            arrays.refuse(name, f"is {meaning}, 1 or more, not {value}")


def _on_host(ready: LeastSquares) -> Problem:
    """The problem with numpy arrays; exact zeros and ones of the chain stay numbers."""
    return jax.tree.map(lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, ready.problem)


def _of_priors(problem: Problem) -> tuple[Any, Any]:
    return problem.unknowns.scale, problem.unknowns.root


def _is_none(x: Any) -> bool:
    return x is None


def _stack(*leaves: Any) -> Any:
    return np.stack(leaves) if isinstance(leaves[0], np.ndarray) else leaves[0]
