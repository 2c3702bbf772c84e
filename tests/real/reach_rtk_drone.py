"""What whiskjax reaches on rtk_drone_nadir: boresight and focal length with priors, and the blunder found by a robust loss."""

from pathlib import Path

import numpy as np

import whiskjax as wj

from . import convert_rtk_drone as drone
from .figures import Figure, Reached

SET = "rtk_drone_nadir"
BLUNDER = ("131", "3")  # image, point


def calibrate(folder: Path) -> wj.Calibration:
    """With the loss that a mark of 80 sigmas does not pull."""
    flight = wj.read_flight(folder)
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, loss=wj.Cauchy())


def reach(source: Path, out: Path) -> Reached:
    """The figures of the set, which issue and source leave open: they are told, not asked."""
    converted = drone.convert(source, out / SET)
    solved = calibrate(out / SET)
    away = np.linalg.norm(solved.residual_after_px, axis=1)
    worst, *others = np.argsort(-away)
    image, point = solved.observations.images[worst], solved.observations.points[worst]
    figures = [
        Figure(SET, f"largest residual (image {image}, point {point})", float(away[worst]), "px"),
        Figure(SET, "largest other residual", float(away[others].max()), "px"),
        Figure(SET, "median residual", float(np.median(away)), "px"),
        Figure(SET, "calibrated: focal length", float(solved.value[3]), "px"),
        *(
            Figure(SET, f"calibrated: {x.name}", float(v * x.unit.factor), x.unit.name)
            for x, v in zip(solved.unknowns[:3], solved.value[:3], strict=True)
        ),
    ]
    return Reached(figures, (out / SET,), [f"{SET}: left out: {text}" for text in converted.left_out])
