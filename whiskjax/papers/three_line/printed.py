"""What Wang et al. (2018) print in Tables 1 to 6, and the bands of the scenario."""

from typing import NamedTuple

STAGES = ("direct", "adjusted", "second direct", "third direct")
CONTROL_POINTS = (3, 5, 7, 9, 11)


class Row(NamedTuple):
    """A row of the paper's Tables 1, 2, 4, 5 and 6: table, data set, and the trial or the number of control points."""

    table: int
    data: str
    trial: str


def _printed(*rows: tuple[float, ...]) -> dict[str, tuple[tuple[float, ...], ...]]:
    """Max, min, mean and RMSE along X, Y and Z, by trial."""
    return {trial: (r[:4], r[4:8], r[8:]) for trial, r in zip(STAGES, rows, strict=True)}


_TABLE_1 = _printed(
    (6.340, -4.739, 1.402, 3.897, 5.073, -4.980, 1.438, 3.654, -2.803, -8.932, -6.930, 6.487),
    (0.643, -0.503, -0.018, 0.224, 0.408, -0.586, -0.015, 0.234, 1.392, -1.767, 0.076, 0.579),
    (4.763, -4.003, 1.409, 3.311, 4.475, -3.833, 1.264, 3.211, 2.788, -1.721, 0.301, 0.992),
    (0.560, -0.856, -0.002, 0.320, 0.740, -0.744, 0.001, 0.302, 1.513, -1.545, -0.116, 0.664),
)
_TABLE_2 = _printed(
    (4.625, -3.186, 0.880, 3.256, 4.634, -4.020, 0.369, 3.344, -3.777, -7.806, -6.386, 6.218),
    (0.531, -0.654, 0.024, 0.189, 0.345, -0.246, 0.037, 0.146, 1.3057, -0.877, 0.046, 0.420),
    (3.560, -2.292, 0.882, 2.675, 2.807, -2.529, 0.278, 2.394, 2.331, -1.727, 0.449, 1.061),
    (0.836, -0.167, 0.187, 0.428, 0.587, -0.225, 0.143, 0.253, 1.137, -1.529, -0.019, 0.551),
)
_TABLE_4 = {
    "A": (0.712, -0.957, -0.015, 0.367, 0.839, -0.943, 0.032, 0.467, 1.613, -1.557, -0.136, 0.765),
    "B": (0.903, -0.206, 0.205, 0.513, 0.624, -0.406, 0.189, 0.392, 1.567, -1.722, -0.092, 0.732),
}
_TABLE_5 = (
    (0.672, -0.827, -0.010, 0.337, 0.789, -0.953, 0.027, 0.432, 1.526, -1.425, -0.121, 0.689),
    (0.654, -0.669, -0.008, 0.301, 0.618, -0.678, 0.008, 0.348, 1.423, -1.520, 0.080, 0.632),
    (0.642, -0.513, -0.008, 0.256, 0.423, -0.552, 0.008, 0.247, 1.396, -1.489, 0.078, 0.598),
    (0.643, -0.512, -0.007, 0.223, 0.411, -0.523, 0.007, 0.234, 1.385, -1.490, 0.070, 0.587),
    (0.641, -0.511, -0.007, 0.221, 0.401, -0.521, 0.007, 0.223, 1.390, -1.467, 0.069, 0.581),
)
_TABLE_6 = (
    (0.901, -0.189, 0.185, 0.478, 0.609, -0.386, 0.181, 0.347, 1.426, -1.567, -0.068, 0.652),
    (0.680, -0.167, 0.112, 0.389, 0.467, -0.312, 0.121, 0.264, 1.320, -1.212, -0.045, 0.517),
    (0.668, -0.152, 0.078, 0.292, 0.361, -0.289, 0.082, 0.173, 1.239, -0.921, 0.042, 0.469),
    (0.589, -0.149, 0.032, 0.230, 0.356, -0.223, 0.032, 0.151, 1.238, -0.822, 0.040, 0.422),
    (0.529, -0.145, 0.022, 0.209, 0.343, -0.214, 0.033, 0.143, 1.235, -0.815, 0.041, 0.418),
)
PRINTED: dict[Row, tuple[tuple[float, ...], ...]] = {
    **{Row(1, "A", trial): values for trial, values in _TABLE_1.items()},
    **{Row(2, "B", trial): values for trial, values in _TABLE_2.items()},
    **{Row(4, data, "third direct, mean of A and B"): (r[:4], r[4:8], r[8:]) for data, r in _TABLE_4.items()},
    **{Row(5, "A", f"{n} control"): (r[:4], r[4:8], r[8:]) for n, r in zip(CONTROL_POINTS, _TABLE_5, strict=True)},
    **{Row(6, "B", f"{n} control"): (r[:4], r[4:8], r[8:]) for n, r in zip(CONTROL_POINTS, _TABLE_6, strict=True)},
}
# Metres and degrees, u, v, w, ex, ey, ez.
TABLE_3 = {
    "A": (0.00893445433, 0.00723273239, -0.02865977941, -0.08002270187, -0.05307554749, -0.01646119989),
    "B": (0.0061857732, 0.00464960461, -0.00387804895, -0.0722768518, -0.07785861804, -0.01873454298),
}
# RMSE of X, Y, Z that an independent implementation got, nominal; and where ours is accepted.
_SCENARIO = {
    Row(1, "A", "direct"): (2.78, 2.75, 8.05),
    Row(1, "A", "adjusted"): (0.047, 0.032, 0.107),
    Row(1, "A", "second direct"): (2.57, 2.63, 0.89),
    Row(1, "A", "third direct"): (0.235, 0.197, 0.378),
    Row(2, "B", "adjusted"): (0.031, 0.040, 0.138),
    Row(2, "B", "third direct"): (0.175, 0.174, 0.290),
    Row(4, "A", "third direct, mean of A and B"): (0.253, 0.177, 0.376),
    Row(4, "B", "third direct, mean of A and B"): (0.172, 0.179, 0.277),
    Row(5, "A", "3 control"): (0.037, 0.038, 0.134),
    Row(5, "A", "11 control"): (0.032, 0.035, 0.091),
}
_BANDS = {
    Row(1, "A", "adjusted"): ((0.0, 0.06), (0.0, 0.06), (0.0, 0.14)),
    Row(1, "A", "third direct"): ((0.11, 0.26), (0.14, 0.25), (0.17, 0.40)),
}


class Band(NamedTuple):
    """RMSE along one axis: what an independent implementation got (None: not said), and from where to where it is accepted."""

    independent: float | None
    low: float | None
    high: float | None


def band(row: Row, axis: int) -> Band:
    """Of a row's nominal RMSE."""
    low, high = _BANDS.get(row, ((None, None),) * 3)[axis]
    return Band(_SCENARIO.get(row, (None,) * 3)[axis], low, high)


def contradictions() -> list[Row]:
    """Printed rows with an RMSE below the absolute mean, which no set of numbers has."""
    return [row for row, axes in PRINTED.items() if any(rmse < abs(mean) for *_, mean, rmse in axes)]
