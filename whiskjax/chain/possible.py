"""Whether recorded poses can have been flown: jumps, speeds and turn rates that no platform has.

Asked of every trajectory, from files and in Python alike, because a wrong record is interpolated like a right one. The limits lie
far beyond every platform that carries a camera, and records are compared only across intervals that are interpolated.
"""

from collections.abc import Callable
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Bool, Float

from ..rules import WhiskjaxError
from .agreement import contradiction
from .samples import blocks

# A record stands out where its step, or its way beside the line between its neighbours, is this many times the median. Without
# that, records that are scattered throughout, and may be meant so, would be called impossible. Of fewer than five none is usual.
TIMES_MEDIAN, LEAST_SAMPLES = 30.0, 5
# Motion is smooth where the way beside the line is this small a part of the step; then no speed is excused by being usual.
_SMOOTH = 0.1

Naming = Callable[[int], str]
Distance = Callable[[np.ndarray, np.ndarray], Float[np.ndarray, " n"]]


class ImpossibleMotion(WhiskjaxError):
    """Recorded poses that cannot have been flown.

    **Arguments:**

    - `sample`: the record to look at first, from 0.
    - `what`: "position", "attitude" or "velocity".
    - `sentence`: what is wrong, by a function that names records.
    """

    def __init__(self, sample: int, what: str, sentence: Callable[[Naming], str]):
        super().__init__(f"trajectory: {sentence(lambda i: f'sample {i}')}")
        self.sample, self.what, self.sentence = sample, what, sentence


class Quantity(NamedTuple):
    """What is recorded: the fastest change, the largest way beside the line between the neighbours, `jump` included in both.

    `jump` is what navigation itself jumps by where it is corrected.
    """

    what: str
    distance: Distance
    verb: str
    told: Callable[[float], str]
    rate: float
    jump: float
    beside: Callable[[np.ndarray, np.ndarray], np.ndarray]


def _metres(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, " n"]:
    return np.sqrt(sum((a[:, k] - b[:, k]) ** 2 for k in range(3)))


def _degrees(p: np.ndarray, q: np.ndarray) -> Float[np.ndarray, " n"]:
    """The turn from one quaternion to the other, of any lengths: by the chord, which keeps small turns."""
    p, q = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (p, q))
    q = q * np.where(np.einsum("ni,ni->n", p, q) < 0, -1.0, 1.0)[:, None]
    return np.degrees(4 * np.arcsin(np.minimum(0.5 * np.linalg.norm(p - q, axis=1), 1.0)))


POSITION = Quantity(
    "position",
    _metres,
    "lies {} from",
    lambda m: f"{m / 1e3:,.0f} km" if m >= 1e6 else f"{m / 1e3:.4g} km" if m >= 1e4 else f"{m:.4g} m",
    rate=12e3,  # beyond every orbit that looks at the ground (8 km/s): about that of escape
    jump=20.0,
    beside=lambda before, after: 0.5 * 200.0 * before * after,  # 20 g: cameras fly below 10 g, and in orbit below 1 g
)
ATTITUDE = Quantity(
    "attitude",
    _degrees,
    "is turned by {} against",
    lambda deg: f"{deg:.4g} deg",
    rate=3600.0,  # ten turns a second: what spins faster carries no camera
    jump=5.0,
    beside=lambda before, after: 0.5 * 2e4 * before * after,  # a shake of 5 deg at 10 Hz
)
_VELOCITY = Quantity(
    "velocity",
    _metres,
    "differs by {} from",
    lambda mps: f"{mps:.4g} m/s",
    rate=400.0,
    jump=20.0,
    beside=lambda before, after: 0.5 * 200.0 * (before + after),
)


def refuse_impossible_motion(
    time_s: Float[np.ndarray, " n"],
    position_m: Float[np.ndarray, "n 3"],
    quaternion: Float[np.ndarray, "n 4"],
    velocity_mps: Float[np.ndarray, "n 3"] | None,
    max_gap_s: float,
) -> None:
    """**Arguments:** positions and velocities in the world, unit quaternions of any sign, the longest interval interpolated.

    **Raises:** `ImpossibleMotion` naming the first record that no platform can have reached, or left; or what is wrong with
    velocities that are not those of the positions.
    """
    dt = np.diff(time_s)
    joined = dt <= max_gap_s
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused
        for quantity, values in ((POSITION, position_m), (ATTITUDE, quaternion), (_VELOCITY, velocity_mps)):
            if values is not None:
                _refuse_outliers(quantity, values, dt, joined)
        wrong = None if velocity_mps is None else contradiction(time_s, position_m, velocity_mps, max_gap_s)
    if wrong is not None:
        sentence = lambda name: f"{wrong.sentence}, most after {name(wrong.sample)}; correct them or leave the columns out"
        raise ImpossibleMotion(wrong.sample, "velocity", sentence)


def refuse_impossible_speed(time_s: Float[np.ndarray, " n"], position_m: Float[np.ndarray, "n 3"], max_gap_s: float) -> None:
    """The same of the speed alone, for recordings, which nobody scatters on purpose.

    **Raises:** `ImpossibleMotion` naming the first record that is too far from the one before it.
    """
    dt = np.diff(time_s)
    with np.errstate(over="ignore", invalid="ignore"):
        step = _steps(POSITION, position_m)
    wrong = (dt <= max_gap_s) & ~(step <= _fastest(POSITION, dt))
    if wrong.any():
        _fail(POSITION, 1 + int(np.argmax(wrong)), step, dt)


def _fastest(q: Quantity, dt: np.ndarray) -> np.ndarray:
    return q.rate * dt + 5 * q.jump


def _steps(q: Quantity, values: np.ndarray) -> Float[np.ndarray, " n-1"]:
    out = np.empty(len(values) - 1)
    for rows in blocks(len(out)):
        out[rows] = q.distance(values[1:][rows], values[:-1][rows])
    return out


def departures(distance: Distance, dt: Float[np.ndarray, " n-1"], values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
    """How far each record is from what its two neighbours make of its time; 0 for the first and the last."""
    out = np.zeros(len(values))
    for rows in blocks(max(len(values) - 2, 0)):
        before, here, after = (values[i:][rows] for i in (0, 1, 2))
        w = (dt[:-1][rows] / (dt[:-1][rows] + dt[1:][rows]))[:, None]
        out[1:-1][rows] = distance(here, (1 - w) * before + w * after)
    return out


def _refuse_outliers(q: Quantity, values: np.ndarray, dt: np.ndarray, joined: Bool[np.ndarray, " n-1"]) -> None:
    step, beside = _steps(q, values), departures(q.distance, dt, values)
    known = np.append(np.append(False, joined[:-1] & joined[1:]), False)  # whose neighbours both belong to it
    usual_step, usual_beside = (np.median(far[of]) if of.any() else 0.0 for far, of in ((step, joined), (beside, known)))
    excused = TIMES_MEDIAN * (len(values) >= LEAST_SAMPLES)
    is_smooth = usual_beside <= _SMOOTH * usual_step
    too_far = joined & ~(step <= np.maximum(_fastest(q, dt), 0.0 if is_smooth else excused * usual_step))
    bent = known.copy()
    bent[1:-1] &= ~(beside[1:-1] <= np.maximum(q.beside(dt[:-1], dt[1:]) + q.jump, excused * usual_beside))
    if not (too_far.any() or bent.any()):
        return
    first = min(int(np.argmax(wrong)) for wrong in (too_far, bent) if wrong.any())
    # A record that stands alone throws its neighbours off their lines too, by half as much.
    near = np.arange(first, min(first + 3, len(values)))
    worst = int(near[np.argmax(np.where(known[near], beside[near], -1.0))])
    sides = [i for i in (worst - 1, worst) if 0 <= i < len(dt) and joined[i]]
    if len(sides) == 2 and min(step[sides]) > 0.5 * max(step[sides]):
        _fail(q, worst, step, dt, stands_alone=True)
    _fail(q, 1 + max(sides, key=lambda i: step[i]), step, dt)


def _fail(q: Quantity, sample: int, step: np.ndarray, dt: np.ndarray, stands_alone: bool = False) -> NoReturn:
    def sentence(name: Naming) -> str:
        before, after = q.told(step[sample - 1]), q.told(step[sample]) if stands_alone else ""
        found = f"{name(sample)} {q.verb.format(before)} {name(sample - 1)}, {dt[sample - 1]:.4g} s before it"
        found += f", and {after} from {name(sample + 1)}, {dt[sample]:.4g} s after it" if stands_alone else ""
        return (
            f"{found}, which no platform can fly; correct the {q.what} or the time, or take the record out (zeros, -9999 and the "
            "like often stand for missing data)"
        )

    raise ImpossibleMotion(sample, q.what, sentence)
