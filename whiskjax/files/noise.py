"""[[noise]]: errors of recorded poses that are new at every look."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..chain.sensor import Sensor
from ..flights.flight import Flight
from ..locate.noise import FrameNoise
from ..rules import FlightError
from .flight_toml import NAME
from .names import listed, meant
from .units import degree_lists, radian_array

if TYPE_CHECKING:
    from .schema import NoiseTable


def noise_from_toml(entries: "list[NoiseTable]", sensor: Sensor) -> list[FrameNoise]:
    """The noise of frames, in radians.

    **Raises:** `FlightError` naming the entry whose frame the chain does not have.
    """
    out = []
    for i, entry in enumerate(entries):
        if entry.frame not in sensor.names:
            known = f"the chain has {listed(sensor.names)}"
            raise FlightError(f"{NAME}: noise[{i}].frame: no frame {entry.frame!r}{meant(entry.frame, sensor.names)}; {known}")
        if entry.frame in [other.frame for other in entries[:i]]:
            raise FlightError(
                f"{NAME}: noise[{i}].frame: {entry.frame!r} has a [[noise]] before; one entry holds all errors of a frame: add "
                "variances"
            )
        turn, shift = radian_array(entry.turn_sigma_deg or _NONE), np.array(entry.shift_sigma_m or _NONE)
        out.append(FrameNoise(entry.frame, turn.tolist(), shift.tolist()))
    return out


_NONE = [0.0, 0.0, 0.0]


def noise_to_toml(flight: Flight) -> list[dict[str, Any]]:
    """The entries of [[noise]]; sigmas that are zero about or along all axes are left out.

    **Raises:** `FlightError` where a frame does not exist, has two noises, or a sigma differs from look to look.
    """
    out = []
    frames = [noise.frame for noise in flight.noise]
    if twice := next((frame for frame in frames if frames.count(frame) > 1), None):
        raise FlightError(f"noise of {twice!r} is there twice; one entry holds all errors of a frame: add variances")
    for noise in flight.noise:
        if noise.frame not in flight.sensor.names:
            raise FlightError(f"noise: no frame named {noise.frame!r}; there are {listed(flight.sensor.names)}")
        sigmas = {"turn_sigma_deg": noise.turn_sigma_rad, "shift_sigma_m": noise.shift_sigma_m}
        if any(np.ndim(sigma) for three in sigmas.values() for sigma in three):
            raise FlightError(f"noise of {noise.frame!r}: a sigma for each look has no form in a flight folder; give one for all")
        entry: dict[str, Any] = {"frame": noise.frame}
        for key, three in sigmas.items():
            values = np.array([float(sigma) for sigma in three])
            if values.any():
                entry[key] = degree_lists(values) if key.endswith("_deg") else values.tolist()
        out.append(entry)
    return out
