"""What a block adjustment found."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...chain.sensor import Sensor
from ...rules import RESULTS
from ...rules.results import codes_of
from ..errors import FrameErrors
from ..estimate import Estimate
from ..unknown import Unknown
from ..variance_components import Components
from ..verdict import UNTESTED, CheckTest, stretched
from .block import Block
from .station_errors import StationErrors


class Trust(NamedTuple):
    """Second moments of the unknowns in the units of their fields, and 1-sigma of the stations' motions (turn rad, shift m).

    `data_share` is 1 - sigma_post^2 / sigma_prior^2 (NaN without a prior).
    """

    covariance: Float[np.ndarray, "q q"]
    sigma: Float[np.ndarray, " q"]
    stations: Float[np.ndarray, "stations 6"]
    data_share: Float[np.ndarray, " q"]


class Statistics(NamedTuple):
    """Of one axis: max, min, mean and root mean square, as Wang et al. (2018) tabulate them."""

    largest: float
    smallest: float
    mean: float
    rmse: float
    count: int

    @classmethod
    def of(cls, errors: Float[np.ndarray, " n"]) -> "Statistics":
        """Of errors (n,); NaN where there is none."""
        if len(errors) == 0:
            return cls(np.nan, np.nan, np.nan, np.nan, 0)
        e = np.asarray(errors)
        return cls(float(e.max()), float(e.min()), float(e.mean()), float(np.sqrt((e**2).mean())), len(e))


@dataclasses.dataclass(frozen=True)
class Adjustment:
    """A solved block; residual = measured - projected, in pixels.

    - `sensor`: with the solution put in; `value`, `start`: of the unknowns, in the units of their fields.
    - `errors`: the statements by which the trajectory was weighed; `motions`: what they say of the link whose motions were
      estimated, None where it was kept.
    - `point_m`, `covariance_m2`: every point, world frame; NaN for points that nobody sees.
    - `used`: rays that took part; `components`: factors on the given sigmas, where weights were estimated (`block` has the new).
    - `residual_px`: (sample or column, line offset or row) of every ray.
    - `cost`: the sum of squared whitened residuals, POS and priors included; `variance_factor` divides it by `freedom`.
    - `check`: the check points' coordinates beside those that came out; `left_out`: check and tie points, by name, that one ray
      alone sees: it takes no part and has no residual (NaN).

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.
    """

    sensor: Sensor
    unknowns: tuple[Unknown, ...]
    value: Float[np.ndarray, " q"]
    start: Float[np.ndarray, " q"]
    trust: Trust
    block: Block
    errors: tuple[FrameErrors, ...]
    motions: StationErrors | None
    point_m: Float[np.ndarray, "points 3"]
    covariance_m2: Float[np.ndarray, "points 3 3"]
    residual_px: Float[np.ndarray, "rays 2"]
    used: Bool[np.ndarray, " rays"]
    components: Components | None
    cost: float
    freedom: int
    variance_factor: float
    tail_probability: float
    is_consistent: bool
    steps: int
    result: RESULTS
    warnings: tuple[str, ...]
    check: CheckTest = UNTESTED
    left_out: tuple[str, ...] = ()

    @property
    def estimate(self) -> Estimate:
        """The unknowns with their joint covariance, points and motions integrated out: knowledge for the next verb."""
        names, places = tuple(x.name for x in self.unknowns), tuple(x.places for x in self.unknowns)
        share, cost = 1 - self.trust.data_share, np.asarray(self.cost)
        return Estimate(self.value, self.trust.covariance, share, cost, self.freedom, self.result, names, places)

    @property
    def is_sound(self) -> bool:
        """Converged, determined, residuals and check points no farther off than chance explains, no sigma stretched beyond
        reason (verdict.py)."""
        consistent = self.is_consistent and self.check.agrees and not stretched(self.components)
        return int(codes_of(self.result)) == 0 and consistent

    def errors_m(self, role: str) -> Float[np.ndarray, "n 3"]:
        """Adjusted less given coordinates of the seen points of a role with known coordinates ("check", "control")."""
        error = (self.point_m - self.block.position_m)[self.block.role == role]
        return error[np.isfinite(error).all(axis=1)]

    def statistics(self, role: str = "check") -> tuple[Statistics, Statistics, Statistics]:
        """Of `errors_m` along x, y and z."""
        x, y, z = (Statistics.of(e) for e in self.errors_m(role).T)
        return x, y, z
