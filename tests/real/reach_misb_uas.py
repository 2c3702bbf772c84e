"""What whiskjax reaches on misb_uas: slant range, and by how much the line of sight misses the reported frame centre."""

import dataclasses
from pathlib import Path

import jax
import numpy as np

import whiskjax as wj

from . import convert_misb_uas as misb
from .figures import Figure, Reached

SET = "misb_uas"
ASKED = {"cheyenne": (7.6, 4.0), "truck": (5.1, 2.5)}


@dataclasses.dataclass(frozen=True)
class Sight:
    """For every packet the horizontal miss and the slant range in metres, NaN where delays lead out of the record."""

    miss_m: np.ndarray
    range_m: np.ndarray


def look(sensor: wj.Sensor, flight: wj.Flight, source: Path) -> Sight:
    """The line of sight of every packet, intersected with the surface of the frame centre's height, against the frame centre."""
    rows, _ = misb.packets(source)
    image = np.arange(len(rows))
    lat, lon, height = rows.numbers("fc_lat", "fc_lon", "fc_elev").T
    centre = np.asarray(jax.jit(jax.vmap(wj.geodetic_to_ecef))(np.radians(lat), np.radians(lon), height))
    pixel = np.broadcast_to(sensor.camera.principal_point_px, (len(rows), 2))
    shot = flight.shot(image)
    ground = wj.image_to_ground(sensor, shot, pixel, wj.HeightSurface(height), throw=False)
    origin = wj.ray(sensor, shot, pixel, throw=False).origin_m
    return Sight(np.linalg.norm(np.asarray(ground.point_m) - centre, axis=1), np.linalg.norm(np.asarray(origin) - centre, axis=1))


def reach(source: Path, out: Path) -> Reached:
    """The figures of both flights."""
    figures, folders, notes = [], [], []
    for name, (raw_m, calibrated_m) in ASKED.items():
        file, folder = source / f"{name}.csv", out / f"{SET}_{name}"
        converted = misb.convert(file, folder)
        flight = wj.read_flight(folder)
        before = look(flight.sensor, flight, file)
        slant = misb.packets(file)[0].numbers("slant_range")
        solved = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
        after = look(solved.sensor, flight, file)
        outside = int(np.isnan(after.miss_m).sum())
        figures += [
            Figure(f"{SET} {name}", "slant range, sd", float(np.std(before.range_m - slant)), "m", 0.1),
            Figure(f"{SET} {name}", "miss to the frame centre, raw, median", float(np.median(before.miss_m)), "m", raw_m),
            Figure(
                f"{SET} {name}",
                "miss to the frame centre, calibrated, median",
                float(np.nanmedian(after.miss_m)),
                "m",
                calibrated_m,
            ),
            *(
                Figure(f"{SET} {name}", f"calibrated: {x.name}", float(v * x.unit.factor), x.unit.name)
                for x, v in zip(solved.unknowns, solved.value, strict=True)
            ),
        ]
        folders.append(folder)
        notes += [f"{SET} {name}: left out: {text}" for text in converted.left_out]
        notes.append(f"{SET} {name}: {outside} of {len(slant)} packets have no calibrated line of sight: delays leave the record")
    return Reached(figures, folders, notes)
