"""Which model: several calibrations of the same observations, compared by likelihood ratio, AIC, BIC and check points."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..chain.shot import KEYS
from ..rules import WhiskjaxError, need
from .calibration import Calibration
from .model_test import chi_square_tail


class Candidate(NamedTuple):
    """One model. `cost` is the sum of squared whitened residuals, priors included; `aic` and `bic` count from the best model.

    `ratio` is the cost that the model saves against the smallest one, `tail` the probability that it would save as much by chance
    were the smallest one true (chi-square of the extra unknowns; an approximation where the extra unknowns have narrow priors).
    """

    name: str
    unknowns: int
    cost: float
    ratio: float
    tail: float
    aic: float
    bic: float
    check_rms_px: float
    check_log_density: float


class Comparison(NamedTuple):
    """Candidates from the smallest, the name of the recommended one, and why."""

    candidates: tuple[Candidate, ...]
    recommended: str
    reason: str


def compare(models: Mapping[str, Calibration]) -> Comparison:
    """Compare calibrations that differ in their unknowns only.

    The smallest BIC is recommended: an extra unknown has to save log(n), n the number of measured coordinates, so that with more
    data a superfluous one is taken ever more rarely. (AIC asks for 2, and takes one superfluous unknown in six.) The check points
    stand beside it as an independent witness; where they disagree the reason says so.

    **Raises:** `WhiskjaxError` where the calibrations use different observations or weights.
    """
    need("compare", "models", models, Mapping, "calibrations by name")
    for name, model in models.items():
        need("compare", f"models[{name!r}]", model, Calibration)
    if len(models) < 2:
        raise WhiskjaxError("compare: give at least two calibrations")
    first = next(iter(models.values()))
    for name, model in models.items():
        ours, theirs = model.observations, first.observations
        pairs: list[tuple[Any, Any]] = [(model.used, first.used)]
        pairs += [
            (getattr(ours, f), getattr(theirs, f)) for f in ("pixel_px", "point_m", "point", "sigma_px", "point_covariance_m2")
        ]
        pairs += [(ours.key(key), theirs.key(key)) for key in ("time_s", *KEYS)]
        if not all(np.array_equal(a, b) for a, b in pairs):
            raise WhiskjaxError(
                f"compare: {name} uses other observations or other weights than {next(iter(models))}; "
                "likelihoods of different data cannot be compared: calibrate all of them with the same ones"
            )
    ordered = sorted(models.items(), key=lambda item: len(item[1].unknowns))
    n = 2 * int(first.used.sum())
    cost = {name: cost_of(model) for name, model in ordered}
    size = {name: len(model.unknowns) for name, model in ordered}
    smallest = ordered[0][0]
    aic = {name: cost[name] + 2 * size[name] for name in cost}
    bic = {name: cost[name] + math.log(n) * size[name] for name in cost}
    check = ~first.observations.is_control
    rows = []
    for name, model in ordered:
        saved, extra = cost[smallest] - cost[name], size[name] - size[smallest]
        rms = float(np.sqrt(np.mean(model.residual_after_px[check] ** 2))) if check.any() else math.nan
        tail = chi_square_tail(max(saved, 0.0), extra) if extra else math.nan
        above = (aic[name] - min(aic.values()), bic[name] - min(bic.values()))
        rows.append(Candidate(name, size[name], cost[name], saved, tail, *above, rms, model.check_log_density))
    best = min(bic, key=lambda name: bic[name])
    return Comparison(tuple(rows), best, _reason(rows, best, n))


def cost_of(model: Calibration) -> float:
    """Sum of squared whitened residuals and priors."""
    return model.fit.variance_factor * model.fit.degrees_of_freedom


def _reason(rows: list[Candidate], best: str, n: int) -> str:
    others = sorted((row for row in rows if row.name != best), key=lambda row: row.bic)
    said = (
        f"{best} has the smallest BIC ({others[0].name} is {others[0].bic:.1f} above; an unknown has to save {math.log(n):.1f})"
    )
    if not math.isnan(rows[0].check_log_density):
        favoured = max(rows, key=lambda row: row.check_log_density).name
        said += "; the check points agree" if favoured == best else f"; the check points favour {favoured}: look at both"
    return said
