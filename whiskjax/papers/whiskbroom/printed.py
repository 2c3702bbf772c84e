"""What Jin et al. (2024) print in Tables 1 to 7, and the bands within which a correct implementation lies.

Plain data. Bands are those of the scenario: the seed-to-seed spread of an independent implementation. Images have the names of
section 3.2; those of section 3.1 are the same ones by their figures: A = L1, B = R2, C = L2.
"""

from typing import NamedTuple

from ...flights.haian import TABLE_4 as _TRUTH
from ...flights.haian import unknowns


class Column(NamedTuple):
    """Residuals of an image's points ("control", "check" or "all") with parameters applied.

    Parameters are "none" (before the calibration), "A" (Table 1: 12 unknowns from L1), "CL" or "CR" (Table 4: 15 unknowns from L1
    and R1, with the R_pos of the left or of the right swing).
    """

    image: str
    parameters: str
    points: str

    @property
    def is_cross(self) -> bool:
        """Whether the parameters are those of the other swing."""
        return self.parameters != "none" and (self.image[0] == "R") != (self.parameters == "CR")


class Printed(NamedTuple):
    """A table of residuals: means and standard deviations in px, x and y of each column in turn, as printed."""

    number: int
    title: str
    columns: tuple[Column, ...]
    mean_px: tuple[float, ...]
    std_px: tuple[float, ...]


class Band(NamedTuple):
    """Where a figure lies when all is well."""

    low: float
    high: float


# Metres and degrees.
TABLE_1 = {
    "u_gps": 0.11769176,
    "v_gps": -0.20226726,
    "w_gps": 0.94924788,
    "omega_pos_left": 2.74530517,
    "phi_pos_left": 0.00568162,
    "kappa_pos_left": -0.11126237,
    "u_sen": 0.12143093,
    "v_sen": 0.220243216,
    "w_sen": -1.68039402,
    "omega_sen": 0.00870534,
    "phi_sen": -0.46989301,
    "kappa_sen": -0.11122231,
}
TABLE_4 = {x.name: round((x.mean or 0.0) * x.unit.factor, 7) for x in unknowns(mean=_TRUTH)}

TABLES = (
    Printed(
        2,
        "Image A (L1) before and after the calibration from A",
        (Column("L1", "none", "control"), Column("L1", "A", "control")),
        (-83.55439, 516.95416, -0.07687, 0.05065),
        (10.26817, 2.39046, 3.079024, 2.14255),
    ),
    Printed(
        3,
        "Images B (R2) and C (L2) with the parameters from A",
        (Column("R2", "A", "all"), Column("L2", "A", "all")),
        (-2.78105, -8.95798, -0.38246, 0.45621),
        (3.75642, 1.18556, 2.11527, 2.23550),
    ),
    Printed(
        5,
        "Image R1 before and after the calibration from L1 and R1",
        (Column("R1", "none", "control"), Column("R1", "CR", "control"), Column("R1", "CR", "check")),
        (-84.12383, 507.50707, -0.0321, 0.00650, -0.56318, 0.21002),
        (6.71241, 2.38129, 1.65396, 2.27606, 1.94998, 1.65745),
    ),
    Printed(
        6,
        "Image L1 before and after the calibration from L1 and R1",
        (Column("L1", "none", "control"), Column("L1", "CL", "control"), Column("L1", "CL", "check")),
        (-83.55438, -516.95415, 0.03602, 0.03808, -0.90932, -0.06469),
        (10.26816, 2.39046, 3.24190, 2.36275, 2.86406, 1.94121),
    ),
    Printed(
        7,
        "Image L2 before and after, with the right (CR) and the left parameters (CL)",
        (Column("L2", "none", "all"), Column("L2", "CR", "all"), Column("L2", "CL", "all")),
        (-88.38606, -515.7266, -0.92216, -9.53635, -0.36094, 0.04731),
        (9.43007, 2.23205, 4.03313, 2.4928, 2.11697, 2.29086),
    ),
    Printed(
        7,
        "Image R2 before and after, with the left (CL) and the right parameters (CR)",
        (Column("R2", "none", "all"), Column("R2", "CL", "all"), Column("R2", "CR", "all")),
        (-81.06287, 506.71058, -2.64161, -9.03783, 0.10917, 0.70589),
        (7.65742, 2.07320, 3.63255, 1.16520, 2.12611, 1.18623),
    ),
    Printed(
        7,
        "Image L3 before and after, with the right (CR) and the left parameters (CL)",
        (Column("L3", "none", "all"), Column("L3", "CR", "all"), Column("L3", "CL", "all")),
        (-85.9099, -516.0925, -0.9589, -10.1106, -1.5988, -0.7042),
        (10.7998, 1.8376, 4.6701, 1.3952, 2.2586, 1.5273),
    ),
    Printed(
        7,
        "Image R3 before and after, with the left (CL) and the right parameters (CR)",
        (Column("R3", "none", "all"), Column("R3", "CL", "all"), Column("R3", "CR", "all")),
        (-86.7984, 506.7980, -2.6196, -9.6060, -1.9693, -0.1518),
        (11.7372, 2.0932, 3.0055, 2.2485, 5.9378, 2.2250),
    ),
)

# (statistic, axis) of a column. The bands of check points are of the absolute mean.
BANDS: dict[tuple[Column, str, str], Band] = {
    (Column("L1", "none", "control"), "mean", "y"): Band(-518.3, -516.3),
    (Column("R1", "none", "control"), "mean", "y"): Band(507.0, 509.1),
    (Column("L1", "none", "control"), "mean", "x"): Band(-89.5, -86.5),
    (Column("R1", "none", "control"), "mean", "x"): Band(-90.4, -88.0),
    (Column("L1", "none", "control"), "std", "x"): Band(8.7, 10.8),
    (Column("R1", "none", "control"), "std", "x"): Band(5.7, 7.1),
    (Column("L1", "CL", "control"), "std", "x"): Band(2.4, 3.7),
    (Column("R1", "CR", "control"), "std", "x"): Band(1.2, 1.9),
    (Column("L1", "CL", "control"), "std", "y"): Band(1.75, 2.66),
    (Column("R1", "CR", "control"), "std", "y"): Band(1.69, 2.57),
    (Column("L1", "CL", "check"), "mean", "x"): Band(0.0, 2.1),
    (Column("R1", "CR", "check"), "mean", "x"): Band(0.0, 2.1),
    (Column("L1", "CL", "check"), "mean", "y"): Band(0.0, 1.75),
    (Column("R1", "CR", "check"), "mean", "y"): Band(0.0, 1.75),
    (Column("L2", "CR", "all"), "mean", "y"): Band(-11.0, -7.7),
    (Column("R2", "CL", "all"), "mean", "y"): Band(-10.7, -8.3),
    (Column("L2", "CR", "all"), "std", "x"): Band(2.6, 5.5),
    (Column("R2", "CL", "all"), "std", "x"): Band(2.9, 5.5),
    (Column("L3", "CL", "all"), "mean", "x"): Band(-3.4, 0.2),
    (Column("R3", "CR", "all"), "mean", "x"): Band(-3.1, -0.2),
    (Column("R3", "CR", "all"), "std", "x"): Band(4.4, 7.3),
}


def is_absolute(column: Column, statistic: str) -> bool:
    """Whether the scenario speaks of the absolute value: the means of check points, which lie around zero."""
    return column.points == "check" and statistic == "mean"


def tuned_by(column: Column, statistic: str, axis: str) -> tuple[str, ...]:
    """Which of the scenario's tuned numbers (focal length, image noise, drift) a figure's agreement with the paper rests on.

    Empty where it follows: from Table 4, which is the simulated truth, from the geometry and from the model.
    """
    if column.parameters == "none":
        return {("mean", "y"): ("focal length",), ("std", "y"): ("image noise",)}.get((statistic, axis), ())
    drifted = column.image in ("L3", "R3")
    if statistic == "mean":
        return ("drift",) if drifted else ()
    if axis == "x" and column.is_cross:
        return ("drift",) if drifted else ()  # mostly the kappa of the wrong swing
    return ("image noise", "drift") if drifted and axis == "x" else ("image noise",)
