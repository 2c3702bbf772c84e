"""Unknowns of the corrections at a joint: biases, drifts and processes, an unknown for each coefficient and axis."""

import math
from collections.abc import Sequence

from ..chain.by import By
from ..chain.correction import Correction
from ..chain.sensor import Sensor
from ..rules import Arrays, WhiskjaxError, need
from .unknown import Unknown


def motion_unknowns(
    sensor: Sensor,
    link: str,
    *,
    turn_sigma_rad: Sequence[float] = (0.0, 0.0, 0.0),
    shift_sigma_m: Sequence[float] = (0.0, 0.0, 0.0),
    coefficients: Sequence[int] | None = None,
) -> tuple[Unknown, ...]:
    """A zero-mean unknown for every coefficient of a `Correction` (or of each option of a `By` of them) and every axis.

    To estimate POS errors hand them to `calibrate` among its unknowns; to let them count without estimating them, as `consider`.

    **Arguments:**

    - `link`: the name of the correction.
    - `turn_sigma_rad`, `shift_sigma_m`: a-priori sigma about and along each axis of the frame; 0 leaves the axis out.
    - `coefficients`: which of the basis; all by default. Of a `Drift` beside a constant unknown only the second, (1,), is new.

    **Raises:** `WhiskjaxError` where the link is no correction, a sigma is negative, or no axis is left.
    """
    need("motion_unknowns", "sensor", sensor, Sensor)
    arrays = Arrays("motion_unknowns")
    sigma_of = {
        "turn_rad": arrays.take("turn_sigma_rad", turn_sigma_rad, "3", finite=True, least=0.0, within_rad=2 * math.pi),
        "shift_m": arrays.take("shift_sigma_m", shift_sigma_m, "3", finite=True, least=0.0),
    }
    if coefficients is not None:
        arrays.take_whole("coefficients", coefficients, "chosen")
    node = sensor[link]
    options = dict(zip(node.names, node.options, strict=True)) if isinstance(node, By) else {"": node}
    found = []
    for option, correction in options.items():
        if not isinstance(correction, Correction):
            raise WhiskjaxError(f"{link} is a {type(correction).__name__}, and only a Correction makes motions")
        place = f"{link}.{option}" if option else link
        chosen = range(correction.basis.size) if coefficients is None else coefficients
        for field, sigmas in sigma_of.items():
            for k in chosen:
                for axis, sigma in enumerate(sigmas):
                    if sigma > 0:
                        name = f"{place.replace('.', '_')}_{field.split('_')[0]}_{'xyz'[axis]}"
                        name += str(k) if correction.basis.size > 1 else ""
                        found.append(Unknown(name, f"{place}.{field}[{k},{axis}]", 0.0, float(sigma)))
    if not found:
        raise WhiskjaxError(f"{link}: all sigmas are zero, so there is nothing to estimate")
    return tuple(found)
