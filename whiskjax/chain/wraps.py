"""Which way round a record has turned between two samples, and where it cannot be told.

Samples tell a turn from its complement, the same end reached the other way round, only where they lie closer than half a turn
(the sampling theorem). What is said here is sure to be meant; the rest is refused, with the place in the record.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..rules import WhiskjaxError

# Of an angle, in turns: a step this long is too near to half a turn, with the noise of encoders and the jitter of clocks.
_LONG = 0.4 + 1e-9
# A step over the end of the circle may differ so much from what those beside it foretell, or be twice as long; one that differs
# more may as well be a mirror that flew back.
_ALIKE = 0.1
# A platform does not spin, so the short way round is meant; but half a turn, within what a POS may err, has no short way.
_FAR_RAD = np.radians(179.5)


class Unclear(NamedTuple):
    """What cannot be told of a record: the sample that ends the interval, and a sentence."""

    sample: int
    what: str


def check_wraps(what: str, wraps: bool | None) -> bool | None:
    """The choice itself.

    **Raises:** `WhiskjaxError` where it is none; `what` begins the message.
    """
    if wraps is None or isinstance(wraps, bool):
        return wraps
    raise WhiskjaxError(f"{what}: wraps is True, False or None, not {wraps!r}")


def unclear_turn(
    time_s: Float[np.ndarray, " n"], quaternion: Float[np.ndarray, "n 4"], is_gap: Bool[np.ndarray, " n-1"]
) -> Unclear | None:
    """The first two attitudes with no gap between them that are half a turn apart, within half a degree.

    **Arguments:** `quaternion`: of unit length, any sign.
    """
    angle = 2 * np.arccos(np.clip(np.abs(np.einsum("ni,ni->n", quaternion[1:], quaternion[:-1])), 0.0, 1.0))
    far = ~is_gap & (angle > _FAR_RAD)
    if not far.any():
        return None
    i = int(np.argmax(far))
    turned = np.degrees(angle[i])
    return Unclear(
        i + 1,
        f"{_between(time_s, i)} the attitude turns by {turned:.1f} deg, which cannot be told from {360 - turned:.1f} deg the "
        "other way round: record it more often, or take the wrong sample out",
    )


def unwrapped(
    time_s: Float[np.ndarray, " n"], angle_rad: Float[np.ndarray, " n"], is_gap: Bool[np.ndarray, " n-1"], wraps: bool | None
) -> tuple[Float[np.ndarray, " n"], Unclear | None]:
    """A recorded angle without jumps of a whole turn, and the first step, if any, that has two readings.

    With `wraps` False the angles are what they are; with True they were recorded modulo one turn. With None,

    - a record that leaves one turn is cumulative, and is what it is; unless it goes to and fro, and a step of half a turn or more
      would fit those beside it better by whole turns less: that may be a counter that was reset;
    - a record that stays within half a turn, or whose steps are all short of 0.4 turns, is what it is: scan mirrors, with or
      without flyback, and gimbals;
    - any other is modulo one turn, if its steps over the end of the circle are like those beside them: a mirror that flies back
      over more than half a turn has others.

    Of angles modulo one turn, no step may come near half a turn, or fall so far from what those beside it foretell that another
    whole turn would fit better. Across a gap nothing is asked, because nothing is interpolated.
    """
    turns = angle_rad / (2 * np.pi)
    step, sampled = np.diff(turns), ~is_gap
    short = step - np.round(step)
    span = np.ptp(turns)
    if wraps is None:
        if span > 1 + 1e-9:
            to_and_fro = (step > 0).any() and (step < 0).any()
            doubtful = (np.abs(step) >= 0.5) & (np.abs(step - _foretold(time_s, step, is_gap)) > 0.5)
            return angle_rad, _unclear(time_s, angle_rad, sampled & doubtful & to_and_fro, _UNSAID)
        if span < 0.5 or not (sampled & (np.abs(step) > _LONG)).any():
            return angle_rad, None
    elif not wraps:
        return angle_rad, None
    expected = _foretold(time_s, short, is_gap)
    off = np.abs(short - expected)
    doubtful = (np.abs(short) > _LONG) | (off > _LONG)
    if wraps is None:
        doubtful |= (step != short) & (off > np.maximum(_ALIKE, np.abs(expected)))
    whole = np.concatenate([[0.0], np.cumsum(np.round(step))])
    return angle_rad - 2 * np.pi * whole, _unclear(time_s, angle_rad, sampled & doubtful, _TOO_FAR if wraps else _UNSAID)


def _foretold(time_s: np.ndarray, step: np.ndarray, is_gap: np.ndarray) -> Float[np.ndarray, " n-1"]:
    """Each step as the mean rate of the steps beside it foretells it; itself where there is none."""
    interval = np.diff(time_s)
    rate = np.where(is_gap, np.nan, step / interval)
    beside = np.stack([np.append(np.nan, rate[:-1]), np.append(rate[1:], np.nan)])
    known = np.isfinite(beside)
    mean = np.where(known, beside, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known.any(axis=0), mean * interval, step)


_UNSAID = (
    "say which with wraps: false where the angles are what they are (a flyback, a cumulative count), true where they were "
    "recorded modulo one turn"
)
_TOO_FAR = "angles modulo one turn have to be recorded more often than that; a cumulative count (wraps: false) need not"


def _unclear(time_s: np.ndarray, angle_rad: np.ndarray, doubtful: np.ndarray, remedy: str) -> Unclear | None:
    if not doubtful.any():
        return None
    # Of several the longest, and of equal ones the first: a step beside a long one is only doubtful because of it.
    turns = np.diff(angle_rad) / (2 * np.pi)
    length = np.where(doubtful, np.abs(turns - np.round(turns)), -1.0)
    i = int(np.argmax(length >= length.max() - 1e-9))
    step = float(np.degrees(angle_rad[i + 1] - angle_rad[i]))
    short = (step + 180) % 360 - 180
    # The reading as it stands and the shorter one; of a step that is short as it stands, the other way round.
    other = short if abs(short - step) > 1 else short - np.copysign(360, short)
    return Unclear(
        i + 1,
        f"{_between(time_s, i)} the angle goes from {np.degrees(angle_rad[i]):.10g} to {np.degrees(angle_rad[i + 1]):.10g} deg: "
        f"by {step:+.1f} deg, or by {other:+.1f} deg? {remedy}",
    )


def _between(time_s: np.ndarray, i: int) -> str:
    return f"from sample {i} ({time_s[i]:.6f} s) to {i + 1} ({time_s[i + 1]:.6f} s)"
