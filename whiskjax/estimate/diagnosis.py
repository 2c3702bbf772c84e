"""What a careful person would say about a calibration: consistency, correlations, unknowns that only the prior holds."""

import math
from collections.abc import Sequence

import numpy as np
from jax.scipy.special import gammaincc
from jaxtyping import Bool, Float

from ..chain.address import node_at
from ..chain.link import AbstractLink
from ..chain.sensor import Sensor
from ..chain.shot import KEYS
from .observations import Observations
from .posterior import Posterior
from .unknown import Unknown

_CORRELATED, _INSEPARABLE = 0.9, 0.95
_PRIOR_ONLY, _MOSTLY_DATA = 0.05, 0.5
UNLIKELY = 1e-4
_LOPSIDED = 0.3


def chi_square_tail(value: float, freedom: int) -> float:
    """Probability that a chi-square variable of this many degrees of freedom exceeds the value."""
    return float(gammaincc(0.5 * freedom, 0.5 * value)) if freedom > 0 else 1.0


def consistency(cost: float, freedom: int) -> tuple[float, float, bool]:
    """Global model test of a weighted least-squares fit.

    **Arguments:** `cost`: sum of squared whitened residuals, priors included; `freedom`: their number less the unknowns.

    **Returns:** the variance factor (1 where residuals are as large as their sigmas say), the probability of a larger one, and
    whether the fit is sound: not larger than chance explains at 1e-4. Smaller than expected is a warning, not a failure.
    """
    if freedom <= 0:
        return math.nan, 1.0, True
    tail = chi_square_tail(cost, freedom)
    return cost / freedom, tail, tail > UNLIKELY


def warnings_of(
    unknowns: Sequence[Unknown], posterior: Posterior, factor: float, tail: float, shift: Float[np.ndarray, " k"]
) -> list[str]:
    """Sentences for people, the most serious first.

    **Arguments:** `factor`, `tail`: from `consistency`; `shift`: (solution - prior mean) / prior sigma.
    """
    said = []
    names = [x.name for x in unknowns]
    if posterior.untouched:
        said.append(f"no control observation depends on {', '.join(posterior.untouched)}")
    for direction in posterior.null_space:
        if set(direction) <= set(posterior.untouched):
            continue
        parts = ", ".join(shift_of(unknowns[names.index(name)], v) for name, v in direction.items())
        said.append(f"the data alone do not determine {', '.join(direction)}: moving by {parts} together changes no residual")
    if posterior.null_space:
        well = [name for name, share in zip(names, posterior.data_share, strict=True) if share > _MOSTLY_DATA]
        which = f"mostly from the data come {', '.join(well)}" if well else "no unknown comes mostly from the data"
        said.append(f"the data alone determine {posterior.rank} of {len(names)} combinations of the unknowns; {which}")
    if math.isnan(factor):
        said.append("there are no more observations and priors than unknowns: nothing checks the fit")
    elif tail <= UNLIKELY:
        said.append(
            f"the residuals are {math.sqrt(factor):.2f} times as large as their sigmas say (chance: {tail:.0e}): "
            "the model lacks something, or the sigmas are too small, or there are blunders"
        )
    elif tail >= 1 - UNLIKELY:
        said.append(f"the residuals are {math.sqrt(factor):.2f} times as large as their sigmas say: the sigmas are too large")
    order = [(i, j) for i in range(len(names)) for j in range(i) if abs(posterior.correlation[i, j]) > _CORRELATED]
    for i, j in sorted(order, key=lambda ij: -abs(posterior.correlation[ij])):
        rho = posterior.correlation[i, j]
        kind = "cannot be told apart" if abs(rho) > _INSEPARABLE else "are strongly correlated"
        said.append(f"{names[j]} and {names[i]} {kind}: correlation {rho:+.3f}")
    for name, share, away in zip(names, posterior.data_share, shift, strict=True):
        if share < _PRIOR_ONLY:
            said.append(f"{name} is fixed by its prior: the data took {max(share, 0):.1%} of the prior variance away")
        if not np.isnan(share) and abs(away) > 3:
            said.append(f"{name} ended {abs(away):.1f} prior sigmas from its prior mean")
    return said


def kinked(sensor: Sensor, unknowns: Sequence[Unknown]) -> list[str]:
    """Delays whose cost has a kink wherever the time of a shot passes a sample, with the remedy."""
    said = []
    for x in unknowns:
        for place in x.places:
            node = node_at(sensor, place._replace(path=place.path[:-1]))
            if isinstance(node, AbstractLink) and place.path[-1] in node.kinks:
                where = ".".join((place.link, *place.path[:-1]))
                said.append(
                    f"{x.name}: {where} is interpolated linearly, so the cost has a kink wherever a shot passes a sample, "
                    'and noise of the record pulls on the delay; give it interpolation = "cubic"'
                )
    return list(dict.fromkeys(said))


def lopsided(observations: Observations, used: Bool[np.ndarray, " n"]) -> list[str]:
    """What to say of images that lost so many control points as blunders that the others may be the wrong ones."""
    images = np.array(observations.images or [""] * len(observations))
    said = []
    for image in dict.fromkeys(images[observations.is_control & ~used].tolist()):
        control = observations.is_control & (images == image)
        lost, there = int((control & ~used).sum()), int(control.sum())
        if lost > _LOPSIDED * there:
            where = f" of image {image}" if image else ""
            said.append(f"{lost} of {there} control points{where} were left out as blunders: if they agree with one another, the "
                        "others may be the wrong ones")  # fmt: skip
    return said


def shift_of(unknown: Unknown, value: float) -> str:
    """A change of an unknown for people: "+0.2 m u_gps"."""
    return f"{value * unknown.unit.factor:+.2g} {unknown.unit.name} {unknown.name}"


def repeated(observations: Observations, used: Bool[np.ndarray, " n"]) -> list[str]:
    """What to say of observations that are copies of one another: each counts as a measurement of its own, which it is not.

    **Arguments:** `used`: observations that decided.
    """
    index = np.flatnonzero(used)
    keys = [value for key in ("time_s", *KEYS) if (value := observations.key(key)) is not None]
    what = np.column_stack([observations.point_m, observations.pixel_px, *keys])[index]
    _, first, copies = np.unique(what, axis=0, return_index=True, return_counts=True)
    groups = [(observations.label(int(index[i])), int(c)) for i, c in zip(first, copies, strict=True) if c > 1]
    if not groups:
        return []
    label, c = groups[0]
    more = f", and {len(groups) - 1} more have copies" if len(groups) > 1 else ""
    return [f"{label} is given {c} times{more}: copies count as independent measurements, so sigmas come out too small"]
