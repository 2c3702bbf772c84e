"""Summaries as plain data: numbers for JSON, and what every fit is told by, as data and in words."""

import math
import platform
from importlib import metadata
from typing import Any

from ..estimate.diagnosis import UNLIKELY
from ..estimate.variance_components import Components
from ..rules import RESULTS
from ..rules.results import codes_of, message_of

PRIOR_ONLY = 0.05  # data shares below this say nothing new

Summary = dict[str, Any]


def number(x: Any) -> float | None:
    """A float for JSON; None where it is not finite."""
    value = float(x)
    return value if math.isfinite(value) else None


def probability(p: float) -> str:
    """A probability for people: below a millionth its exact size says nothing."""
    return f"{p:.2g}" if p >= 1e-6 else "below 1e-6"


def solver(result: RESULTS, steps: int) -> Summary:
    """How the iteration ended."""
    code = int(codes_of(result))
    return {"converged": code == 0, "message": message_of(code), "steps": steps}


def fit(variance_factor: float, freedom: int, tail_probability: float, is_consistent: bool) -> Summary:
    """Whether the residuals are as large as their sigmas say."""
    return {
        "variance_factor": number(variance_factor),
        "sigma_factor": number(math.sqrt(variance_factor)) if variance_factor >= 0 else None,
        "degrees_of_freedom": freedom,
        "tail_probability": number(tail_probability),
        "is_consistent": is_consistent,
    }


def fit_in_words(data: Summary) -> str:
    """One sentence on `fit`."""
    if data["sigma_factor"] is None:
        return "there are no more observations than unknowns, so the fit cannot be tested"
    times = f"the residuals are {data['sigma_factor']:.2f} times as large as their sigmas say"
    chance = f"(probability of more by chance: {probability(data['tail_probability'])})"
    if not data["is_consistent"]:
        return f"{times}, more than chance explains {chance}"
    if data["tail_probability"] > 1 - UNLIKELY:
        return f"{times}: the sigmas given are too large, and so are those of the result"
    return f"{times}, which is consistent {chance}"


def weights(found: Components | None) -> list[Summary]:
    """Groups whose sigmas were estimated; empty where they were not."""
    if found is None:
        return []
    return [
        {"group": name, "is_prior": bool(p), "n": int(n), "sigma_factor": number(f), "relative_sigma": number(s)}
        for name, p, n, f, s in zip(*found, strict=True)
    ]


def versions(*packages: str) -> Summary:
    """Of whiskjax, what it stands on, and Python."""
    return {name: metadata.version(name) for name in ("whiskjax", *packages)} | {"python": platform.python_version()}
