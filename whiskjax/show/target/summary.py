"""A located target as plain data: every figure that is printed, drawn in words or written comes from this one place.

Made of dicts, lists, strings, booleans and floats, so that `results.json` is the summary itself. Figures that do not exist are
None; names end in their unit.
"""

import math
from typing import Any

import numpy as np

from ...estimate.model_test import UNLIKELY, chi_square_tail
from ...estimate.reason import Reason, by_weight, probability, warnings
from ...rules import RESULTS
from ..plain import Summary, number, verdict, versions
from ..scales import in_words, one_sizes, units_in_words
from .sighting import STATES, Sighting

# Half-axes of the ellipse that holds 90 of 100, in sigmas: chi-square with two degrees of freedom.
NINETY = math.sqrt(-2 * math.log(0.1))
FIFTY = math.sqrt(-2 * math.log(0.5))
_LARGEST = 5
_PRIOR_SPEAKS = 0.5


def summarise(sighting: Sighting, command: str = "") -> Summary:
    """Everything worth telling about a located target.

    **Arguments:** `command`: how it was made, for the reader who wants to repeat it.
    """
    location, answered = sighting.location, sighting.is_answered
    data: Summary = {
        "flight": sighting.flight.name,
        "target": sighting.target,
        "label": sighting.label,
        "command": command,
        "verdict": {},
        "units": {
            "names": "end in the unit; covariance in m^2, in east, north, up at the target",
            "innovations": f"px, measured - predicted; {in_words(sighting.flight.is_line)}",
            **units_in_words(sighting.flight.is_line),
            "parameters": "each in its own unit",
        },
        "world": sighting.flight.world.kind,
        "points": [sighting.flight.points.names[i] for i in sighting.points],
        "method": sighting.method,
        "gate_probability": sighting.gate,
        "guess": {
            "surface_height_m": sighting.surface_height_m,
            **sighting.flight.world.position(sighting.guess.point_m),
            "sigma_enu_m": np.sqrt(np.diag(np.asarray(sighting.guess.covariance_enu_m2))).tolist(),
        },
        "position": sighting.flight.world.position(location.point_m) if answered else None,
        "covariance_enu_m2": np.asarray(location.covariance_enu_m2).tolist() if answered else None,
        "sigma_enu_m": np.sqrt(np.diag(np.asarray(location.covariance_enu_m2))).tolist() if answered else None,
        "accuracy": _accuracy(sighting) if answered else None,
        "truth": _truth(sighting) if answered and sighting.truth_m is not None else None,
        "line": _line(sighting),
        "looks": _looks(sighting),
        "consistency": _consistency(sighting),
        "parameters": _parameters(sighting),
        "largest_innovations": _largest(sighting),
        "remarks": list(sighting.remarks),
        "versions": versions("jax", "numpy"),
    }
    reasons = by_weight([*location.reasons, *_own_reasons(sighting, data)])
    return data | {"verdict": verdict(reasons), "warnings": list(warnings(reasons))}


def _accuracy(sighting: Sighting) -> Summary:
    found = sighting.location.accuracy()
    variance, axes = np.linalg.eigh(np.asarray(sighting.location.covariance_enu_m2)[:2, :2])
    minor, major = (NINETY * np.sqrt(variance)).tolist()
    return {
        **{f"{name}_m": float(getattr(found, f"{name}_m")) for name in ("cep50", "ce90", "le90", "se90")},
        "ellipse_90": {
            "semi_major_m": major,
            "semi_minor_m": minor,
            "azimuth_deg": math.degrees(math.atan2(axes[0, 1], axes[1, 1])) % 180,
        },
    }


def _truth(sighting: Sighting) -> Summary:
    """The error: estimated - given, and whether the covariance explains it."""
    error = -sighting.enu(sighting.truth_m)  # pyright: ignore[reportArgumentType]
    spread = np.asarray(sighting.location.covariance_enu_m2) + sighting.truth_covariance_enu_m2
    nees = float(error @ np.linalg.solve(spread, error))
    return {
        **sighting.flight.world.position(sighting.truth_m),  # pyright: ignore[reportArgumentType]
        "error_enu_m": error.tolist(),
        "error_horizontal_m": float(np.hypot(*error[:2])),
        "error_m": float(np.linalg.norm(error)),
        "nees": nees,
        "freedom": 3,
        "tail_probability": chi_square_tail(nees, 3),
        "points": len(sighting.points),
        "spread_m": sighting.truth_spread_m,
    }


def _line(sighting: Sighting) -> Summary:
    """What the looks alone know least: a direction, upwards, and the 1-sigma along it."""
    location = sighting.location
    east, north, up = np.asarray(location.line_direction) @ np.asarray(location.world_from_enu)
    east, north, up = (-1.0 if up < 0 else 1.0) * np.array([east, north, up])
    return {
        **{key: number(value) for key, value in sighting.flight.world.position(location.line_m).items()},
        "azimuth_deg": number(math.degrees(math.atan2(east, north)) % 360),
        "elevation_deg": number(math.degrees(math.atan2(up, math.hypot(east, north)))),
        "sigma_m": number(location.line_sigma_m),
    }


def _looks(sighting: Sighting) -> Summary:
    time, state = sighting.time_s, sighting.state
    away = np.linalg.norm(sighting.platform_m - np.asarray(sighting.location.line_m), axis=1)
    return {
        "looks": len(sighting),
        **{name.replace(" ", "_"): int((state == name).sum()) for name in STATES},
        "gated_images": [sighting.images[i] for i in sighting.location.gated],
        "first_time_s": None if time is None else number(time[0]),
        "last_time_s": None if time is None else number(time[-1]),
        "first_distance_m": number(away[0]),
        "last_distance_m": number(away[-1]),
        "convergence_deg": number(math.degrees(float(sighting.location.convergence_rad))),
    }


def _consistency(sighting: Sighting) -> Summary:
    location = sighting.location
    chi_square, freedom = number(location.chi_square), location.freedom
    factor = None if chi_square is None or freedom == 0 else chi_square / freedom
    return {
        "chi_square": chi_square,
        "freedom": freedom,
        "mean_nis": None if factor is None else 2 * factor,
        "sigma_factor": None if factor is None else math.sqrt(factor),
        "tail_probability": None if factor is None else number(location.tail_probability),
        "is_consistent": location.is_consistent,
    }


def _parameters(sighting: Sighting) -> list[Summary]:
    sigma = np.asarray(sighting.location.estimate.sigma)
    rows = []
    for k, unknown in enumerate(sighting.unknowns):
        unit, factor = unknown.unit
        assert unknown.mean is not None and unknown.sigma is not None  # locate has refused others
        rows.append(
            {
                "name": unknown.name,
                "role": "estimated" if k < sighting.estimated else "considered",
                "unit": unit,
                "prior_mean": factor * unknown.mean,
                "prior_sigma": factor * unknown.sigma,
                "value": number(factor * float(sighting.location.value[k])),
                "sigma": number(factor * sigma[k]),
            }
        )
    return rows


def _largest(sighting: Sighting) -> list[Summary]:
    """The looks with the largest NIS, where a blunder would show."""
    looks, time = sighting.location.looks, sighting.time_s
    innovation = np.asarray(looks.innovation_px)
    nis = np.where(sighting.state == "missed", -np.inf, np.nan_to_num(np.asarray(looks.nis), nan=np.inf))
    return [
        {
            "look": int(i),
            "image": sighting.images[i],
            "time_s": None if time is None else number(time[i]),
            "x_px": number(innovation[i, 0]),
            "y_px": number(innovation[i, 1]),
            **one_sizes(sighting.scales, innovation, int(i)),
            "nis": number(looks.nis[i]),
            "state": str(sighting.state[i]),
        }
        for i in np.argsort(-nis, kind="stable")[:_LARGEST]
        if nis[i] > -np.inf
    ]


def place(data: Summary) -> str:
    """Coordinates for a sentence."""
    if "x_m" in data:
        return f"x {data['x_m']:.3f}, y {data['y_m']:.3f}, z {data['z_m']:.3f} m"
    return f"latitude {data['lat_deg']:.7f}, longitude {data['lon_deg']:.7f} deg, height {data['height_m']:.2f} m"


def _own_reasons(sighting: Sighting, data: Summary) -> list[Reason]:
    """What the location itself cannot know: its flight, its first guess, and where the target is."""
    looks, truth, line = data["looks"], data["truth"], data["line"]
    found = []
    if sighting.is_answered:
        used, angle = looks["used"], looks["convergence_deg"]
        said = f"{used} of {looks['looks']} looks were used, whose lines of sight differ by up to {angle:.3g} deg"
        found.append(Reason("looks", "note", said, {"used": used, "convergence_deg": angle}))
        if truth is None:
            said = "the position of the target was not given: nothing tests the answer from outside"
            found.append(Reason("given position", "caution", said, {}))
        elif truth["tail_probability"] <= UNLIKELY:
            said = (
                f"the given position lies {truth['error_m']:.3g} m off, more than the covariance explains (NEES "
                f"{truth['nees']:.3g} of 3 expected; probability by chance: {probability(truth['tail_probability'])})"
            )
            found.append(Reason("given position", "failure", said, {"nees": truth["nees"], "error_m": truth["error_m"]}))
        ratio = max(s / g for s, g in zip(data["sigma_enu_m"], data["guess"]["sigma_enu_m"], strict=True))
        if ratio > _PRIOR_SPEAKS:
            said = f"the first guess still speaks: a sigma is {ratio:.2f} of what it was before the looks (--sigma-enu)"
            found.append(Reason("first guess", "caution", said, {"ratio": ratio}))
    elif line["azimuth_deg"] is not None and bool(sighting.location.result == RESULTS.depth_unobservable):
        towards = f"azimuth {line['azimuth_deg']:.3f}, elevation {line['elevation_deg']:.3f} deg"
        found.append(Reason("line", "note", f"the line: through {place(line)}, towards {towards}", {}))
    free = {one.frame for one in sighting.flight.errors if any(one.free)}
    if all(one.frame in free for one in sighting.flight.errors):
        said = (
            "the flight states no errors of its recorded poses ([[error]] in flight.toml): the covariance counts the image "
            "measurements alone"
        )
        found.append(Reason("errors not stated", "caution", said, {}))
    return found


def properties(data: Summary) -> dict[str, Any]:
    """What a map tells about the target beside its position."""
    truth = data["truth"]
    return {
        "flight": data["flight"],
        "is_sound": data["verdict"]["is_sound"],
        "cep50_m": data["accuracy"]["cep50_m"],
        "se90_m": data["accuracy"]["se90_m"],
        "looks_used": data["looks"]["used"],
        "convergence_deg": data["looks"]["convergence_deg"],
    } | ({} if truth is None else {"error_m": truth["error_m"]})
