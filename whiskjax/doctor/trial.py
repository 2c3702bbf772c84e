"""One remedy tried: the flight with it fitted robustly, and what that costs."""

import dataclasses
import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..algebra.vectors import unstack
from ..estimate.error_effects import white_covariance_px2
from ..estimate.linearised import LeastSquares, Linearised, linearise, prepare, whitening
from ..estimate.observations import Observations
from ..estimate.surveys import triangles
from ..estimate.unknown import Unknown
from ..flights.flight import Flight
from ..rules import RESULTS, WhiskjaxError, compiled
from ..rules.results import codes_of
from .remedy import Remedy
from .robust import Fit, Rows, covariance, fit, loss
from .uniform import uniform, whitened_errors

# The squared length of a residual of what cannot have been imaged at all, in sigmas: as bad as anything.
_IMPOSSIBLE = 1e10
# What leaving one measurement out costs: as much as one that is three sigmas and a half off.
LEFT_OUT = 12.0
# An angle that ends so far from its start is none of a mount, and a focal length so many times its start none of a lens, whatever
# their priors: they cost what tells two remedies apart.
_FAR_RAD, _FAR_TIMES, _FAR_COST, _MUCH = math.radians(20.0), 1.5, 25.0, 100.0
_NO_POSE = tuple(int(codes_of(code)) for code in (RESULTS.time_outside_trajectory, RESULTS.time_in_gap, RESULTS.unknown_key))


@dataclasses.dataclass(frozen=True)
class Trial:
    """What became of a remedy.

    - `flight`: with the remedy, as it would be written.
    - `cost`: what ranks it: robust chi-square, the priors', what it leaves out or cannot image, and the logarithm by which the
      sigmas grew, so that nothing is explained by a geometry that blows up what is not known.
    - `chi_square`, `freedom`: the robust one, with the priors' part, and its degrees of freedom.
    - `before_px`, `after_px`: length of the median residual before and after the fit; None where nothing is imaged.
    - `value`, `start`: of the flight's unknowns, in the units of their fields; `prior_sigmas`: how far from their prior means.
    - `amount`, `amount_sigma`: of the remedy, where it has one.
    - `start_px`: residuals at the start, (n, 2); `squared`: squared whitened lengths at the end, (n,); `lost`: not imaged, (n,).
    - `end`: where the fit ended, whitened; it can go on from there.
    """

    remedy: Remedy
    flight: Flight
    cost: float
    chi_square: float
    freedom: int
    before_px: float | None
    after_px: float | None
    value: Float[np.ndarray, " k"]
    start: Float[np.ndarray, " k"]
    prior_sigmas: Float[np.ndarray, " k"]
    amount: float | None
    amount_sigma: float | None
    start_px: Float[np.ndarray, "n 2"]
    squared: Float[np.ndarray, " n"]
    lost: Bool[np.ndarray, " n"]
    end: Any

    @property
    def factor(self) -> float:
        """How many times as large as their sigmas the residuals are."""
        return math.sqrt(max(self.chi_square, 0.0) / self.freedom) if self.freedom > 0 else math.inf


@dataclasses.dataclass(frozen=True)
class _Posed:
    """A flight ready to be fitted."""

    ready: LeastSquares
    observations: Observations


def _pose(flight: Flight, weigh: bool = True) -> _Posed:
    """**Arguments:** `weigh`: what is stated of the records' errors widens the residuals."""
    made = uniform(flight)
    seen = made.observations()
    ready = prepare(made.sensor, seen, made.unknowns, None)
    errors = whitened_errors(made)
    if weigh and errors:
        effect = _white(errors, made.sensor, seen.shot, unstack(seen.point_m), made.world.surface(0.0))
        fixed = ready.fixed_px2 + np.nan_to_num(np.asarray(effect), nan=0.0, posinf=0.0, neginf=0.0)
        ready = dataclasses.replace(ready.weighted(whitening(seen.sigma_px, fixed)), fixed_px2=fixed)
    return _Posed(ready, seen)


_white = compiled(white_covariance_px2, lambda errors, sensor, shot, point, surface: len(point[0]))


def attempt(
    remedy: Remedy, flight: Flight, steps: int, projected_px: Float[np.ndarray, "n 2"] | None = None, known: Any = None
) -> Trial | str:
    """Try a remedy on a flight whose measurements all have coordinates.

    **Arguments:** `steps`: of the fit; `projected_px`: where the points are imaged in the flight as given, for a first guess of
    the amount; `known`: where an earlier fit of it ended.

    **Returns:** the trial, or why there is none: whatever is refused on the way says only that this is no cure.
    """
    try:
        return _attempt(remedy, flight, steps, projected_px, known)
    except (WhiskjaxError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return str(error)


def _attempt(remedy: Remedy, flight: Flight, steps: int, projected_px: Any, known: Any) -> Trial:
    amount = remedy.amount
    at = amount.mean if amount is not None else None
    if amount is not None and amount.guess is not None and projected_px is not None:
        at = min(max(amount.guess(flight, projected_px), amount.least), amount.most)
    if known is not None and amount is not None:
        at = amount.inside(float(known[-1]))
    first = _pose(remedy.apply(flight, at))
    k = len(first.ready.start)
    left = _left_out(remedy, first.observations)
    no_pose = np.isin(first.ready.unseen, _NO_POSE)
    used = ~left & ~no_pose

    def posed(v: float | None) -> LeastSquares:
        return first.ready if v == at else _pose(remedy.apply(flight, v)).ready

    def of(x: np.ndarray) -> Rows:
        if amount is None:
            return _rows(first.ready, linearise(first.ready, x))
        v, h = amount.inside(float(x[k])), amount.step
        ready = posed(v)
        here, aside = linearise(ready, x[:k]), linearise(_pose(remedy.apply(flight, v + h), False).ready, x[:k])
        with np.errstate(invalid="ignore", over="ignore"):
            moved = (aside.residual_px - here.residual_px) * (amount.sigma / h)
            by = np.einsum("nij,nj->ni", triangles(ready.weight), moved)[:, :, None]
        rows = _rows(ready, here)
        prior = np.append(rows.prior, x[k])
        prior_by = np.pad(rows.prior_by, ((0, 1), (0, 1)))
        prior_by[-1, -1] = 1.0
        return Rows(rows.residual, np.concatenate([rows.by, by], axis=2), prior, prior_by)

    start = np.append(first.ready.start, [] if amount is None or at is None else [(at - amount.mean) / amount.sigma])
    end = fit(of, start if known is None else known, used, steps)
    value = None if amount is None else amount.inside(float(end.x[k]))
    return _judged(remedy, flight, posed(value), end, used, left, no_pose, value)


def _rows(ready: LeastSquares, here: Linearised) -> Rows:
    return Rows(here.whitened, here.rows, ready.prior @ here.u, ready.prior)


def _left_out(remedy: Remedy, seen: Observations) -> Bool[np.ndarray, " n"]:
    if remedy.without is None:
        return np.zeros(len(seen), dtype=bool)
    kind, name = remedy.without
    return np.array(seen.images if kind == "image" else seen.points) == name


def _judged(
    remedy: Remedy,
    flight: Flight,
    ready: LeastSquares,
    end: Fit,
    used: np.ndarray,
    left: np.ndarray,
    no_pose: np.ndarray,
    amount: float | None,
) -> Trial:
    k = len(ready.start)
    u = end.x[:k]
    here = linearise(ready, u)
    lost = no_pose | (here.unseen != 0) | ~np.isfinite(here.whitened).all(axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        z = np.where(lost, _IMPOSSIBLE, np.minimum((here.whitened**2).sum(axis=1), _IMPOSSIBLE))
    priors = end.rows.prior
    chi_square = float(loss(z)[~left].sum() + priors @ priors)
    widened = -2 * np.log(np.abs(ready.weight[:, 0] * ready.weight[:, 2]) * ready.observations.sigma_px.prod(axis=1))
    widened = float(np.where(np.isfinite(widened), widened, 100.0)[~left & ~no_pose].sum())
    start, value = ready.values(ready.start), ready.values(u)
    far = [how_far(x, v, s) for x, v, s in zip(flight.unknowns, value, start, strict=False)]
    freedom = int(2 * (~left).sum() + len(priors) - int(_without_prior(ready)) - len(end.x))
    away = np.linalg.norm(here.residual_px, axis=1)
    return Trial(
        remedy=remedy,
        flight=flight,
        cost=chi_square + widened + _FAR_COST * sum(f**2 for f in far if f > 1) + LEFT_OUT * int(left.sum()),
        chi_square=chi_square,
        freedom=freedom,
        before_px=_median(np.linalg.norm(ready.before_px, axis=1)[~no_pose & ~left]),
        after_px=_median(away[~lost & ~left]),
        value=value,
        start=start,
        prior_sigmas=np.where(ready.has_prior, u, np.nan),
        amount=amount,
        amount_sigma=None if remedy.amount is None else remedy.amount.sigma * float(np.sqrt(covariance(end, used)[-1, -1])),
        start_px=ready.before_px,
        squared=z,
        lost=lost,
        end=end.x,
    )


def how_far(unknown: Unknown, value: float, start: float) -> float:
    """How far an unknown ended from its start, where 1 is what no such number moves by; 0 for what may move anywhere."""
    if unknown.unit.name == "deg":
        return abs(value - start) / _FAR_RAD
    if unknown.places[0].path[-1] == "focal_px":
        return abs(math.log(value / start)) / math.log(_FAR_TIMES) if value / start > 0 else _MUCH
    return 0.0


def _without_prior(ready: LeastSquares) -> int:
    """Rows of priors that say nothing."""
    return int((~ready.has_prior).sum())


def _median(lengths: np.ndarray) -> float | None:
    known = lengths[np.isfinite(lengths)]
    return float(np.median(known)) if known.size else None
