"""A located target as plain data: every figure that is printed, drawn in words or written comes from this one place.

Made of dicts, lists, strings, booleans and floats, so that `results.json` is the summary itself. Figures that do not exist are
None; names end in their unit.
"""

import math
from typing import Any

import numpy as np

from ...estimate.diagnosis import UNLIKELY, chi_square_tail
from ...rules.results import codes_of, message_of
from ..plain import Summary, number, probability, versions
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
        "warnings": [*location.warnings, *_own_warnings(sighting)],
        "versions": versions("jax", "numpy"),
    }
    data["verdict"] = _verdict(sighting, data)
    return data


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


def _own_warnings(sighting: Sighting) -> list[str]:
    """What the location itself cannot know."""
    free = {one.frame for one in sighting.flight.errors if any(one.free)}
    if any(one.frame not in free for one in sighting.flight.errors):
        return []
    return [
        "the flight states no errors of its recorded poses ([[error]] in flight.toml): the covariance counts the image "
        "measurements alone"
    ]


def place(data: Summary) -> str:
    """Coordinates for a sentence."""
    if "x_m" in data:
        return f"x {data['x_m']:.3f}, y {data['y_m']:.3f}, z {data['z_m']:.3f} m"
    return f"latitude {data['lat_deg']:.7f}, longitude {data['lon_deg']:.7f} deg, height {data['height_m']:.2f} m"


def _verdict(sighting: Sighting, data: Summary) -> Summary:
    """Sound or not, in words that need no statistics."""
    looks, test, truth, guess = data["looks"], data["consistency"], data["truth"], data["guess"]
    reasons, cautions = [], []
    if not sighting.is_answered:
        reasons.append(message_of(int(codes_of(sighting.location.result))))
        if (line := data["line"])["azimuth_deg"] is not None and "distance" in reasons[0]:
            reasons.append(
                f"the line: through {place(line)}, towards azimuth {line['azimuth_deg']:.3f}, elevation "
                f"{line['elevation_deg']:.3f} deg"
            )
    else:
        ends = f"the {sighting.method} filter ends where least squares of the same looks does"
        reasons.append(ends if sighting.is_filter else "least squares of all looks converged")
        reasons.append(
            f"{looks['used']} of {looks['looks']} looks were used, whose lines of sight differ by up to "
            f"{looks['convergence_deg']:.3g} deg"
        )
    if sighting.is_answered and test["sigma_factor"] is not None:
        times = f"the innovations are {test['sigma_factor']:.2f} times as large as their covariance says"
        chance = f"(probability of more by chance: {probability(test['tail_probability'])})"
        if test["tail_probability"] <= UNLIKELY:
            reasons.append(f"{times}, more than chance explains {chance}")
        elif test["tail_probability"] >= 1 - UNLIKELY:
            reasons.append(f"{times}: the sigmas given are too large, and so are those of the result")
        else:
            reasons.append(f"{times}, which is consistent {chance}")
        if not test["is_consistent"] and test["tail_probability"] > UNLIKELY:
            reasons.append("the gate left out more than half of the looks")
    if looks["gated"]:
        cautions.append(f"{looks['gated']} of {looks['looks']} looks did not pass the gate and were left out")
    if looks["missed"] + looks["left_out"]:
        cautions.append(f"{looks['missed'] + looks['left_out']} of {looks['looks']} looks could not be used")
    contradicted = False
    if truth is not None and truth["tail_probability"] <= UNLIKELY:
        contradicted = True
        reasons.append(
            f"the given position lies {truth['error_m']:.3g} m off, more than the covariance explains (NEES {truth['nees']:.3g} "
            f"of 3 expected; probability by chance: {probability(truth['tail_probability'])})"
        )
    elif truth is None and sighting.is_answered:
        cautions.append("the position of the target was not given: nothing tests the result from outside")
    if sighting.is_answered:
        ratio = max(s / g for s, g in zip(data["sigma_enu_m"], guess["sigma_enu_m"], strict=True))
        if ratio > _PRIOR_SPEAKS:
            cautions.append(f"the first guess still speaks: a sigma is {ratio:.2f} of what it was before the looks (--sigma-enu)")
    is_sound = sighting.location.is_sound and not contradicted
    return {"is_sound": is_sound, "word": "sound" if is_sound else "not sound", "reasons": reasons, "cautions": cautions}


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
