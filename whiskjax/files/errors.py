"""[[error]]: how the recorded poses of frames err."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..chain.sensor import Sensor
from ..estimate.errors import FrameErrors, need_errors
from ..estimate.memory import CONSTANT, WHITE
from ..flights.flight import Flight
from ..rules import FlightError, WhiskjaxError
from .flight_toml import NAME
from .names import listed, meant
from .units import degree_lists, file_words, floats, radian_array

if TYPE_CHECKING:
    from .schema import ErrorTable

_NONE = [0.0, 0.0, 0.0]


def errors_from_toml(entries: "list[ErrorTable]", sensor: Sensor) -> tuple[FrameErrors, ...]:
    """The statements of errors, in radians.

    **Raises:** `FlightError` naming the entry whose frame the chain does not have, that means nothing, or that is there twice.
    """
    out: list[FrameErrors] = []
    for i, entry in enumerate(entries):
        if entry.frame not in sensor.names:
            known = f"the chain has {listed(sensor.names)}"
            raise FlightError(f"{NAME}: error[{i}].frame: no frame {entry.frame!r}{meant(entry.frame, sensor.names)}; {known}")
        turn = radian_array(entry.turn_sigma_deg or _NONE).tolist()
        try:
            one = FrameErrors(
                entry.frame, turn, entry.shift_sigma_m or _NONE, entry.correlation_s, anew=entry.anew, axes=entry.axes
            )
            one.check(sensor)
            need_errors(NAME, [*out, one])
        except WhiskjaxError as error:
            raise FlightError(f"{NAME}: error[{i}] (frame {entry.frame!r}): {file_words(str(error))}") from error
        out.append(one)
    return tuple(out)


def errors_to_toml(flight: Flight) -> list[dict[str, Any]]:
    """The entries of [[error]]; what is as it is without being said is left out.

    **Raises:** `FlightError` where a frame does not exist, or a sigma differs from exposure to exposure.
    """
    out = []
    for one in flight.errors:
        if one.frame not in flight.sensor.names:
            raise FlightError(f"errors: no frame named {one.frame!r}; there are {listed(flight.sensor.names)}")
        if any(np.ndim(sigma) for sigma in one.sigma):
            raise FlightError(
                f"errors of {one.frame!r}: a sigma for each exposure has no form in a flight folder; give one for all"
            )
        entry: dict[str, Any] = {"frame": one.frame}
        for key, three in (("turn_sigma_deg", one.turn_sigma_rad), ("shift_sigma_m", one.shift_sigma_m)):
            values = np.array([float(sigma) for sigma in three])
            if values.any():
                entry[key] = degree_lists(values) if key.endswith("_deg") else values.tolist()
        times: list[Any] = [{WHITE: 0.0, CONSTANT: np.inf}.get(m, t) for m, t in zip(one.memory, one.correlation_s, strict=True)]
        if any(m != WHITE for m in one.memory):
            entry["correlation_s"] = floats(times[0] if len(set(map(float, times))) == 1 else times)
        if one.anew != "flight":
            entry["anew"] = one.anew
        if one.axes != "frame":
            entry["axes"] = one.axes
        if len(entry) == 1:
            entry["shift_sigma_m"] = _NONE
        out.append(entry)
    return out
