"""What is odd in recordings without being impossible: said in the flight's notes, refused by nobody.

Real navigation is corrected in steps, creeps before it has settled, and looks aside in the wind; so none of this is an error, and
each sentence says where to look.
"""

import itertools
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from ..chain.agreement import level_axes, ways
from ..chain.possible import ATTITUDE, POSITION, departures
from ..chain.samples import sign_continuous
from .navigation import Samples
from .tables import Table

# A record is odd where it is this many times as far beside the line between its neighbours as half of all are, and farther than
# navigation and encoders are noisy.
_TIMES_MEDIAN = 100.0
_LEAST_M, _LEAST_DEG = 1.0, 1.0
# Over so many seconds velocities and positions have to lead to the same place, to this part of the way and these metres.
_WINDOW_S, _PART, _DRIFT_M = 10.0, 0.3, 20.0
# Nobody crabs so far at the speed of an aircraft.
_FAST_MPS, _CRAB_DEG, _MOST_OF = 20.0, 60.0, 0.9
_FAR_M, _TIMES_FAR = 1e5, 100.0
_TIMES_AS_LONG, _TIMES_IN_ONE_IMAGE = 1000.0, 20.0
_FASTEST_LINE_S = 1e-6  # the fastest line cameras take 5e-6 s


def of_positions(table: Table, time_s: Float[np.ndarray, " n"], found: Samples, max_gap_s: float) -> list[str]:
    """Cautions about a POS table."""
    dt = np.diff(time_s)
    out = []
    gap = dt > max_gap_s
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused elsewhere
        for quantity, values, least, unit in (
            (POSITION, found.position_m, _LEAST_M, "m"),
            (ATTITUDE, sign_continuous(found.quaternion), _LEAST_DEG, "deg"),
        ):
            beside = departures(quantity.distance, dt, values)
            beside[:-1][gap] = beside[1:][gap] = 0.0
            out += _alone(table, f"the {quantity.what}", beside, least, unit)
        if found.velocity_mps is not None:
            out += _velocities_that_drift(table, time_s, found.position_m, found.velocity_mps, max_gap_s)
        if "heading_deg" in table:
            out += _headings_aside(table, time_s, found, max_gap_s)
    return out


def of_encoder(table: Table, column: str, rows: np.ndarray) -> list[str]:
    """A caution about one encoder, sampled in some rows of a table."""
    angle = np.unwrap(table[column][rows], period=360)[:, None]
    beside = departures(lambda a, b: np.abs(a - b)[:, 0], np.diff(table["time_s"][rows]), angle)
    return _alone(table, column, beside, _LEAST_DEG, "deg", rows)


def of_poses(table: Table, position_m: Float[np.ndarray, "n 3"]) -> list[str]:
    """A caution about the image that is farthest from all others."""
    if len(position_m) < 3:
        return []
    away = np.linalg.norm(position_m - np.median(position_m, axis=0), axis=1)
    row = int(np.argmax(away))
    if away[row] < max(_FAR_M, _TIMES_FAR * float(np.median(away))):
        return []
    return [f"{table.place(row)}: this pose lies {away[row] / 1e3:,.0f} km from the middle of the others; is it in another unit?"]


def of_lines(table: Table, rows: Iterable[list[int]]) -> list[str]:
    """A caution about lines that take a thousand times as long, or as short, as those of the other images do.

    In one image twenty times is odd; and so are lines that take no time.

    **Arguments:** `rows`: of lines.csv, for each image.
    """
    images = [list(itertools.pairwise(index)) for index in rows]
    pairs = np.array([pair for image in images for pair in image])
    line, time = (table[name][pairs] for name in ("line", "time_s"))
    each = np.diff(time)[:, 0] / np.diff(line)[:, 0]
    usual = float(np.median(each))
    if usual < _FASTEST_LINE_S:
        return [f"{table.place(int(pairs[0, 1]), 'time_s')}: a line takes {usual:.3g} s; are the times in seconds?"]
    odd = (each > _TIMES_AS_LONG * usual) | (each < usual / _TIMES_AS_LONG)
    if odd.any():
        i = int(np.argmax(odd))
        return [
            f"{table.place(int(pairs[i, 1]), 'time_s')}: a line before it takes {each[i]:.3g} s, of all others {usual:.3g} s."
        ]
    start = np.cumsum([0, *map(len, images)])
    for first, stop in itertools.pairwise(start):
        own = each[first:stop]
        ratio = own[1:] / own[:-1]
        odd = (ratio > _TIMES_IN_ONE_IMAGE) | (ratio < 1 / _TIMES_IN_ONE_IMAGE)
        if odd.any():
            i = int(np.argmax(odd))
            where = table.place(int(pairs[first + i + 1, 1]), "time_s")
            return [f"{where}: a line before it takes {own[i + 1]:.3g} s, and {own[i]:.3g} s earlier in the same image."]
    return []


def _alone(table: Table, what: str, beside: np.ndarray, least: float, unit: str, rows: np.ndarray | None = None) -> list[str]:
    """Records that leave the line of their neighbours and come back: those are off by half as much, at a bend they are not."""
    usual = float(np.median(beside[1:-1])) if len(beside) > 2 else np.inf
    before, after = np.append(0.0, beside[:-1]), np.append(beside[1:], 0.0)
    comes_back = (beside > 1.5 * np.maximum(before, after)) & (np.minimum(before, after) > 0.25 * beside)
    odd = (beside > max(least, _TIMES_MEDIAN * usual)) & comes_back
    if not odd.any():
        return []
    i = int(np.argmax(odd))
    row = i if rows is None else int(rows[i])
    more = f"; so are {odd.sum() - 1} more" if odd.sum() > 1 else ""
    return [f"{table.place(row)}: {what} is {beside[i]:.3g} {unit} beside the line between its neighbours, and back{more}."]


def _velocities_that_drift(
    table: Table,
    time_s: Float[np.ndarray, " n"],
    position_m: Float[np.ndarray, "n 3"],
    velocity_mps: Float[np.ndarray, "n 3"],
    max_gap_s: float,
) -> list[str]:
    w = ways(time_s, position_m, velocity_mps, max_gap_s, _WINDOW_S)
    apart = np.linalg.norm(w.by_positions_m - w.by_velocities_m, axis=1)
    way = np.maximum(*(np.linalg.norm(flown, axis=1) for flown in (w.by_positions_m, w.by_velocities_m)))
    odd = apart > _PART * way + _DRIFT_M
    if not odd.any():
        return []
    i = int(np.argmax(odd))
    more = f" (as in {odd.sum()} of {len(odd)} such intervals)" if odd.sum() > 1 else ""
    return [
        f"{table.place(int(w.start[i]))}: over the next {w.length_s[i]:.3g} s the velocities lead {apart[i]:.3g} m away from the "
        f"positions{more}; navigation that has not settled does so."
    ]


def _headings_aside(table: Table, time_s: np.ndarray, found: Samples, max_gap_s: float) -> list[str]:
    w = ways(time_s, found.position_m, np.broadcast_to(0.0, found.position_m.shape), max_gap_s, _WINDOW_S)
    axes = level_axes(w.position_m) if len(w.start) else None
    east, north, _ = (w.by_positions_m if axes is None else np.einsum("nij,nj->ni", axes, w.by_positions_m)).T
    fast = np.hypot(east, north) > _FAST_MPS * w.length_s
    if not fast.any():
        return []
    course, heading = np.degrees(np.arctan2(east, north))[fast], table["heading_deg"][w.start[fast]]
    aside = np.abs((course - heading + 180) % 360 - 180)
    if np.mean(aside > _CRAB_DEG) < _MOST_OF:
        return []
    return [
        f"{table.place(int(w.start[fast][0]), 'heading_deg')}: the platform does not fly where it heads: its course is "
        f"{course[0] % 360:.0f} deg and its heading {heading[0] % 360:.0f} deg, and so throughout."
    ]
