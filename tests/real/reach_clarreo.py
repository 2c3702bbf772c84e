"""What whiskjax reaches on clarreo_gimbal_pushbroom: lines of sight, three mounts calibrated, the rank without priors."""

from pathlib import Path

import numpy as np

import whiskjax as wj

from . import convert_clarreo as clarreo
from .figures import Figure, Reached

SET = "clarreo_gimbal_pushbroom"


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between directions, exact for small ones."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def sight_error_deg(flight: wj.Flight, sensor: wj.Sensor, source: Path) -> np.ndarray:
    """Angle between the lines of sight and those of the set, (frames, looks); NaN where the set has none."""
    frames, _ = clarreo.usable(source)
    looks = clarreo.looks_of(frames)
    given = np.stack([clarreo.vectors(frames, f"bhat_ctrs_pix{n}") for n in looks], axis=1)
    sample = clarreo.samples(source)
    line = np.repeat(np.arange(len(frames)), len(looks))
    pixel = np.stack([np.tile(sample, len(frames)), np.zeros(line.size)], axis=-1)
    shot = flight.shot(np.zeros(line.size, dtype=int), line.astype(float))
    return angle_deg(np.asarray(wj.ray(sensor, shot, pixel).direction).reshape(given.shape), given)


def reach(source: Path, out: Path) -> Reached:
    """The figures of the set."""
    given, wanted = out / f"{SET}_given", out / SET
    clarreo.convert(source, given, given_mounts=True)
    flight = wj.read_flight(given)
    known = sight_error_deg(flight, flight.sensor, source)

    converted = clarreo.convert(source, wanted)
    flight = wj.read_flight(wanted)
    solved = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    error = sight_error_deg(flight, solved.sensor, source)
    free = without_priors(source, out / f"{SET}_without_priors")
    missing = [f"{int(np.isnan(known).sum())} lines of sight of the set are blank"] if np.isnan(known).any() else []
    figures = [
        Figure(SET, "line of sight with the given matrices, median", float(np.nanmedian(known)), "deg", 2e-6),
        Figure(SET, "line of sight calibrated, median", float(np.nanmedian(error)), "deg", 2e-4),
        Figure(SET, "rank of 9 unknowns without priors", free.posterior.rank, "", 7, exactly=True),
    ]
    worst = int(np.nanargmax(np.nanmax(known, axis=1)))
    notes = [f"{SET}: left out: {text}" for text in (*converted.left_out, *missing)]
    notes += [f"{SET}: the data alone do not tell apart: {' and '.join(names)}" for names in free.posterior.null_space]
    notes.append(
        f"{SET}: with the given matrices {int((known > 1e-5).any(axis=1).sum())} frames miss by more than 1e-5 deg "
        f"(up to {np.nanmax(known):.2g} deg, line {worst}): their recorded gimbal angles do not fit"
    )
    return Reached(figures, (wanted, given), notes)


def without_priors(source: Path, out: Path) -> wj.Calibration:
    """The same nine angles on the data alone, not raised: the answer says itself that it is not determined."""
    clarreo.convert(source, out, priors=False)
    flight = wj.read_flight(out)
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns, throw=False)
