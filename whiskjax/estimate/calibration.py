"""A calibrated sensor, and what says how far to trust it."""

from functools import cached_property
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..chain.detector import lies_beside
from ..chain.parameters import Places
from ..chain.sensor import Sensor
from ..rules import RESULTS, arrays_of
from .check_points import UNTESTED, CheckTest, check_test, common_shift, joint_chi_square
from .checks import CHECKS
from .estimate import Estimate
from .evidence import Evidence, Seen, Words, courses, groupings, kinks, numbered, records
from .far_turns import far_turns
from .fitted import Dense
from .linearised import LeastSquares, Linearised, independent
from .model_test import consistency
from .observations import Observations
from .posterior import Posterior, posterior
from .reason import Reason, by_weight, is_sound, judged, warnings
from .reliability import Reliability, foreseen, log_density, of_common_points, reliability
from .surveys import triangles
from .suspects import Suspects, suspects
from .unknown import Unknown
from .variance_components import Components
from .weight_uncertainty import Uncertain

WORDS = Words(
    how="the iteration converged",
    noun="observations",
    observed="control observation",
    residuals="residuals",
    outliers="control observations were left out as blunders",
    remedy="the model lacks something, or the sigmas are too small, or there are blunders",
)
# Under a robust loss, a residual of more sigmas than this is a blunder and does not count in the model test (chance: 3e-4).
BLUNDER = 4.0


class Fit(NamedTuple):
    """How well the model meets the observations: chi-square over degrees of freedom, its tail probability, the verdict.

    What was considered counts: residuals are weighed by their whole covariance (`Considered`), and are as large as all that was
    said lets them be where the variance factor is 1. Blunders are left out; where they are, the verdict asks that most
    observations are none. `check` is what the check points say.
    """

    variance_factor: float
    tail_probability: float
    is_consistent: bool
    degrees_of_freedom: int
    check: CheckTest = UNTESTED


class Considered(NamedTuple):
    """What c numbers that were not estimated do, one sigma of each: to every residual in pixels, and to the whitened unknowns.

    A change of them moves the solution by -C J^T P H c (Schmidt 1966), with H the derivatives by them; `moved` is that without
    its sign, so that its square widens the covariance. `effect` is H as whitened as the residuals.

    They make residuals larger, and the model test has to know. With J and H whitened, priors as further rows (of H zero), the
    errors before the fit have the covariance 1 + H H^T; the fit takes M = 1 - J C J^T of them, so that the residuals e have
    M + E E^T with E = M H. M is a projector of as many dimensions as there are degrees of freedom, which leaves e and E as they
    are; there (1 + E E^T)^-1 is the inverse of the covariance, and

        e^T (1 + E E^T)^-1 e = |e|^2 - e^T E (1 + E^T E)^-1 E^T e

    is chi-square of those degrees exactly. It is also the least |e + E c|^2 + |c|^2 over c: what the cost would be, had the
    numbers been estimated with their priors; as many more priors as numbers leave the degrees of freedom where they are.
    """

    effect_px: Float[Any, "n 2 c"]
    effect: Float[Any, "n 2 c"]
    moved: Float[Any, "k c"]

    @classmethod
    def of(
        cls, ready: LeastSquares, here: Linearised, formal: Float[Any, "k k"], share: Float[Any, " n"], effect_px: Any
    ) -> "Considered":
        """From what they do to the residuals in pixels; `formal`: covariance C of the whitened unknowns without them.

        **Arguments:** `here`: rays of one point weighed together; `share`: zero for observations that did not decide.
        """
        seen = here._replace(rows=triangles(ready.weight) @ effect_px, rows_px=effect_px)
        effect = independent(ready, seen, (share > 0).astype(float)).rows
        moved = formal @ arrays_of((effect, formal)).einsum("n,nik,nij->kj", share, here.rows, effect)
        return cls(effect_px, effect, moved)

    def explains(self, ready: LeastSquares, here: Linearised, kept: Bool[Any, " n"]) -> Any:
        """How much of the sum of squared residuals the numbers explain: e^T E (1 + E^T E)^-1 E^T e of what was kept."""
        math = arrays_of((self.effect, here.rows, kept))
        left = math.where(kept[:, None, None], self.effect - here.rows @ self.moved, 0.0)
        by_priors = ready.prior @ self.moved
        seen = math.einsum("nic,ni->c", left, here.whitened) - by_priors.T @ (ready.prior @ here.u)
        inner = math.eye(len(seen)) + math.einsum("nic,nid->cd", left, left) + by_priors.T @ by_priors
        return seen @ math.linalg.solve(inner, seen)

    def covariance(self, scale: Float[Any, " k"]) -> Float[Any, "k k"]:
        """What they add to the covariance of the unknowns, in the units of the fields."""
        by = self.moved * scale[:, None]
        return by @ by.T


class Calibration(eqx.Module):
    """A calibrated sensor, and what says how far to trust it.

    Values and sigmas are in the unit of the fields (m, rad, s, px); `Unknown.unit` shows them to people. Residuals are measured -
    projected in pixels, (n, 2) as (sample or column, line offset or row), for control and check points alike. Where weights were
    estimated, `unknowns` and `observations` carry the new sigmas, and `components` the factors; else it is None.

    Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not lines:
    one line is `px_per_line` of them.

    `robust_weight` is 1 for a good observation, less under a robust loss, 0 for a blunder that was left out.
    `used` are the observations that decided: control points that are no blunders.

    Under jit, vmap and derivatives `sensor`, `estimate`, `residual_after_px` and `result` are traced; what is told to people
    (`posterior`, `fit`, `reliability`, `warnings`) is worked out when somebody looks at it, outside.
    """

    sensor: Sensor
    unknowns: tuple[Unknown, ...]
    start: Float[Any, " k"]
    estimate: Estimate
    used: Bool[Any, " n"]
    components: Components | None
    steps: Any
    _ready: LeastSquares
    _here: Linearised
    _formal: Float[Any, "k k"]
    _considered: Considered | None
    _uncertain: Uncertain | None
    _share: Float[Any, " n"]
    _most: float = eqx.field(static=True)
    _considered_places: Places = eqx.field(static=True)
    _states_poses: bool = eqx.field(static=True)

    @property
    def value(self) -> Float[Any, " k"]:
        """Of the unknowns."""
        return self.estimate.value

    @property
    def result(self) -> RESULTS:
        """How the solution ended."""
        return self.estimate.result

    @property
    def observations(self) -> Observations:
        """With the sigmas that were weighed by."""
        return self._ready.observations

    @property
    def residual_before_px(self) -> Float[Any, "n 2"]:
        """Measured less projected where the unknowns start."""
        return self._ready.before_px

    @property
    def residual_after_px(self) -> Float[Any, "n 2"]:
        """Measured less projected at the solution."""
        return self._here.residual_px

    @property
    def robust_weight(self) -> Float[Any, " n"]:
        """How much each observation pulls; 1 for check points."""
        return self._share

    @cached_property
    def _told(self) -> "Calibration":
        """The same in numpy, from which people are told."""
        return jax.tree.map(lambda a: np.asarray(a) if isinstance(a, jax.Array) else a, self)

    @cached_property
    def posterior(self) -> Posterior:
        """What the data said: covariance, share that is not prior, rank, null space."""
        at = self._told
        pull = np.sqrt(at._share[at.used])[:, None, None]
        rows = (pull * at._here.rows[at.used]).reshape(-1, len(at.unknowns))
        found = posterior(rows, at._ready.scale, at._ready.prior, at.estimate.names)
        if at._uncertain is not None:
            found = found.widened((at._spread - at._formal) * np.outer(at._ready.scale, at._ready.scale))
        return found if at._considered is None else found.widened(at._considered.covariance(at._ready.scale))

    @property
    def _spread(self) -> Float[np.ndarray, "k k"]:
        """Covariance of the whitened unknowns, considered numbers left out, that knows how well the weights are known."""
        return self._formal if self._uncertain is None else self._uncertain.of(self._formal)

    @cached_property
    def fit(self) -> Fit:
        """How well the model meets the observations, and what the check points say."""
        at = self._told
        control = at.observations.is_control
        kept = at.used if at._ready.problem.loss is None else at.used & (at._here.squared <= BLUNDER**2)
        factor, tail, sound = consistency(at.estimate.cost, at.estimate.freedom)
        sound = bool(sound) and bool(kept.sum() > (1 - self._most) * control.sum())
        check = at._checked(~control) if self.posterior.is_determined else UNTESTED
        return Fit(float(factor), float(tail), sound, int(at.estimate.freedom), check)

    def _checked(self, which: Bool[np.ndarray, " n"]) -> CheckTest:
        """Check points beside their prediction, which knows what rays that decided say of a point that they see too."""
        if not which.any():
            return UNTESTED
        index, share, ready = np.flatnonzero(which), self.used.astype(float), self._ready
        of = foreseen(ready, self._here, share)
        # How the errors of the answer, columns of variance 1, move every whitened residual.
        common = of.rows @ _root(self._spread)
        if self._considered is not None:
            moving = self._here._replace(rows=self._considered.effect, rows_px=self._considered.effect_px)
            by = foreseen(ready, moving, share).rows
            common = np.concatenate([common, by - of.rows @ self._considered.moved], axis=2)
        difference, spread = of.whitened[index], common[index]
        covariance = np.eye(2) + of.left[index] + spread @ spread.swapaxes(1, 2)
        own = np.einsum("ni,ni->n", difference, np.linalg.solve(covariance, difference[:, :, None])[..., 0])
        # A point that lies elsewhere is imaged elsewhere, by the derivative of the pixel.
        by_shift = triangles(of.weight)[index] @ ready.follows[index]
        both = np.concatenate([spread, by_shift], axis=2)
        difference, both = of_common_points(ready, share, index, difference, both)
        flat, spread = difference.ravel(), both[:, :, :-3].reshape(2 * len(index), -1)
        shift = common_shift(flat, spread, both[:, :, -3:].reshape(-1, 3))
        together = joint_chi_square(flat, spread)
        return check_test(together, own, 2, lambda i: ready.observations.label(int(index[i])), shift)

    @cached_property
    def reliability(self) -> Reliability:
        """How well the observations control one another."""
        at = self._told
        return reliability(at._ready, at._here, at._formal, at.used)

    @cached_property
    def _fitted(self) -> Dense:
        """Of the observations that decided."""
        return self._fit_of(np.where(self.used, self._share, 0.0))

    def _fit_of(self, share: Float[Any, " n"]) -> Dense:
        """The residuals of observations by how much they pull, beside all numbers that were estimated or considered."""
        ready, here = self._ready, self._here
        pull, u = np.sqrt(share)[:, None, None], ready.prior @ here.u
        rows, size = here.rows, len(here.u)
        information, prior = ready.prior.T @ ready.prior, ready.prior.T @ u
        if self._considered is not None:
            rows = np.concatenate([rows, self._considered.effect], axis=2)
            more = rows.shape[2] - size
            information, prior = np.pad(information, (0, more)), np.pad(prior, (0, more))
            information[size:, size:] = np.eye(more)

        def whitened(pattern_px: Float[np.ndarray, "n 2 d"]) -> Float[np.ndarray, "n 2 d"]:
            alone = here._replace(rows=triangles(ready.weight) @ pattern_px, rows_px=pattern_px)
            return pull * independent(ready, alone, (share > 0).astype(float)).rows

        return Dense(pull[..., 0] * here.whitened, pull * rows, information, prior, whitened)

    @cached_property
    def _suspects(self) -> Suspects:
        """What was taken as known."""
        seen = self.observations
        known, given = (*self.estimate.places, *self._considered_places), np.ones(len(seen), dtype=bool)
        return suspects(self.sensor, seen.shot, seen.point_m, seen.pixel_px, known, given, self._states_poses)

    @property
    def check_log_density(self) -> float:
        """The mean logarithm of the probability density, per pixel^2, that the calibration gave to each check point before
        looking; NaN without check points."""
        at = self._told
        share = at.used.astype(float)
        return log_density(foreseen(at._ready, at._here, share), at._spread, share, ~at.observations.is_control)

    @property
    def evidence(self) -> Evidence:
        """What the checks of the verdict see; under tracing without check points."""
        traced = arrays_of(self.estimate.covariance) is jnp
        at = self if traced else self._told
        seen, here, ready = at.observations, at._here, at._ready
        math, control = arrays_of((here.rows, at.used)), at.observations.is_control
        kept = at.used if ready.problem.loss is None else at.used & (here.squared <= BLUNDER**2)
        rows = math.sqrt(math.where(at.used, at._share, 0.0))[:, None, None] * here.rows
        factor, tail, *_ = consistency(at.estimate.cost, at.estimate.freedom) if traced else self.fit
        is_judged = not traced and self.posterior.is_determined and not here.unseen.any()
        images = seen.images or ("",) * len(seen)
        outliers = WORDS.outliers
        if ready.problem.loss is not None:
            outliers = f"control observations lie beyond {BLUNDER:g} sigma and count as blunders"
        measured = Seen(
            candidate=control,
            used=at.used,
            outlying=control & ~kept,
            code=here.unseen,
            beside=lies_beside(self.sensor, seen.shot, seen.pixel_px) & at.used,
            record=records(seen.shot, seen.pixel_px, seen.sigma_px),
            image=numbered(images),
            most=self._most,
            label=seen.label,
            images=tuple(sorted(set(images))),
            groups=() if traced else groupings(self.sensor, seen.key, seen.images),
            along={} if traced else courses(self.sensor, seen.shot, seen.pixel_px),
        )
        return Evidence(
            estimate=at.estimate,
            estimated=np.ones(len(at.unknowns), dtype=bool),
            shift=math.where(math.asarray(ready.has_prior), here.u, math.nan),
            scale=ready.scale,
            rows=rows.reshape(-1, len(at.unknowns)),
            variance_factor=factor,
            freedom=at.estimate.freedom,
            tail=tail,
            kinks=kinks(self.sensor, at.estimate),
            turned=() if traced else far_turns(self.sensor, at.estimate, np.asarray(at.start)),
            words=WORDS._replace(outliers=outliers),
            check=None if traced else self.fit.check,
            components=at.components,
            seen=measured,
            widened=0.0 if at._considered is None else (at._considered.moved**2).sum(axis=1),
            suspects=self._suspects if is_judged else None,
            fit=at._fitted if is_judged else None,
            everything=at._fit_of(np.where(at.used | ~control, at._share, 0.0)) if is_judged and not control.all() else None,
        )

    @cached_property
    def reasons(self) -> tuple[Reason, ...]:
        """What speaks for and against the calibration, failures first."""
        return by_weight(judged(CHECKS, self.evidence))

    @property
    def is_sound(self) -> bool:
        """Whether nothing fails it: it converged, every unknown is determined (by data or prior), residuals and check points are
        no farther off than chance explains, few control points were left out, and no sigma is stretched beyond reason."""
        return is_sound(self.reasons)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a careful person would say, the most serious first."""
        return warnings(self.reasons)

    @property
    def blunders(self) -> tuple[str, ...]:
        """Control observations that were left out, by name."""
        wrong = self._told.observations.is_control & ~self._told.used
        return tuple(self.observations.label(int(i)) for i in np.flatnonzero(wrong))


def _root(covariance: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """L with L L^T = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
