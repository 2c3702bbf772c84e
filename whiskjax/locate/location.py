"""What the looks say about the target, and whether to believe it."""

import math

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..chain.detector import said_beside
from ..earth.ellipsoid import ecef_to_geodetic
from ..estimate.accuracy import Accuracy, accuracy
from ..estimate.diagnosis import UNLIKELY, chi_square_tail
from ..estimate.estimate import Estimate
from ..rules import RESULTS, Numbers
from ..rules.results import codes_of, is_successful, message_of

_WEAK_RAD = math.radians(2.0)
_SHOWN = 10


class LookByLook(eqx.Module):
    """What happened at every look, (looks, ...).

    `point_m` (world frame) and `covariance_enu_m2` are the estimate after each look. `innovation_px` is measured minus predicted
    before it, with its covariance and normalised square (NIS, chi-square with 2 degrees of freedom); of a batch it is the
    residual at the solution. A look is used where it was measured and seen (`counts`) and passed the gate; `result` says of each
    whether its pose is known, `at_end` whether it can have seen the target where the estimate ended, `is_beside` whether it was
    measured far beside the detector.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.
    """

    point_m: Float[Array, "looks 3"]
    covariance_enu_m2: Float[Array, "looks 3 3"]
    innovation_px: Float[Array, "looks 2"]
    innovation_covariance_px2: Float[Array, "looks 2 2"]
    nis: Float[Array, " looks"]
    is_missed: Bool[Array, " looks"]
    result: RESULTS
    counts: Bool[Array, " looks"]
    passes: Bool[Array, " looks"]
    at_end: RESULTS
    is_beside: Bool[Array, " looks"]

    @property
    def is_used(self) -> Bool[Array, " looks"]:
        """Which looks changed the estimate."""
        return self.counts & self.passes

    @property
    def impossible(self) -> Bool[Array, " looks"]:
        """Looks that changed the estimate, and cannot have seen the target where it ended."""
        return self.is_used & ~is_successful(self.at_end)


class Location(eqx.Module):
    """A located target. Where `result` is not a success the point is NaN: it is no answer.

    **Fields:**

    - `point_m`: world frame, (3,), at the time of the last look.
    - `covariance_enu_m2`: in east, north, up at the target, (3, 3); what is considered is in it.
    - `world_from_enu`: (3, 3), the columns are those axes.
    - `velocity_enu_mps`, `velocity_covariance_enu`: of a moving target; None where it stands.
    - `estimate`: of the numbers of the sensor, those to be estimated first; those considered keep their prior. Its `cost`,
      `chi_square` here, has `freedom` degrees where noise and model are right: the sum of the NIS, of a batch the cost.
    - `looks`: what happened at every look.
    - `convergence_rad`: the largest angle at the target between two lines of sight that were used.
    - `line_m`, `line_direction`: where the estimate ended, and the direction (unit vector of the world frame) of which the looks
      alone know least, with `line_sigma_m` as 1-sigma: the line on which the target lies where its distance is not observable.
    """

    point_m: Float[Array, "3"]
    covariance_enu_m2: Float[Array, "3 3"]
    world_from_enu: Float[Array, "3 3"]
    velocity_enu_mps: Float[Array, "3"] | None
    velocity_covariance_enu: Float[Array, "3 3"] | None
    estimate: Estimate
    looks: LookByLook
    convergence_rad: Float[Array, ""]
    line_m: Float[Array, "3"]
    line_direction: Float[Array, "3"]
    line_sigma_m: Float[Array, ""]
    result: RESULTS
    considers: bool = eqx.field(static=True)

    @property
    def chi_square(self) -> Float[Array, ""]:
        """The squares of innovations, of a batch of residuals, over their covariance."""
        return self.estimate.cost

    @property
    def value(self) -> Float[Array, " k"]:
        """Of the numbers of the sensor, in the units of their fields."""
        return self.estimate.value

    @property
    def geodetic(self) -> tuple[float, float, float]:
        """Latitude and longitude in degrees and ellipsoidal height in metres, of a target in the ECEF world."""
        lat, lon, height = ecef_to_geodetic(self.point_m)
        return math.degrees(lat), math.degrees(lon), float(height)

    def accuracy(self, bias_enu_m: Float[Numbers, "3"] | None = None) -> Accuracy:
        """CEP50, CE90, LE90 and SE90: exact quantiles for the covariance and a bias, if one is known."""
        return accuracy(self.covariance_enu_m2, bias_enu_m)

    @property
    def gated(self) -> tuple[int, ...]:
        """Looks that were seen but left out by the gate, such as gross mis-registrations."""
        return tuple(np.flatnonzero(np.asarray(self.looks.counts & ~self.looks.passes)).tolist())

    @property
    def missed(self) -> int:
        """How many looks have no measurement."""
        return int(self.looks.is_missed.sum())

    @property
    def freedom(self) -> int:
        """Degrees of freedom of `chi_square`."""
        return 2 * int(self.looks.is_used.sum())

    @property
    def tail_probability(self) -> float:
        """How often chance alone gives a `chi_square` as large. Considered errors are common to all looks, whose NIS then are not
        independent: at worst they are one and the same, and their mean is judged as a single one."""
        if self.considers and self.freedom:
            return math.exp(-float(self.chi_square) / self.freedom)
        return chi_square_tail(float(self.chi_square), self.freedom)

    @property
    def is_consistent(self) -> bool:
        """Whether innovations are no larger than their covariance says, and the gate left most looks in."""
        return self.tail_probability > UNLIKELY and 2 * len(self.gated) <= int(self.looks.counts.sum())

    @property
    def is_sound(self) -> bool:
        """An answer whose covariance can be believed, as far as the looks can tell."""
        return bool(is_successful(self.result)) and self.is_consistent

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a careful person would say, the most serious first."""
        said = []
        if not bool(is_successful(self.result)):
            said.append(message_of(int(codes_of(self.result))))
        said += impossible_looks(self)
        n, used = self.looks.nis.shape[0], int(self.looks.is_used.sum())
        said += said_beside(np.asarray(self.looks.is_beside & self.looks.passes & ~self.looks.is_missed), lambda i: f"look {i}")
        if self.tail_probability <= UNLIKELY:
            factor = float(self.chi_square) / max(self.freedom, 1)
            said.append(
                f"innovations are {math.sqrt(factor):.3g} times as large as their covariance says: errors of the recorded poses "
                "are missing (errors=...), or are common to all looks (consider=..., estimate=...); do not believe the covariance"
            )
        if self.gated:
            named = ", ".join(map(str, self.gated[:_SHOWN])) + (", ..." if len(self.gated) > _SHOWN else "")
            said.append(f"{len(self.gated)} of {n} looks did not pass the gate: {named}")
        codes = codes_of(self.looks.result)
        for code in np.unique(codes[codes != 0]).tolist():
            said.append(f"{int((codes == code).sum())} of {n} looks were left out: {message_of(code)}")
        unseen = int((~self.looks.counts & ~self.looks.is_missed & (codes == 0)).sum())
        if unseen:
            said.append(f"in {unseen} of {n} looks the target is behind the camera; they were left out")
        if self.missed:
            said.append(f"{self.missed} of {n} looks have no measurement")
        if used > 1 and float(self.convergence_rad) < _WEAK_RAD:
            said.append(
                f"the lines of sight meet at {math.degrees(float(self.convergence_rad)):.2g} deg only: the distance is known to "
                f"{float(self.line_sigma_m):.3g} m (1-sigma, looks alone)"
            )
        return tuple(said)


def impossible_looks(answer: Location) -> list[str]:
    """Names the first look that cannot have seen the target where the estimate ended, and how many there are; empty for none."""
    wrong = np.flatnonzero(np.asarray(answer.looks.impossible))
    if not wrong.size:
        return []
    more = f" ({len(wrong)} of {answer.looks.nis.shape[0]} looks fail)" if len(wrong) > 1 else ""
    code = int(codes_of(answer.looks.at_end)[wrong[0]])
    return [f"where the estimate ended, look {wrong[0]}: {message_of(code)}{more}"]
