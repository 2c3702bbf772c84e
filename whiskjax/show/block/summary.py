"""An adjusted block as plain data: every figure that is printed, drawn in words or written comes from this one place.

Made of dicts, lists, strings, booleans and floats, so that `results.json` is the summary itself. Figures that do not exist are
None; names end in their unit.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from ...estimate.block.adjustment import Statistics
from ...estimate.block.block import ROLES
from ...estimate.errors import AXES
from ...estimate.reason import Reason, by_weight, warnings
from ..plain import Summary, check, fit, number, solver, verdict, versions, weights
from ..scales import in_words, one_sizes, units_in_words
from .adjusted import Adjusted

ENU = ("east", "north", "up")
_LARGEST = 8


def summarise(adjusted: Adjusted, command: str = "") -> Summary:
    """Everything worth telling about an adjusted block.

    **Arguments:** `command`: how it was made, for the reader who wants to repeat it.
    """
    flight, adjustment = adjusted.flight, adjusted.adjustment
    reasons = by_weight([*adjustment.reasons, *_own_reasons(adjusted)])
    return {
        "flight": flight.name,
        "command": command,
        "verdict": verdict(reasons),
        "units": {
            "residuals": f"px, measured - projected; {in_words(flight.is_line)}",
            **units_in_words(flight.is_line),
            "statistics": "m; adjusted, or directly positioned, - given",
            "unknowns": "each in its own unit",
            "data_share": "1 - sigma^2 / prior_sigma^2: the part of the prior variance that the data removed",
        },
        "world": flight.world.kind,
        "counts": _counts(adjusted),
        "solver": solver(adjustment.result, adjustment.steps),
        "fit": fit(adjustment.variance_factor, adjustment.freedom, adjustment.tail_probability, adjustment.is_consistent),
        "unknowns": _unknowns(adjusted),
        "corrections": _corrections(adjusted),
        "statistics": _statistics(adjusted),
        "check": _check(adjusted),
        "standard": _standard(adjusted),
        "direct": _direct(adjusted),
        "residuals": _residuals(adjusted),
        "images": _images(adjusted),
        "point_sigmas": _point_sigmas(adjusted),
        "largest_residuals": _largest(adjusted, adjustment.used, _LARGEST),
        "left_out": _largest(adjusted, adjusted.wrong, len(adjusted.block)),
        "seen_once": list(adjustment.left_out),
        "weights": weights(adjustment.components),
        "warnings": list(warnings(reasons)),
        "versions": versions("jax", "numpy"),
    }


def _counts(adjusted: Adjusted) -> Summary:
    block, used, wrong = adjusted.block, adjusted.adjustment.used, adjusted.wrong
    seen = np.bincount(block.point, minlength=len(block.role)) > 0
    return {
        "images": len(np.unique(adjusted.flight.measurements.image)),
        "strips": list(adjusted.flight.strips),
        "rays": {"all": len(block)} | {role: int((adjusted.role == role).sum()) for role in ROLES},
        "points": {"all": int(seen.sum())} | {role: int((seen & (block.role == role)).sum()) for role in ROLES},
        "points_unseen": int((~seen).sum()),
        "points_seen_once": len(adjusted.adjustment.left_out),
        "rays_left_out": int(wrong.sum()),
        "points_left_out": int(np.setdiff1d(block.point[wrong], block.point[used]).size),
    }


def _unknowns(adjusted: Adjusted) -> list[Summary]:
    adjustment, rows = adjusted.adjustment, []
    for k, unknown in enumerate(adjustment.unknowns):
        unit, factor = unknown.unit
        scaled = lambda value, factor=factor: None if value is None else number(value * factor)
        rows.append(
            {
                "name": unknown.name,
                "where": [place.text for place in unknown.places],
                "unit": unit,
                "prior_mean": scaled(unknown.mean),
                "prior_sigma": scaled(unknown.sigma),
                "start": scaled(adjustment.start[k]),
                "value": scaled(adjustment.value[k]),
                "sigma": scaled(adjustment.trust.sigma[k]),
                "data_share": number(adjustment.trust.data_share[k]),
            }
        )
    return rows


def _left_out(adjusted: Adjusted) -> list[str]:
    """What the flight says of errors that the adjustment did not count."""
    counted = {one.frame for one in adjusted.adjustment.errors}
    others = dict.fromkeys(one.frame for one in adjusted.flight.errors if one.frame not in counted)
    return [f"errors of {', '.join(others)} are not counted: no motions are estimated there"] if others else []


def _corrections(adjusted: Adjusted) -> Summary | None:
    """What was added to the trajectory, axis by axis; None where it was kept."""
    errors, course = adjusted.adjustment.motions, adjusted.course
    if errors is None or course is None:
        return None
    rows = []
    for k, (axis, prior, time) in enumerate(zip(AXES, errors.sigma, errors.correlation_s, strict=True)):
        unit, factor = ("deg", math.degrees(1.0)) if k < 3 else ("m", 1.0)
        value, sigma = factor * course.value[:, k], factor * course.sigma[:, k]
        rows.append(
            {
                "axis": axis,
                "unit": unit,
                "prior_sigma": factor * prior,
                "correlation_s": list(time) if isinstance(time, tuple) else time,
                "rms": number(np.sqrt((value**2).mean())),
                "max_abs": number(np.abs(value).max()),
                "median_sigma": number(np.median(sigma)),
            }
        )
    return {"link": errors.link, "observed": errors.observed, "stations": len(course.value), "axes": rows}


def _rows_of(name: str, error_m: Float[np.ndarray, "n 3"]) -> list[Summary]:
    """Max, min, mean and RMSE along each axis."""
    return [
        {
            "what": name,
            "axis": axis,
            "n": found.count,
            "max_m": number(found.largest),
            "min_m": number(found.smallest),
            "mean_m": number(found.mean),
            "rmse_m": number(found.rmse),
        }
        for axis, found in zip(ENU, map(Statistics.of, error_m.T), strict=True)
    ]


def _statistics(adjusted: Adjusted) -> list[Summary]:
    rows = []
    if adjusted.direct is not None:
        before, after = map(adjusted.direct_error_enu_m, adjusted.direct)
        rows += [*_rows_of("direct, before", before), *_rows_of("direct, after", after)]
    for role in ("control", "check"):
        error = adjusted.error_enu_m[adjusted.block.role == role]
        error = error[np.isfinite(error).all(axis=1)]
        if len(error):
            rows += _rows_of(role, error)
    return rows


def _check(adjusted: Adjusted) -> Summary | None:
    """RMSE of the check points in planimetry and height, and whether their covariances explain the errors; None without any."""
    chosen = (adjusted.block.role == "check") & np.isfinite(adjusted.error_enu_m).all(axis=1)
    if not chosen.any():
        return None
    error = adjusted.error_enu_m[chosen]
    given = np.einsum(
        "nji,njk,nkl->nil",
        adjusted.world_from_enu[chosen],
        adjusted.block.covariance_m2[chosen],
        adjusted.world_from_enu[chosen],
    )
    spread = adjusted.covariance_enu_m2[chosen] + given
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[:, :, None])[:, :, 0])
    square = (error**2).mean(axis=0)
    return {
        "points": int(chosen.sum()),
        "planimetry_rmse_m": number(np.sqrt(square[:2].sum())),
        "height_rmse_m": number(np.sqrt(square[2])),
        "mean_nees": number(nees.mean()),
        "expected_nees": 3,
        **(check(adjusted.adjustment.check) or {}),
    }


def _standard(adjusted: Adjusted) -> Summary | None:
    """Each limit and whether the check points meet it; None where none was asked for."""
    standard, off = adjusted.standard, _check(adjusted)
    if standard is None:
        return None
    limits = []
    for what in ("planimetry", "height"):
        limit = getattr(standard, f"{what}_m")
        if limit is not None:
            rmse = None if off is None else off[f"{what}_rmse_m"]
            limits.append({"what": what, "limit_m": limit, "rmse_m": rmse, "passes": None if rmse is None else rmse <= limit})
    return {"name": standard.name, "limits": limits, "passes": all(row["passes"] is True for row in limits)}


def _direct(adjusted: Adjusted) -> Summary | None:
    """How many intersections direct positioning made, and what it could not intersect; None where it was not asked for."""
    if adjusted.direct is None:
        return None
    return {
        name: {"intersections": len(of.point), "seen_once": of.alone, "not_meeting": of.lost}
        for name, of in zip(("before", "after"), adjusted.direct, strict=True)
    }


def _residuals(adjusted: Adjusted) -> list[Summary]:
    """Of used rays, by view (None: all together) and role."""
    used, rows = adjusted.adjustment.used, []
    views = adjusted.views if len(adjusted.views) > 1 else []
    for view, here in [(None, np.ones(len(used), dtype=bool)), *views]:
        for role in adjusted.roles:
            chosen = here & used & (adjusted.role == role)
            if chosen.any():
                most = np.abs(adjusted.adjustment.residual_px[chosen]).max(axis=0)
                s = adjusted.normalised[chosen]
                rows.append(
                    {
                        "view": view,
                        "role": role,
                        **_rms(adjusted, chosen, np.zeros(int(chosen.sum()), dtype=int))[0],
                        "max_abs_x_px": number(most[0]),
                        "max_abs_y_px": number(most[1]),
                        "rms_in_sigmas": number(np.sqrt((s**2).mean())),
                    }
                )
    return rows


def _rms(adjusted: Adjusted, chosen: Bool[np.ndarray, " rays"], group: Int[np.ndarray, " n"]) -> list[Summary]:
    """RMS of the residuals of some rays in every unit, for each group of them: 0, 1, ..."""
    residual = adjusted.adjustment.residual_px
    (x, y), (x_m, y_m) = residual.T, adjusted.scales.metres(residual).T
    units = {"x_px": x, "y_px": y, "y_lines": adjusted.scales.lines(residual), "x_m": x_m, "y_m": y_m}
    count = np.bincount(group)
    rms = {f"rms_{name}": np.sqrt(np.bincount(group, r[chosen] ** 2) / count) for name, r in units.items()}
    return [{"rays": int(n)} | {name: number(r[k]) for name, r in rms.items()} for k, n in enumerate(count)]


def _images(adjusted: Adjusted) -> list[Summary]:
    """Of used rays of all roles, image by image."""
    used = adjusted.adjustment.used
    names, group = np.unique(np.asarray(adjusted.block.images)[used], return_inverse=True)
    return [{"image": name} | row for name, row in zip(names.tolist(), _rms(adjusted, used, group), strict=True)]


def _point_sigmas(adjusted: Adjusted) -> list[Summary]:
    rows = []
    for role in adjusted.roles:
        sigma = adjusted.sigma_enu_m[adjusted.block.role == role]
        sigma = sigma[np.isfinite(sigma).all(axis=1)]
        for k, axis in enumerate(ENU):
            if len(sigma):
                median, most = number(np.median(sigma[:, k])), number(sigma[:, k].max())
                rows.append({"role": role, "axis": axis, "n": len(sigma), "median_m": median, "max_m": most})
    return rows


def _largest(adjusted: Adjusted, among: np.ndarray, most: int) -> list[Summary]:
    """The rays whose residuals are the most sigmas, the largest first."""
    length = np.nan_to_num(np.abs(adjusted.normalised).max(axis=1), nan=np.inf)
    order = np.argsort(-np.where(among, length, -1.0), kind="stable")[: min(most, int(among.sum()))]
    block, residual = adjusted.block, adjusted.adjustment.residual_px
    return [
        {
            "image": block.images[i],
            "point": block.points[int(block.point[i])],
            "role": str(adjusted.role[i]),
            "x_px": number(residual[i, 0]),
            "y_px": number(residual[i, 1]),
            **one_sizes(adjusted.scales, residual, i),
            "normalised_x": number(adjusted.normalised[i, 0]),
            "normalised_y": number(adjusted.normalised[i, 1]),
        }
        for i in order.tolist()
    ]


def _own_reasons(adjusted: Adjusted) -> list[Reason]:
    """What the adjustment itself cannot know: its flight, and what was asked of it."""
    found = [Reason("errors not counted", "caution", said, {}) for said in _left_out(adjusted)]
    if (standard := _standard(adjusted)) is not None:
        failed = [row["what"] for row in standard["limits"] if not row["passes"]]
        name = standard["name"]
        said = f"{name}: not met in {', '.join(failed)}" if failed else f"the limits of {name} are met"
        found.append(Reason("limits", "caution" if failed else "note", said, {"name": name, "failed": failed}))
    if (n := _counts(adjusted)["points_unseen"]) > 0:
        said = f"{n} point{'s' * (n > 1)} of the flight {'are' if n > 1 else 'is'} seen by no image"
        found.append(Reason("unseen points", "caution", said, {"count": n}))
    return found
