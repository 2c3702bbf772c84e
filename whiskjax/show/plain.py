"""Summaries as plain data: numbers for JSON, and what every fit is told by, as data and in words."""

import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

from ..estimate.check_points import CheckTest
from ..estimate.reason import Reason, by_weight, is_sound
from ..estimate.variance_components import Components
from ..rules import RESULTS
from ..rules.results import codes_of, message_of

Summary = dict[str, Any]


def number(x: Any) -> float | None:
    """A float for JSON; None where it is not finite."""
    value = float(x)
    return value if math.isfinite(value) else None


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


def weights(found: Components | None) -> list[Summary]:
    """Groups whose sigmas were estimated; empty where they were not."""
    if found is None:
        return []
    return [
        {
            "group": name,
            "is_prior": bool(found.is_prior[g]),
            "n": int(found.count[g]),
            "sigma_factor": number(found.factor[g]),
            "relative_sigma": number(found.log_sigma[g]),
            "is_plausible": not found.is_stretched[g],
        }
        for g, name in enumerate(found.names)
    ]


def versions(*packages: str) -> Summary:
    """Of whiskjax, what it stands on, and Python."""
    return {name: metadata.version(name) for name in ("whiskjax", *packages)} | {"python": platform.python_version()}


def verdict(reasons: Iterable[Reason]) -> Summary:
    """Sound or not, and why: what fails the answer and what was found in order, and what to look at before it is believed."""
    ordered = by_weight(reasons)
    sound = is_sound(ordered)
    return {
        "is_sound": sound,
        "word": "sound" if sound else "not sound",
        "reasons": [{**reason._asdict(), "figures": _data(reason.figures)} for reason in ordered],
    }


def _data(value: Any) -> Any:
    """For JSON."""
    if isinstance(value, Mapping):
        return {name: _data(of) for name, of in value.items()}
    if isinstance(value, str | int):
        return value
    return [_data(of) for of in value] if isinstance(value, Sequence) else number(value)
