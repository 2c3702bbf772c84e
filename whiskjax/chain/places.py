"""Places where no camera was: zeros and codes for missing data among the positions of single shots and images.

A trajectory is asked more, see possible.py: there, each record has neighbours in time.
"""

import numpy as np
from jaxtyping import Float

from ..rules import Arrays

# From the deepest mine (-4 km; codes for missing data lie at -9999) to any orbit that looks at the ground (beyond: millimetres).
HEIGHT_LIMITS_M = (-5e3, 1e8)
# A position stands alone where it is this far from the middle of all of them, and this many times as far as half of them are.
_ALONE_M, _TIMES_MEDIAN = 1e6, 30.0
_DEGREE = np.radians(1.0)


def refuse_absent_records(
    arrays: Arrays, lat_rad: Float[np.ndarray, "..."], lon_rad: Float[np.ndarray, "..."], height_m: Float[np.ndarray, "..."]
) -> None:
    """**Raises:** `WhiskjaxError` where latitude and longitude are exactly zero while others are far from there, or at a height
    where nothing flies.
    """
    wrong = ~((height_m >= HEIGHT_LIMITS_M[0]) & (height_m <= HEIGHT_LIMITS_M[1]))
    if wrong.any():
        first = height_m[wrong].flat[0]
        arrays.refuse("height_m", f"holds {first:g}, where nothing flies; a code for missing data has to be taken out")
    lat, lon = np.broadcast_arrays(lat_rad, lon_rad)
    zero, elsewhere = (lat == 0) & (lon == 0), np.maximum(np.abs(lat), np.abs(lon)) > _DEGREE
    if zero.any() and elsewhere.any():
        place = tuple(int(i) for i in np.argwhere(zero)[0])
        arrays.refuse("lat_rad", f"and lon_rad are exactly 0 at index {place}, and others are not: zeros for missing data?")


def refuse_lone_positions(arrays: Arrays, position_m: Float[np.ndarray, "n 3"], what: str) -> None:
    """**Raises:** `WhiskjaxError` naming the first position so far from all others that it must be a code for missing data."""
    far = np.linalg.norm(position_m - np.median(position_m, axis=0), axis=1)
    wrong = far > np.maximum(_ALONE_M, _TIMES_MEDIAN * np.median(far))
    if wrong.any() and len(position_m) > 2:
        i = int(np.argmax(wrong))
        place = ", ".join(f"{v:g}" for v in position_m[i])
        arrays.refuse(
            "position_m", f"of {what} {i} is ({place}), {far[i] / 1e3:,.0f} km from the others: does it stand for missing data?"
        )
