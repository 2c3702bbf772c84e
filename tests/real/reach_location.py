"""What `wj.locate` reaches on real flights: geo-locked stretches of misb_uas, and a surveyed point of ign_frame."""

from pathlib import Path

import numpy as np

import whiskjax as wj

from . import convert_ign_frame as ign
from . import convert_misb_uas as misb
from .figures import Figure, Reached

SET = "location"
# First and last packet of a stretch in which the turret is locked on one point; asked raw and with the delays calibrated.
STRETCHES = {(15, 118): (4.5, 4.0), (196, 243): (12.5, 1.0)}
SURVEYED = "1003"
# The first look's place on a surface 100 m too high, known to kilometres: nothing but the looks says where the target is.
TOO_HIGH_M, SIGMA_ENU_M = 100.0, (3000.0, 3000.0, 3000.0)


def locate_stretch(sensor: wj.Sensor, flight: wj.Flight, rows, first: int, last: int) -> tuple[wj.Location, np.ndarray]:
    """The target of the packets from `first` to `last`, and the mean of their reported frame centres, ECEF."""
    packet = np.array([int(text) for text in rows.texts("packet")])
    image = np.flatnonzero((packet >= first) & (packet <= last))
    lat, lon, height = rows.numbers("fc_lat", "fc_lon", "fc_elev")[image].T
    centre = np.asarray(wj.geodetic_to_ecef(np.radians(lat), np.radians(lon), height)).mean(axis=0)
    pixel = np.broadcast_to(sensor.camera.principal_point_px, (len(image), 2))
    looks = wj.Looks(flight.shot(image), pixel, (misb.SIGMA_PX, misb.SIGMA_PX))
    surface = wj.HeightSurface(float(height[0]) + TOO_HIGH_M)
    return wj.locate(sensor, looks, surface=surface, sigma_enu_m=SIGMA_ENU_M), centre


def locate_surveyed(flight: wj.Flight, method: str = "iterated") -> tuple[wj.Location, np.ndarray]:
    """The surveyed point from its rays, and its surveyed position."""
    index = list(flight.points.names).index(SURVEYED)
    looks, place = flight.looks([index])[0], flight.points.position_m[index]
    height = float(wj.ecef_to_geodetic(place)[2])
    surface = wj.HeightSurface(height + TOO_HIGH_M)
    return wj.locate(flight.sensor, looks, surface=surface, sigma_enu_m=SIGMA_ENU_M, method=method), place


def reach(source: Path, out: Path) -> Reached:
    """The figures of both sets. **Arguments:** `source`: the folder of all sets."""
    file = source / "misb_uas" / "cheyenne.csv"
    misb.convert(file, out / "cheyenne")
    flight = wj.read_flight(out / "cheyenne")
    rows, _ = misb.packets(file)
    calibrated = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns).sensor
    figures, notes = [], []
    for (first, last), asked in STRETCHES.items():
        for kind, sensor, limit in zip(("raw", "calibrated"), (flight.sensor, calibrated), asked, strict=True):
            found, centre = locate_stretch(sensor, flight, rows, first, last)
            what = f"packets {first} to {last}, {kind}: to the reported frame centre"
            figures.append(Figure(SET, what, float(np.linalg.norm(np.asarray(found.point_m) - centre)), "m", limit))
            notes += [f"{SET}: packets {first} to {last}, {kind}: {text}" for text in found.warnings]
    ign.convert(source / "ign_frame", out / "ign_frame")
    found, place = locate_surveyed(wj.read_flight(out / "ign_frame"))
    used = int(found.looks.is_used.sum())
    error = float(np.linalg.norm(np.asarray(found.point_m) - place))
    figures.append(Figure(SET, f"ign_frame, surveyed point {SURVEYED} from {used} rays", error, "m", 0.05))
    return Reached(figures, [out / "cheyenne", out / "ign_frame"], notes)
