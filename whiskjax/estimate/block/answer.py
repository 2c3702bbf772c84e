"""From a solution to an `Adjustment`: residuals, covariances and the estimate, traced or not."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Bool, Float

from ...rules import RESULTS, SensorError, arrays_of, first_failure, plain
from ...rules.progress import tell
from ...rules.results import codes_of, failure_if, message_of
from ..checks import ended
from ..errors import FrameErrors
from ..estimate import Estimate
from ..unknown import Unknown
from ..variance_components import Components
from ..weight_uncertainty import Uncertain
from .adjustment import Adjustment
from .connect import seen_once
from .covariance import covariances, evaluate
from .derivative import half_cost
from .prepare import Prepared
from .solve import Solved
from .station_errors import StationErrors
from .weakness import weak

_SINGULAR = 1e-13  # bound of the smallest eigenvalue of the normal matrix, scaled to unit diagonal; sound blocks have 1e-5


def answer(
    prepared: Prepared,
    solved: Solved,
    unknowns: Sequence[Unknown],
    errors: tuple[FrameErrors, ...],
    start_u: Any,
    used: Bool[np.ndarray, " rays"],
    found: Components | None,
    uncertain: Uncertain | None = None,
) -> Adjustment:
    """The adjustment that a solution is."""
    ready, block, state = prepared.ready, prepared.block, solved.state
    math = arrays_of((ready, state))
    inverse, is_determined = inverse_of(solved.reduced.matrix)
    spread = inverse if uncertain is None else uncertain.of(inverse)
    tell("adjust: residuals and covariances (the first time compiled)")
    seen = evaluate(ready, state)
    residual, code = prepared.by_ray(seen.residual_px), math.where(used, prepared.by_ray(seen.code).astype(np.int32), 0)
    point = prepared.point_m(state)
    covariance = prepared.by_point(covariances(ready, state, jnp.asarray(spread), math is jnp))
    nowhere, lonely = prepared.lone(used), seen_once(block)
    point = math.where(nowhere[:, None], math.nan, point)
    covariance = math.where((nowhere | ~math.asarray(is_determined))[:, None, None], math.nan, covariance)
    residual = math.where(lonely[block.point][:, None], math.nan, residual)
    solution = ready.unknowns.put(ready.sensor, state.x, state.u)
    return Adjustment(
        sensor=solution,
        estimate=_estimate(prepared, solved, inverse, spread, is_determined, used, code),
        unknowns=tuple(unknowns),
        start=plain(ready.unknowns.others.mean) + plain(ready.unknowns.others.scale) * plain(start_u),
        block=block,
        errors=errors,
        point_m=point,
        covariance_m2=covariance,
        residual_px=residual,
        used=used,
        components=found,
        steps=solved.steps,
        _prepared=prepared,
        _solved=solved,
        _inverse=math.where(is_determined, inverse, math.nan),
        _spread=math.where(is_determined, spread, math.nan),
        _code=code,
    )


def _estimate(
    prepared: Prepared, solved: Solved, inverse: Any, spread: Any, is_determined: Any, used: Any, code: Any
) -> Estimate:
    """The unknowns with their joint covariance, points and motions integrated out."""
    ready, block, state = prepared.ready, prepared.block, solved.state
    others, size, q = ready.unknowns.others, state.x.size, state.u.size
    math = arrays_of((ready, state))
    scale, mean = plain(others.scale), plain(others.mean)
    inverse, spread = (math.where(is_determined, part, math.nan) for part in (inverse, spread))
    finite = math.isfinite(math.asarray(solved.reduced.cost))
    singular = failure_if(~math.asarray(is_determined) & finite, RESULTS.rank_deficient)
    result = first_failure(singular, failure_if(~math.asarray(is_determined), RESULTS.nonfinite), solved.result)
    worst = code[math.argmax(code != 0)]
    result = first_failure(result, jax.tree.map(lambda _: worst.astype(np.int32), RESULTS.successful))
    # The cost of the reduced equations is that of points moved to first order, which cannot be differentiated in reverse.
    cost = 2 * half_cost(ready, state) if math is jnp else np.asarray(solved.reduced.cost)
    control = (block.role == "control") & block.seen
    recorded = (abs(plain(ready.roots)).sum(axis=2) > 0).sum()
    points = len(np.unique(block.point[used | control[block.point]])) if math is np or isinstance(used, np.ndarray) else 0
    freedom = 2 * int(used.sum()) + 3 * int(control.sum()) + recorded + others.has_prior.sum() - size - q - 3 * points
    return Estimate(
        value=mean + scale * plain(state.u),
        covariance=spread[size:, size:] * math.outer(scale, scale),
        prior_share=math.where(math.asarray(others.has_prior), inverse.diagonal()[size:], math.nan),
        cost=cost,
        freedom=freedom if math is jnp else int(freedom),
        result=result,
        names=others.names,
        places=others.places,
    )


def inverse_of(matrix: Any) -> tuple[Float[Any, "m m"], Bool[Any, ""]]:
    """The inverse of the reduced normal matrix, and whether it is positive definite beyond rounding; the identity where not."""
    matrix = plain(matrix)
    math, eye = arrays_of(matrix), np.eye(len(matrix))
    diagonal = matrix.diagonal()
    fine = math.isfinite(matrix).all() & (diagonal > 0).all()
    scale = 1 / math.sqrt(math.where(fine, diagonal, 1.0))
    scaled = math.where(fine, matrix * math.outer(scale, scale), eye)
    inverse = _of_positive_definite(scaled)
    # One over the norm is no larger than the smallest eigenvalue, and far cheaper.
    norm = abs(math.where(math.isfinite(inverse), inverse, math.inf)).sum(axis=0).max(initial=0.0)
    fine = fine & (norm * _SINGULAR < 1)
    return math.where(fine, inverse * math.outer(scale, scale), eye), fine


def _of_positive_definite(matrix: Any) -> Any:
    """The inverse; not numbers where there is none."""
    if arrays_of(matrix) is jnp:
        return cho_solve(cho_factor(matrix), jnp.eye(len(matrix)))
    try:
        root = np.linalg.inv(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        return np.full(matrix.shape, np.nan)
    return root.T @ root


def refuse(adjustment: Adjustment, motions: StationErrors | None) -> None:
    """**Raises:** `SensorError` where the block could not be solved, or a ray cannot have been made."""
    code = int(codes_of(adjustment.result))
    if code == 0:
        return
    if np.any(adjustment._code) and adjustment.is_determined and int(codes_of(adjustment._solved.result)) == 0:
        raise SensorError(f"adjust: {ended(adjustment.evidence)}")
    matrix, stations = np.asarray(adjustment._solved.reduced.matrix), adjustment._solved.state.x.shape[1]
    named = weak(matrix, stations, adjustment.estimate.names, motions)
    raise SensorError(f"adjust: {message_of(code)}{named}")


def is_fine(solved: Solved) -> bool:
    """Whether there is a solution, and equations that determine it."""
    return int(codes_of(solved.result)) == 0 and bool(inverse_of(solved.reduced.matrix)[1])
