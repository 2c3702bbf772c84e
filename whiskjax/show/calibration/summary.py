"""A calibration as plain data: every figure that is printed, drawn in words or written comes from this one place.

The summary is made of dicts, lists, strings, booleans and floats, so that `results.json` is the summary itself. Figures that do
not exist (the spread of one residual, the prior of an unknown without one) are None. Names end in their unit; parameters carry
theirs in `unit` (degrees, metres, milliseconds, pixels).
"""

import numpy as np

from ...estimate.calibration import Calibration
from ...estimate.number_checks import CORRELATED, PRIOR_ONLY
from ...flights.flight import Flight
from ..plain import Summary, check, fit, number, solver, verdict, versions, weights
from ..scales import in_words, one_sizes, units_in_words
from .residuals import STAGES, Residuals, gather

HALF_WEIGHT = 0.5
_LARGEST = 5


def summarise(calibration: Calibration, flight: Flight, command: str = "") -> Summary:
    """Everything worth telling about a calibration.

    **Arguments:**

    - `calibration`: made from `flight.observations()`.
    - `command`: how it was made, for the reader who wants to repeat it.
    """
    residuals = gather(calibration, flight)
    parameters = _parameters(calibration)
    posterior, found = calibration.posterior, calibration.fit
    return {
        "flight": flight.name,
        "command": command,
        "verdict": verdict(calibration.reasons),
        "units": {
            "residuals": f"px, measured - projected; {in_words(residuals.is_line)}",
            **units_in_words(residuals.is_line),
            "parameters": "each in its own unit",
            "data_share": "1 - sigma^2 / prior_sigma^2: the part of the prior variance that the data removed",
        },
        "counts": _counts(residuals, flight),
        "solver": solver(calibration.result, calibration.steps),
        "fit": fit(found.variance_factor, found.degrees_of_freedom, found.tail_probability, found.is_consistent),
        "check": check(found.check),
        "parameters": parameters,
        "determined": {
            "is_determined": posterior.is_determined,
            "unknowns": len(parameters),
            "rank_of_data": posterior.rank,
            "condition_of_data": number(posterior.condition),
            "null_space_of_data": _null_space(calibration),
            "not_determined": [p["name"] for p in parameters if p["sigma"] is None],
            "fixed_by_prior": [p["name"] for p in parameters if p["data_share"] is not None and p["data_share"] < PRIOR_ONLY],
        },
        "correlation": _correlation(calibration),
        "residuals": [row for row in _statistics(residuals)],
        "largest_residuals": _largest(residuals),
        "down_weighted": _down_weighted(residuals),
        "blunders": _blunders(residuals),
        "weights": weights(calibration.components),
        "detectable": _detectable(residuals),
        "warnings": list(calibration.warnings),
        "versions": versions("jax", "optimistix", "numpy"),
    }


def _parameters(calibration: Calibration) -> list[Summary]:
    rows = []
    for k, unknown in enumerate(calibration.unknowns):
        unit, factor = unknown.unit
        has_prior = unknown.mean is not None and unknown.sigma is not None
        rows.append(
            {
                "name": unknown.name,
                "where": [place.text for place in unknown.places],
                "unit": unit,
                "prior_mean": number(unknown.mean * factor) if unknown.mean is not None else None,
                "prior_sigma": number(unknown.sigma * factor) if unknown.sigma is not None else None,
                "start": number(calibration.start[k] * factor),
                "value": number(calibration.value[k] * factor),
                "sigma": number(calibration.posterior.sigma[k] * factor),
                "data_share": number(calibration.posterior.data_share[k]),
                "from_prior_sigmas": number((calibration.value[k] - unknown.mean) / unknown.sigma) if has_prior else None,  # pyright: ignore[reportOperatorIssue, reportOptionalOperand]
            }
        )
    return rows


def _null_space(calibration: Calibration) -> list[Summary]:
    """Moves of the unknowns that change no residual, each in the unit of its parameter."""
    factor = {x.name: x.unit.factor for x in calibration.unknowns}
    return [{name: v * factor[name] for name, v in move.items()} for move in calibration.posterior.null_space]


def _correlation(calibration: Calibration) -> Summary:
    rho = calibration.posterior.correlation
    names = [x.name for x in calibration.unknowns]
    strong = [(i, j) for i in range(len(names)) for j in range(i) if abs(rho[i, j]) > CORRELATED]
    strong.sort(key=lambda ij: -abs(rho[ij]))
    return {
        "names": names,
        "matrix": [[number(x) for x in row] for row in rho],
        "threshold": CORRELATED,
        "strong": [{"first": names[j], "second": names[i], "correlation": number(rho[i, j])} for i, j in strong],
    }


def _counts(residuals: Residuals, flight: Flight) -> Summary:
    control = int(residuals.is_control.sum())
    return {
        "images": len(residuals.images),
        "images_without_observations": len(flight.images) - len(residuals.images),
        "observations": len(residuals),
        "control_observations": control,
        "check_observations": len(residuals) - control,
        "control_points": len({p for p, c in zip(residuals.points, residuals.is_control, strict=True) if c}),
        "check_points": len({p for p, c in zip(residuals.points, residuals.is_control, strict=True) if not c}),
        "tie_observations_left_out": len(flight.measurements) - len(residuals),
    }


def _rms(r: np.ndarray) -> float | None:
    return number(np.sqrt((r**2).mean()))


def _moments(r: np.ndarray) -> Summary:
    return {
        "n": len(r),
        "mean_px": number(r.mean()),
        "std_px": number(r.std(ddof=1)) if len(r) > 1 else None,
        "max_abs_px": number(np.abs(r).max()),
        "rms_px": _rms(r),
    }


def _statistics(residuals: Residuals) -> list[Summary]:
    """For all images together (image None) and for each: control and check, before and after, both axes; without blunders."""
    rows = []
    places = [(None, np.ones(len(residuals), dtype=bool))]
    places += [(image.name, residuals.image == i) for i, image in enumerate(residuals.images)]
    for name, here in places:
        for role, is_role in (("control", residuals.is_control), ("check", ~residuals.is_control)):
            chosen = here & is_role & (residuals.weight > 0)
            if not chosen.any():
                continue
            for k, axis in enumerate(("x", "y")):
                for stage in STAGES:
                    group = {"image": name, "role": role, "axis": axis, "axis_name": residuals.axes[k], "stage": stage}
                    px, is_across = residuals.stage(stage), residuals.is_line and axis == "y"
                    in_lines = _rms(residuals.scales.lines(px)[chosen]) if is_across else None
                    sizes = {"rms_lines": in_lines, "rms_m": _rms(residuals.scales.metres(px)[chosen, k])}
                    rows.append(group | _moments(px[chosen, k]) | sizes)
    return rows


def _largest(residuals: Residuals) -> list[Summary]:
    """The observations with the longest residual after: where a blunder would show."""
    length = np.nan_to_num(np.hypot(*residuals.after_px.T), nan=np.inf)
    return [
        {
            "image": residuals.images[residuals.image[i]].name,
            "point": residuals.points[i],
            "role": residuals.role(int(i)),
            "x_px": number(residuals.after_px[i, 0]),
            "y_px": number(residuals.after_px[i, 1]),
            "length_px": number(length[i]),
            **one_sizes(residuals.scales, residuals.after_px, int(i)),
            "weight": number(residuals.weight[i]),
        }
        for i in np.argsort(-length, kind="stable")[:_LARGEST]
    ]


def _down_weighted(residuals: Residuals) -> Summary:
    """Control observations that a robust loss took more than half of the weight from."""
    found = np.flatnonzero(residuals.is_control & (residuals.weight < HALF_WEIGHT) & (residuals.weight > 0))
    found = found[np.argsort(residuals.weight[found], kind="stable")]
    return {
        "below_weight": HALF_WEIGHT,
        "count": len(found),
        "observations": [
            {
                "image": residuals.images[residuals.image[i]].name,
                "point": residuals.points[i],
                "weight": number(residuals.weight[i]),
            }
            for i in found
        ],
    }


def _blunders(residuals: Residuals) -> list[Summary]:
    """Control observations that were left out, the largest first."""
    normalised = residuals.reliability.normalised
    found = np.flatnonzero(residuals.weight == 0)
    return [
        {
            "image": residuals.images[residuals.image[i]].name,
            "point": residuals.points[i],
            "x_px": number(residuals.after_px[i, 0]),
            "y_px": number(residuals.after_px[i, 1]),
            "normalised_x": number(normalised[i, 0]),
            "normalised_y": number(normalised[i, 1]),
        }
        for i in found[np.argsort(-residuals.reliability.squared[found], kind="stable")]
    ]


def _detectable(residuals: Residuals) -> list[Summary]:
    """For each image: the redundancy of its control points, and the error that a test at 0.1 % finds four times in five."""
    used = residuals.is_control & (residuals.weight > 0)
    rows = []
    for i, image in enumerate(residuals.images):
        here = used & (residuals.image == i)
        for k, axis in enumerate(("x", "y")):
            if here.any():
                share, error = residuals.reliability.redundancy[here, k], residuals.reliability.detectable_px[here, k]
                rows.append(
                    {
                        "image": image.name,
                        "axis": axis,
                        "n": int(here.sum()),
                        "redundancy_mean": number(share.mean()),
                        "redundancy_min": number(share.min()),
                        "detectable_median_px": number(np.median(error)),
                        "detectable_max_px": number(error.max()),
                    }
                )
    return rows
