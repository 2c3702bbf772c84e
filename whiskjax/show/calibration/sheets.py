"""CSV files of a calibration: the figures of its summary, and every observation, at full precision for other programs."""

from collections.abc import Sequence
from pathlib import Path

from ...estimate.unknown import Unknown
from ..plain import Summary, number
from ..scales import place_columns, scale_columns, scale_values
from ..sheets import write_csv
from .residuals import Residuals


def write_parameters(path: Path, summary: Summary) -> None:
    """parameters.csv: one row an unknown, figures in the unit of its `unit` column."""
    keys = ("name", "unit", "prior_mean", "prior_sigma", "start", "value", "sigma", "data_share", "from_prior_sigmas")
    write_csv(path, (*keys, "where"), ([*(p[key] for key in keys), " ".join(p["where"])] for p in summary["parameters"]))


def write_statistics(path: Path, summary: Summary) -> None:
    """statistics.csv: one row for each image (empty: all), role, axis and stage."""
    keys = ("image", "role", "axis", "axis_name", "stage", "n", "mean_px", "std_px", "max_abs_px", "rms_px", "rms_lines", "rms_m")
    write_csv(path, keys, ([row[key] for key in keys] for row in summary["residuals"]))


def write_residuals(path: Path, residuals: Residuals) -> None:
    """residuals.csv: one row an observation, with its place in the image, its sigmas and weight, and its reliability.

    Of a line camera x is along the detector line and y across it, in focal-plane pixels; `line` and `y_after_lines` count lines.
    """
    header = (
        "image", "point", "role", "time_s", *place_columns(residuals.is_line), "x_before_px", "y_before_px", "x_after_px",
        "y_after_px", "sigma_x_px", "sigma_y_px", "weight", "redundancy_x", "redundancy_y", "normalised_x", "normalised_y",
        "detectable_x_px", "detectable_y_px", *scale_columns(residuals.is_line, "{}_after_{}"),
    )  # fmt: skip
    scaled = scale_values(residuals.scales, residuals.after_px)
    times = [None] * len(residuals) if residuals.time_s is None else residuals.time_s.tolist()
    columns = (residuals.place, residuals.before_px, residuals.after_px, residuals.sigma_px)
    rows = (
        [
            residuals.images[residuals.image[i]].name,
            residuals.points[i],
            residuals.role(i),
            times[i],
            *(float(v) for column in columns for v in column[i]),
            float(residuals.weight[i]),
            *(number(v) for column in residuals.reliability[:3] for v in column[i]),
            *map(number, scaled[i]),
        ]
        for i in range(len(residuals))
    )
    write_csv(path, header, rows)


def write_truth(path: Path, unknowns: Sequence[Unknown]) -> None:
    """truth.csv of a simulated flight: the true values, given as the prior means of `unknowns`, in their unit."""
    rows = ((x.name, x.unit.name, x.mean * x.unit.factor) for x in unknowns if x.mean is not None)
    write_csv(path, ("name", "unit", "value"), rows)
