"""A sensor as the [[chain]] and [camera] of flight.toml, and the tables that they name."""

import itertools
import re
from collections.abc import Container
from typing import Any

import numpy as np
from jaxtyping import Float

from ..chain.by import By
from ..chain.camera import FrameCamera
from ..chain.correction import Bias, Correction, Drift, OrientationImages, Spline
from ..chain.line_camera import LineCamera
from ..chain.link import AbstractLink, Fixed
from ..chain.look_table import LookTable
from ..chain.mounts import Axes, Mount
from ..chain.process import Process
from ..chain.records import Records
from ..chain.sensor import Sensor
from ..chain.trajectory import PosePerImage, Trajectory
from ..chain.turn import Encoder, Turn
from ..flights.flight import Flight
from ..rules import FlightError
from .chain_from_toml import SMALL_MOTION
from .navigation import Samples, sample_texts
from .tables import exact, rounded, table_text
from .units import degree_lists, degrees, floats

# Encoder angles in degrees: 1e-13 deg is 2e-15 rad.
_ENCODER_DEG = 1e-13
_LONGEST = 100  # bytes of a name that go into that of a file, which has at most 255


class Tables:
    """The CSV files of a flight being written, as text; encoders that share a clock share a file."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}
        self._clocks: list[tuple[str, Float[np.ndarray, " n"], dict[str, list[str]]]] = []

    def add(self, stem: str, label: str, text: str) -> str:
        """The name of the file that holds this text: stem.csv for the first, stem_label.csv for others."""
        for name, there in self.texts.items():
            if there == text:
                return name
        name = _free(self.texts, f"{stem}.csv", f"{stem}_{_word(label)}.csv")
        self.texts[name] = text
        return name

    def add_encoder(self, encoder: Encoder, label: str) -> tuple[str, str]:
        """The file and the column (without its unit) that hold an encoder."""
        time, label = np.asarray(encoder.knots.time_s), _word(label)
        angle = rounded(np.degrees(np.asarray(encoder.angle_rad)), _ENCODER_DEG)
        same = [(file, columns) for file, clock, columns in self._clocks if np.array_equal(clock, time)]
        if not same:
            taken = [file for file, _, _ in self._clocks]
            same = [(_free(taken, "encoders.csv", f"encoders_{label}.csv"), {})]
            self._clocks.append((same[0][0], time, same[0][1]))
        file, columns = same[0]
        for name, there in columns.items():
            if there == angle:
                return file, name
        column = _free(columns, label)
        columns[column] = angle
        return file, column

    def finished(self) -> dict[str, str]:
        """All files."""
        encoders = {
            file: table_text({"time_s": exact(clock)} | {f"{name}_deg": angle for name, angle in columns.items()})
            for file, clock, columns in self._clocks
        }
        return self.texts | encoders


def chain_to_toml(flight: Flight, tables: Tables) -> list[dict[str, Any]]:
    """The entries of [[chain]]; their tables are added.

    **Raises:** `FlightError` where a link has no form on disk.
    """
    gap = max_gap_s(flight.sensor)
    return [
        {"frame": name} | _link(link, name, flight, tables, gap)
        for name, link in zip(flight.sensor.names, flight.sensor.links, strict=True)
    ]


def max_gap_s(sensor: Sensor) -> float | None:
    """The gap that [pos] states: that of the first series."""
    return next((record.knots.max_gap_s for link in sensor.links for record in link.recorded), None)


def _link(link: AbstractLink, label: str, flight: Flight, tables: Tables, gap: float | None) -> dict[str, Any]:
    world = flight.world
    if isinstance(link, Trajectory):
        columns = {"time_s": exact(link.knots.time_s)} | dict(sample_texts(_samples(link), world))
        file = tables.add("pos", label, table_text(columns))
        return _given(
            link="trajectory",
            file=None if file == "pos.csv" else file,
            max_gap_s=None if link.knots.max_gap_s == gap else link.knots.max_gap_s,
            delay_s=_number(link.delay_s),
            attitude_delay_s=_number(link.attitude_delay_s),
            interpolation=None if link.interpolation == "linear" else link.interpolation,
        )
    if isinstance(link, PosePerImage):
        columns = {"image": [image.name for image in flight.images]} | dict(sample_texts(_samples(link), world))
        small = (degree_lists(link.turn_rad) if link.turn_rad is not None else None, link.shift_m)
        for names, value in zip(SMALL_MOTION, small, strict=True):
            if value is not None:
                columns |= dict(zip(names, (exact(c) for c in np.asarray(value).T), strict=True))
        file = tables.add("poses", label, table_text(columns))
        return _given(link="poses", file=None if file == "poses.csv" else file)
    if isinstance(link, Mount):
        return _given(
            link="mount",
            lever_arm_m=_single(link.lever_arm_m, label),
            angles_deg=None if link.angles_rad is None else degree_lists(_single(link.angles_rad, label)),
            order=None if link.order == "xyz" else link.order,
            lever_sign=None if link.lever_sign == 1 else link.lever_sign,
        )
    if isinstance(link, Axes):
        return {"link": "axes", "axes": link.axes}
    if isinstance(link, Fixed):
        return {"link": "rotation", "matrix": [[float(v) for v in row] for row in link.rotation]}
    if isinstance(link, Turn) and isinstance(link.encoder, Encoder):
        file, column = tables.add_encoder(link.encoder, label)
        return _given(
            link="turn",
            axis=link.axis,
            encoder=column if file == "encoders.csv" else {"file": file, "column": column},
            sign=link.sign,
            delay_s=_number(link.delay_s),
            zero_deg=None if type(link.zero_rad) is int else degrees(float(link.zero_rad)),
            gain=_number(link.gain),
            polynomial_deg=None if link.polynomial_rad is None else degree_lists(_single(link.polynomial_rad, label, 1)),
            max_gap_s=None if link.encoder.knots.max_gap_s == gap else link.encoder.knots.max_gap_s,
            interpolation=None if link.encoder.interpolation == "linear" else link.encoder.interpolation,
            wraps=None if link.encoder.wraps is None else False,  # jumps of a whole turn are taken out of what is written
        )
    if isinstance(link, Correction):
        return _given(
            link="correction",
            basis=_basis(link.basis),
            turn_deg=None if link.turn_rad is None else degree_lists(link.turn_rad),
            shift_m=None if link.shift_m is None else floats(link.shift_m),
        )
    if isinstance(link, By):
        options = {n: _link(o, f"{label}_{_word(n)}", flight, tables, gap) for n, o in zip(link.names, link.options, strict=True)}
        return {"link": "by", "key": link.key, "options": options}
    if isinstance(link, Records | Turn):
        # Aligned with the shots of some call, they hold no times to find them by.
        kind, timed = ("Turn by Readings", "an Encoder") if isinstance(link, Turn) else ("Records", "a Trajectory.from_geodetic")
        raise FlightError(f"link {label!r}: {kind} cannot be written: a folder finds angles and poses by time; use {timed}")
    raise FlightError(f"link {label!r} is a {type(link).__name__}, which has no form in a flight folder")


def _samples(link: Trajectory | PosePerImage) -> Samples:
    # The velocities of a spline are its own, not recorded.
    velocity = link.velocity_mps if isinstance(link, Trajectory) and link.interpolation == "linear" else None
    return Samples(_rows(link.position_m), _rows(link.quaternion), None if velocity is None else _rows(velocity))


def _rows(components: Any) -> np.ndarray:
    return np.stack([np.asarray(c) for c in components], axis=-1)


def _basis(basis: Any) -> dict[str, Any]:
    if isinstance(basis, Bias):
        return {"kind": "bias"}
    if isinstance(basis, Drift):
        return {"kind": "drift", "start_s": float(basis.start_s), "span_s": float(basis.span_s)}
    if isinstance(basis, OrientationImages | Spline):
        kind = "spline" if isinstance(basis, Spline) else "orientation_images"
        return {"kind": kind, "start_s": floats(basis.start_s), "spacing_s": float(basis.spacing_s), "nodes": list(basis.nodes)}
    if isinstance(basis, Process):
        parameter = "start_sigma" if basis.kind == "random_walk" else "correlation_s"
        return {"kind": basis.kind, "nodes_s": floats(basis.time_s), parameter: basis.parameter}
    raise FlightError(f"a correction on {type(basis).__name__} has no form in a flight folder")


def camera_to_toml(camera: Any, tables: Tables, label: str = "camera") -> dict[str, Any]:
    """The table [camera]; a focal length for each image goes to images.csv, see `focal_per_image`.

    **Raises:** `FlightError` where a camera has no form on disk.
    """
    if isinstance(camera, FrameCamera):
        return _given(
            kind="frame",
            focal_px=None if camera.per_image else _single(camera.focal_px, label),
            principal_point_px=_single(camera.principal_point_px, label, 1),
            distortion=_single(camera.distortion, label, 1),
            size_px=_single(camera.size_px, label, 1),
        )
    if isinstance(camera, LineCamera):
        return _given(
            kind="line",
            focal_px=_single(camera.focal_px, label, 0),
            principal_sample_px=_single(camera.principal_sample_px, label, 0),
            offset_px=_single(camera.offset_px, label, 0),
            along=camera.along,
            along_sign=int(camera.along_sign),
            across_sign=int(camera.across_sign),
            deformation_px=_single(camera.deformation_px, label, 2),
            half_width_px=_single(camera.half_width_px, label, 0),
            samples_px=_single(camera.samples_px, label, 1),
            wave_px=_single(camera.wave_px, label, 2),
            wavelength_px=_single(camera.wavelength_px, label, 0),
        )
    if isinstance(camera, LookTable):
        slope = np.asarray(camera.slope)
        columns = {"sample": exact(camera.sample_px), "x": exact(slope[:, 0]), "y": exact(slope[:, 1])}
        file = tables.add("looks", label.removeprefix("camera_"), table_text(columns | {"z": ["-1"] * len(slope)}))
        return _given(kind="looks", file=None if file == "looks.csv" else file)
    if isinstance(camera, By):
        options = {n: camera_to_toml(o, tables, f"{label}_{_word(n)}") for n, o in zip(camera.names, camera.options, strict=True)}
        return {"kind": "by", "key": camera.key, "options": options}
    raise FlightError(f"{label} is a {type(camera).__name__}, which has no form in a flight folder")


def refraction_to_toml(flight: Flight) -> dict[str, Any] | None:
    """The table [refraction], if light is bent.

    **Raises:** `FlightError` in a local world.
    """
    refraction = flight.sensor.refraction
    if refraction is None:
        return None
    if flight.world.is_flat:
        raise FlightError("refraction: light is bent by air at heights above sea level, which a local world does not have")
    return {"scale": _single(refraction.scale, "refraction", 0), "wavelength_um": refraction.wavelength_um}


def focal_per_image(flight: Flight) -> list[str]:
    """The column focal_px of images.csv: empty texts where no camera has a focal length for each image."""
    out = []
    for i, image in enumerate(flight.images):
        camera: Any = flight.sensor.camera
        while isinstance(camera, By):
            index = flight.key_index(image, camera.key)
            assert index is not None
            camera = camera.options[index]
        out += exact([camera.focal_px[i]]) if isinstance(camera, FrameCamera) and camera.per_image else [""]
    return out


def _given(**entries: Any) -> dict[str, Any]:
    """What is not None; an absent key means the default."""
    return {key: value for key, value in entries.items() if value is not None}


def _number(value: Any) -> float | None:
    """A structural zero or one is left out, everything else is a number."""
    return None if type(value) is int else float(value)


def _single(value: Any, label: str, dimensions: int | None = None) -> Any:
    """One value for all shots as lists of floats; None stays None."""
    if value is None:
        return None
    dimensions = (0 if np.ndim(value) == 0 else 1) if dimensions is None else dimensions
    if np.ndim(value) != dimensions:
        raise FlightError(f"{label}: an array of shape {np.shape(value)} stands where one value for all shots is expected")
    return floats(value)


def _word(name: str) -> str:
    """A name as a part of a file name or a column: without what these cannot hold, and short enough for a file system."""
    return re.sub(r"\W+", "_", name).encode("utf-8")[:_LONGEST].decode("utf-8", "ignore")


def _free(taken: Container[str], *names: str) -> str:
    """The first name that is not taken; when all are, the last one with a number."""
    stem, dot, suffix = names[-1].partition(".")
    numbered = (f"{stem}_{i}{dot}{suffix}" for i in itertools.count(2))
    return next(name for name in itertools.chain(names, numbered) if name not in taken)
