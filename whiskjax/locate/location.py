"""What the looks say about the target, and whether to believe it."""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import unstack
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..earth.ellipsoid import ecef_to_geodetic
from ..earth.surface import AbstractSurface
from ..estimate.accuracy import Accuracy, accuracy
from ..estimate.checks import CHECKS
from ..estimate.error_effects import passing_effects_px
from ..estimate.errors import FrameErrors
from ..estimate.estimate import Estimate
from ..estimate.evidence import Evidence, Grouping, Seen, Words
from ..estimate.model_test import UNLIKELY, chi_square_tail, consistency
from ..estimate.reason import Reason, by_weight, is_sound, judged, warnings
from ..estimate.suspects import Suspects, suspects
from ..rules import RESULTS, Numbers, arrays_of
from ..rules.results import codes_of
from .fitted import Residuals
from .look_by_look import LOOK_CHECKS, LookByLook, Sight
from .two_targets import TWO_TARGETS

_REMEDY = (
    "errors of the recorded poses are missing (errors=...), or are common to all looks (consider=..., estimate=...); do not "
    "believe the covariance"
)


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
    - `off_optimum_sigmas`: how far a filter ended from least squares of the looks that it used; 0 of a batch, NaN where
      the target has accelerations or numbers are considered: least squares then answers another question.
    - `surface_sigma_m`: how well the target was said to lie on the surface; None where nobody said so.
    - `shift`: of each number, in prior sigmas, (k,); `is_estimated`: which were estimated, and not considered.
    - `record`: numbers that tell one look from another; `kinks`: delays whose cost has kinks, and the links that cause them.
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
    off_optimum_sigmas: Float[Array, ""]
    surface_sigma_m: Float[Array, ""] | None
    result: RESULTS
    shift: Float[Array, " k"]
    record: Float[Array, "looks d"]
    _time_s: Float[Array, " looks"] | None
    _residuals: Residuals
    _sensor: Sensor
    _pixel_px: Float[Array, "looks 2"]
    _shot: Shot
    _errors: tuple[FrameErrors, ...]
    _surface: AbstractSurface
    is_estimated: tuple[bool, ...] = eqx.field(static=True)
    kinks: tuple[tuple[str, str], ...] = eqx.field(static=True)
    method: str = eqx.field(static=True)

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
    def considers(self) -> bool:
        """Whether some number was considered."""
        return not all(self.is_estimated)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of `chi_square`."""
        return 2 * int(self.looks.is_used.sum())

    @property
    def tail_probability(self) -> float:
        """How often chance alone gives a `chi_square` as large. Considered errors are common to all looks, whose NIS then are not
        independent: at worst they are one and the same, and their mean is judged as a single one."""
        return float(self._tail)

    @property
    def _tail(self) -> Any:
        freedom = self.estimate.freedom
        if self.considers:
            factor, *_ = consistency(self.chi_square, freedom)
            math = arrays_of(factor)
            return math.exp(-math.nan_to_num(factor))
        return chi_square_tail(self.chi_square, freedom)

    @property
    def is_consistent(self) -> bool:
        """Whether innovations are no larger than their covariance says, and the gate left most looks in."""
        return self.tail_probability > UNLIKELY and 2 * len(self.gated) <= int(self.looks.counts.sum())

    @property
    def evidence(self) -> Evidence:
        """What the checks of the verdict see."""
        looks, n = self.looks, self.looks.nis.shape[0]
        is_judged = arrays_of(self.estimate.covariance) is not jnp and looks.nis.ndim == 1 and not int(codes_of(self.result))
        traced = arrays_of(self.estimate.covariance) is jnp or looks.nis.ndim > 1
        how = "least squares converged" if self.method == "batch" else "the filter went through all looks"
        measured = Seen(
            candidate=looks.counts,
            used=looks.is_used,
            outlying=looks.counts & ~looks.passes,
            code=arrays_of(looks.nis).where(looks.impossible, codes_of(looks.at_end), 0),
            beside=looks.is_beside & looks.passes & ~looks.is_missed,
            record=self.record,
            image=np.zeros(n, dtype=int),
            most=0.5,
            label=_label,
            images=("",),
            groups=() if traced else (_runs(n),),
            along={} if traced or self._time_s is None else {"time": np.asarray(self._time_s)},
        )
        return Evidence(
            estimate=self.estimate,
            estimated=np.array(self.is_estimated, dtype=bool),
            shift=self.shift,
            scale=np.ones(len(self.is_estimated)),
            variance_factor=consistency(self.chi_square, self.estimate.freedom)[0],
            freedom=self.estimate.freedom,
            tail=self._tail,
            kinks=self.kinks,
            words=Words(how, "looks", "look", "innovations", "looks did not pass the gate", _REMEDY),
            seen=measured,
            widened=2 * self.estimate.prior_share if self.considers else 0.0,  # at most
            suspects=self._suspects if is_judged else None,
            fit=self._residuals.fitted() if is_judged else None,
            passing=self._passing,
        )

    def _passing(self) -> tuple[Array, tuple[str, ...]]:
        """What errors that are not stated as constant do to the pixels, and their frames."""
        seen, surface = unstack(jnp.asarray(self._seen_m)), _on_device(self._surface)
        return passing_effects_px(_on_device(self._errors), _on_device(self._sensor), _on_device(self._shot), seen, surface)

    @property
    def _suspects(self) -> Suspects:
        """What was taken as known; of looks that were used."""
        return suspects(
            _on_device(self._sensor), self._shot, self._seen_m, self._pixel_px, self.estimate.places, stated=bool(self._errors)
        )

    @property
    def _seen_m(self) -> Float[np.ndarray, "looks 3"]:
        """Where the target was at each look."""
        moved = 0.0
        if self.velocity_enu_mps is not None and self._time_s is not None:
            away_s = np.asarray(self._time_s) - np.asarray(self._time_s)[-1]
            moved = away_s[:, None] * np.asarray(self.world_from_enu @ self.velocity_enu_mps)
        return np.broadcast_to(np.asarray(self.point_m), self.looks.innovation_px.shape[:1] + (3,)) + moved

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """What speaks for and against the location, failures first."""
        known = jax.tree.map(lambda a: np.asarray(a) if isinstance(a, jax.Array) else a, self)
        evidence = known.evidence
        by_target = known._residuals.by_target_px @ known.world_from_enu
        along = known.line_direction @ known.world_from_enu
        sight = Sight(
            looks=known.looks,
            convergence_rad=known.convergence_rad,
            line_sigma_m=known.line_sigma_m,
            distance_sigma_m=np.sqrt(along @ known.covariance_enu_m2 @ along),
            surface_sigma_m=known.surface_sigma_m,
            off_optimum_sigmas=known.off_optimum_sigmas,
            fit=evidence.fit,
            by_target_px=by_target,
        )
        return by_weight([*judged(CHECKS, evidence), *judged((*LOOK_CHECKS, TWO_TARGETS), sight)])

    @property
    def is_sound(self) -> bool:
        """Whether nothing fails it: an answer whose covariance can be believed, as far as the looks can tell."""
        return is_sound(self.reasons)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a careful person would say, the most serious first."""
        return warnings(self.reasons)


def _on_device(tree: Any) -> Any:
    """Told in numpy, too, a sensor reckons with arrays of the device."""
    return jax.tree.map(lambda a: jnp.asarray(a) if isinstance(a, np.ndarray) else a, tree)


def _runs(looks: int) -> Grouping:
    """The looks in the order of time, in three parts."""
    return Grouping("looks", np.arange(looks) * 3 // max(looks, 1), ("first third", "middle third", "last third"))


def _label(i: int) -> str:
    """A look, named for people."""
    return f"look {i}"
