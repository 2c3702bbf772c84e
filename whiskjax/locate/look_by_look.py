"""What happened at every look, and what is asked of looks alone, beside what every answer is asked."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from ..estimate.fitted import Dense
from ..estimate.reason import CAUTION, FAILURE, FINE, NOTE, Check, Figures, Said, graded
from ..rules import RESULTS
from ..rules.results import codes_of, is_successful, message_of

_WEAK_RAD = math.radians(2.0)
_OFF = 1.0  # sigma
_DECIDES = 2.0  # times as large is the looks' own sigma


class LookByLook(eqx.Module):
    """What happened at every look, (looks, ...).

    `point_m` (world frame) and `covariance_enu_m2` are the estimate after each look. `innovation_px` is measured minus predicted
    before it, with its covariance and normalised square (NIS, chi-square with 2 degrees of freedom); of a batch it is the
    residual at the solution. A look is used where it was measured and seen (`counts`) and passed the gate; one that repeats an
    earlier look (`is_repeat`) does not count. `result` says of each whether its pose is known, `at_end` whether it can have seen
    the target where the estimate ended, `is_beside` whether it was measured far beside the detector.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.
    """

    point_m: Float[Array, "looks 3"]
    covariance_enu_m2: Float[Array, "looks 3 3"]
    innovation_px: Float[Array, "looks 2"]
    innovation_covariance_px2: Float[Array, "looks 2 2"]
    nis: Float[Array, " looks"]
    is_missed: Bool[Array, " looks"]
    is_repeat: Bool[Array, " looks"]
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


class Sight(NamedTuple):
    """Looks as their own checks see them.

    With the largest angle between two lines of sight, and how well they alone know the distance (1-sigma); how well the answer
    does, and the surface is known on which the target lies (None where nobody says so); how many sigmas a filter ended from
    least squares of the looks that it used; the residuals, None where there is no answer, and the derivatives of the pixels by
    the target's place east, north and up.
    """

    looks: LookByLook
    convergence_rad: Float[Array, ""]
    line_sigma_m: Float[Array, ""]
    distance_sigma_m: Float[Array, ""]
    surface_sigma_m: Float[Array, ""] | None
    off_optimum_sigmas: Float[Array, ""]
    fit: Dense | None
    by_target_px: Float[Array, "looks 2 3"]


def _unplaced(sight: Sight) -> Figures:
    """Looks whose pose is not known, or whose target is behind the camera."""
    code = codes_of(sight.looks.result)
    behind = ~sight.looks.counts & ~sight.looks.is_missed & ~sight.looks.is_repeat & (code == 0)
    return graded(CAUTION, ((code != 0) | behind).any()), {"code": code, "behind": behind}


def _say_unplaced(found: dict[str, Any], _: Sight) -> Iterable[Said]:
    code, behind = found["code"], int(found["behind"].sum())
    for each in np.unique(code[code != 0]).tolist():
        looks = np.flatnonzero(code == each).tolist()
        yield f"{len(looks)} of {len(code)} looks were left out: {message_of(each)}", {"looks": looks}
    if behind:
        said = f"in {behind} of {len(code)} looks the target is behind the camera; they were left out"
        yield said, {"looks": np.flatnonzero(found["behind"]).tolist()}


def _missed(sight: Sight) -> Figures:
    missed = sight.looks.is_missed
    return graded(CAUTION, missed.any()), {"missed": missed}


def _say_missed(found: dict[str, Any], _: Sight) -> Iterable[Said]:
    missed = np.flatnonzero(found["missed"]).tolist()
    yield f"{len(missed)} of {len(found['missed'])} looks have no measurement", {"looks": missed}


def _repeated(sight: Sight) -> Figures:
    repeat = sight.looks.is_repeat & ~sight.looks.is_missed
    return graded(CAUTION, repeat.any()), {"repeat": repeat}


def _say_repeated(found: dict[str, Any], _: Sight) -> Iterable[Said]:
    repeat = np.flatnonzero(found["repeat"]).tolist()
    yield (
        f"{len(repeat)} of {len(found['repeat'])} looks repeat an earlier one, its time, keys and pixel, and were left out: each "
        "is counted once",
        {"looks": repeat},
    )


def _weak(sight: Sight) -> Figures:
    several = sight.looks.is_used.sum() > 1
    figures = {"convergence_rad": sight.convergence_rad, "sigma_m": sight.line_sigma_m}
    return graded(CAUTION, several & (sight.convergence_rad < _WEAK_RAD)), figures


def _say_weak(found: dict[str, Any], _: Sight) -> Iterable[Said]:
    angle, sigma = math.degrees(float(found["convergence_rad"])), float(found["sigma_m"])
    yield (
        f"the lines of sight meet at {angle:.2g} deg only: the distance is known to {sigma:.3g} m (1-sigma, looks alone)",
        {"convergence_deg": angle, "sigma_m": sigma},
    )


def _by_height(sight: Sight) -> Figures:
    """Where the surface knows more of the distance than the looks do."""
    if sight.surface_sigma_m is None:
        return np.asarray(FINE), {}
    return graded(CAUTION, sight.line_sigma_m > _DECIDES * sight.distance_sigma_m), {}


def _say_by_height(_: dict[str, Any], sight: Sight) -> Iterable[Said]:
    assert sight.surface_sigma_m is not None
    surface, looks, both = (float(s) for s in (sight.surface_sigma_m, sight.line_sigma_m, sight.distance_sigma_m))
    yield (
        f"the height of the surface, said to be known to {surface:.3g} m, decides the distance: with it that is known to "
        f"{both:.3g} m, by the looks alone to {looks:.3g} m (1-sigma)",
        {"surface_sigma_m": surface, "distance_sigma_m": both, "sigma_m": looks},
    )


def _beside(sight: Sight) -> Figures:
    """The filter's answer beside that of all looks at once."""
    off = sight.off_optimum_sigmas
    return graded(FAILURE, off > _OFF, graded(CAUTION, off > _OFF / 2, graded(NOTE, ~(off == 0)))), {"sigmas": off}


def _say_beside(found: dict[str, Any], _: Sight) -> Iterable[Said]:
    off = float(found["sigmas"])
    if math.isnan(off):
        yield (
            "nothing stands beside the filter's answer: least squares has no accelerations and gives considered numbers no "
            "weight, or there is no answer",
            {},
        )
        return
    remedy = '; a guess nearer to the target would help, or method="batch"' if off > _OFF / 2 else ""
    yield f"the filter ended {off:.2g} sigma from where least squares of the same looks does{remedy}", {"sigmas": off}


LOOK_CHECKS = (
    Check("looks left out", _unplaced, _say_unplaced),
    Check("looks missed", _missed, _say_missed),
    Check("looks repeated", _repeated, _say_repeated),
    Check("height", _by_height, _say_by_height),
    Check("filter and all looks", _beside, _say_beside),
    Check("convergence", _weak, _say_weak),
)
