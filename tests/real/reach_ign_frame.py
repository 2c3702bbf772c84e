"""What whiskjax reaches on ign_frame: forward intersection with the given poses, and a calibration from a wrong start."""

import dataclasses
from pathlib import Path

import numpy as np

import whiskjax as wj

from . import convert_ign_frame as ign
from .figures import Figure, Reached

SET = "ign_frame"
# 0.11 deg in all, and 60 to 90 px.
OFF_DEG, OFF_FOCAL_PX, OFF_PRINCIPAL_PX = (0.065, -0.06, 0.065), 60.0, (-75.0, 90.0)


@dataclasses.dataclass(frozen=True)
class Intersected:
    """All points of a flight from their rays, in the order of `flight.points`, and which of them the rays determine."""

    flight: wj.Flight
    point_m: np.ndarray
    residual_px: np.ndarray
    is_determined: np.ndarray
    rays: np.ndarray


def intersect(flight: wj.Flight) -> Intersected:
    """Every point from all its rays, none of their given coordinates used; a point that one ray sees stays undetermined."""
    m = flight.measurements
    seen, index = np.unique(m.point, return_inverse=True)
    pixel, sigma = np.stack([m.sample_px, m.line_px], axis=-1), np.stack([m.sigma_sample_px, m.sigma_line_px], axis=-1)
    found = wj.intersect(flight.sensor, flight.shot(m.image), pixel, index, sigma, throw=False)
    n = len(flight.points.names)
    point, rays = np.full((n, 3), np.nan), np.zeros(n, dtype=int)
    point[seen], rays[seen] = np.asarray(found.point_m), np.bincount(index)
    return Intersected(flight, point, np.asarray(found.residual_px), np.isfinite(point[:, 0]), rays)


def calibrate_from_wrong_start(source: Path, out: Path) -> wj.Calibration:
    """Boresight, focal length and principal point, started off; no priors."""
    principal = tuple(c + off for c, off in zip(ign.PRINCIPAL_POINT_PX, OFF_PRINCIPAL_PX, strict=True))
    ign.convert(source, out, boresight_deg=OFF_DEG, focal_px=ign.FOCAL_PX + OFF_FOCAL_PX, principal_point_px=principal)
    flight = wj.read_flight(out)
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)


def reach(source: Path, out: Path) -> Reached:
    """The figures of the set."""
    folders = out / SET, out / f"{SET}_started_off"
    converted = ign.convert(source, folders[0])
    found = intersect(wj.read_flight(folders[0]))
    names = found.flight.points.names
    role = np.asarray(found.flight.points.roles)
    ties = (role == "control")[found.flight.measurements.point] & found.is_determined[found.flight.measurements.point]
    column, row = np.sqrt((found.residual_px[ties] ** 2).mean(axis=0))
    surveyed = np.flatnonzero((role == "check") & found.is_determined)
    error = np.linalg.norm(found.point_m[surveyed] - found.flight.points.position_m[surveyed], axis=1)

    solved = calibrate_from_wrong_start(source, folders[1])
    residual = solved.residual_after_px[solved.observations.is_control]
    wrong = np.linalg.norm(np.degrees(solved.value[:3]))
    figures = [
        Figure(SET, "tie points with the given poses, column RMS", column, "px", 0.16),
        Figure(SET, "tie points with the given poses, row RMS", row, "px", 0.19),
        *(
            Figure(SET, f"surveyed point {names[i]} from {found.rays[i]} rays, 3-D error", float(e), "m", 0.05)
            for i, e in zip(surveyed, error, strict=True)
        ),
        Figure(SET, "calibrated: residual RMS", float(np.sqrt((residual**2).mean())), "px", 0.21),
        Figure(SET, "calibrated: boresight error (norm of 3 angles)", float(wrong), "deg", 3e-4),
        Figure(SET, "calibrated: focal length error", abs(float(solved.value[3]) - ign.FOCAL_PX), "px", 0.1),
    ]
    for name, value, truth in zip(("column", "row"), solved.value[4:], ign.PRINCIPAL_POINT_PX, strict=True):
        figures.append(Figure(SET, f"calibrated: principal {name} error", abs(float(value) - truth), "px"))
    lost = int(((role == "control") & ~found.is_determined).sum())
    notes = [
        f"{SET}: {int((role == 'control').sum()) - lost} tie points intersected, {lost} not determined (fewer than two rays)",
    ]
    return Reached(figures, folders, notes + [f"{SET}: left out: {text}" for text in converted.left_out])
