"""Summaries as plain data: numbers for JSON, and what every fit is told by, as data and in words."""

import math
import platform
from importlib import metadata
from typing import Any

from ..estimate.diagnosis import UNLIKELY
from ..estimate.variance_components import Components
from ..estimate.verdict import CheckTest, stretched
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


def check(found: CheckTest) -> Summary | None:
    """What the check points say of the answer; None where there are none."""
    if not found.freedom:
        return None
    return {
        "chi_square": number(found.chi_square),
        "degrees_of_freedom": found.freedom,
        "factor": number(found.factor),
        "tail_probability": number(found.tail_probability),
        "agrees": found.agrees,
        "worst": [{"name": w, "sigmas": number(s)} for w, s in zip(found.worst, found.worst_sigmas, strict=True)],
    }


def check_in_words(data: Summary) -> str:
    """One sentence on `check`."""
    if data["factor"] is None or data["tail_probability"] is None:
        return "the check points could not be compared: a difference is not a number"
    times = f"the check points' differences are {data['factor']:.2f} times as large as predicted"
    chance = f"(probability of more by chance: {probability(data['tail_probability'])})"
    if data["agrees"]:
        return f"{times}, which is consistent {chance}"
    worst = ", ".join(row["name"] for row in data["worst"])
    return f"{times}: they contradict the answer {chance}; the worst are {worst}"


def weights(found: Components | None) -> list[Summary]:
    """Groups whose sigmas were estimated; empty where they were not."""
    if found is None:
        return []
    beyond = stretched(found)
    return [
        {
            "group": name,
            "is_prior": bool(p),
            "n": int(n),
            "sigma_factor": number(f),
            "relative_sigma": number(s),
            "is_plausible": g not in beyond,
        }
        for g, (name, p, n, f, s) in enumerate(zip(*found, strict=True))
    ]


def weights_in_words(rows: list[Summary]) -> list[str]:
    """A sentence on every group of `weights` that is not plausible."""
    return [
        f"the sigma of {row['group']} would have to be {row['sigma_factor']:.3g} times as large as given: a finding, not a weight"
        for row in rows
        if not row["is_plausible"]
    ]


def versions(*packages: str) -> Summary:
    """Of whiskjax, what it stands on, and Python."""
    return {name: metadata.version(name) for name in ("whiskjax", *packages)} | {"python": platform.python_version()}
