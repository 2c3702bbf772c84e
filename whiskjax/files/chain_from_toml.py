"""The sensor of a flight folder: every entry of [[chain]] as a link, [camera] as a camera."""

import dataclasses
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np

from ..chain.by import By
from ..chain.camera import FrameCamera
from ..chain.correction import Bias, Correction, Drift, OrientationImages, Spline
from ..chain.line_camera import LineCamera
from ..chain.link import AbstractLink, Fixed
from ..chain.look_table import LookTable
from ..chain.mounts import Axes, Mount
from ..chain.possible import refuse_impossible_speed
from ..chain.process import Process
from ..chain.sensor import Sensor, check_frame_name
from ..chain.trajectory import PosePerImage, Trajectory
from ..chain.turn import Encoder, Turn
from ..chain.wraps import unwrapped
from ..earth.refraction import Refraction
from ..rules import FlightError, WhiskjaxError
from . import cautions
from .flight_toml import NAME
from .flown import in_words_of_sbet, in_words_of_table
from .names import listed, meant
from .navigation import Samples, is_ignored, navigation_columns, samples
from .sbet import is_sbet, read_sbet
from .source import Source
from .tables import Column, Table, check_increasing, refuse_codes
from .units import radian_array

if TYPE_CHECKING:
    from .schema import AnyCamera, AnyLink, RefractionTable, TrajectoryLink, TurnLink


def sensor_from_toml(source: Source) -> Sensor:
    """The whole chain.

    **Raises:** `FlightError` naming the file, and the line and column or the entry of flight.toml.
    """
    links: dict[str, AbstractLink] = {}
    for i, entry in enumerate(source.toml.chain):
        place = f"{NAME}: chain[{i}]"
        if not entry.frame:
            raise FlightError(f"{place}: frame is missing: name the frame that this link leads to")
        _made(place, lambda _, name=entry.frame: check_frame_name(name))
        if entry.frame in links:
            raise FlightError(f"{place}: the frame {entry.frame!r} is there twice")
        links[entry.frame] = _made(f"{place} (frame {entry.frame!r})", _link, entry, source)
    camera = _made(f"{NAME}: camera", _camera, source.toml.camera, source)
    refraction = None
    if source.toml.refraction is not None:
        refraction = _made(f"{NAME}: refraction", _refraction, source.toml.refraction, source)
    return _made(NAME, lambda place: Sensor(links, camera, refraction))


def _made(place: str, make: Any, *arguments: Any) -> Any:
    """What `make` returns; what it refuses is given the place."""
    try:
        return make(*arguments, place)
    except FlightError:
        raise
    except WhiskjaxError as error:
        raise FlightError(f"{place}: {error}") from error


def _link(entry: "AnyLink", source: Source, place: str) -> AbstractLink:
    match entry.link:
        case "trajectory":
            return _trajectory(entry, source, place)
        case "poses":
            return _poses(entry.file, source, place)
        case "mount":
            angles = None if entry.angles_deg is None else radian_array(entry.angles_deg)
            return Mount(entry.lever_arm_m, angles, entry.order, entry.lever_sign)
        case "axes":
            return Axes(entry.axes)
        case "rotation":
            return _rotation(entry.matrix)
        case "turn":
            zero = 0 if entry.zero_deg is None else float(np.radians(entry.zero_deg))
            gain = 1 if entry.gain is None else entry.gain
            uneven = None if entry.polynomial_deg is None else radian_array(entry.polynomial_deg)
            return Turn(entry.axis, _encoder(entry, source, place), entry.sign, entry.delay_s or 0, zero, gain, uneven)
        case "correction":
            turn = None if entry.turn_deg is None else jnp.asarray(radian_array(entry.turn_deg))
            shift = None if entry.shift_m is None else jnp.asarray(np.array(entry.shift_m))
            return Correction(_basis(entry.basis), turn, shift)
        case "by":
            return _by(entry, _link, source, place)


def _by(entry: Any, make: Any, source: Source, place: str) -> By:
    options = {}
    for name, option in entry.options.items():
        inner = f"{place}.options.{name}"
        if getattr(option, "frame", ""):
            raise FlightError(f"{inner}: an option has no frame of its own; leave frame out")
        options[name] = _made(inner, make, option, source)
    return By(entry.key, options)


def _max_gap(entry: "TrajectoryLink | TurnLink", source: Source, place: str) -> float:
    value = entry.max_gap_s or source.toml.pos.max_gap_s
    if value is None:
        raise FlightError(
            f"{place}: max_gap_s is missing: the longest interval in seconds between samples that may be interpolated; "
            "set it in [pos], or here"
        )
    return value


def _trajectory(entry: "TrajectoryLink", source: Source, place: str) -> Trajectory:
    pos = source.toml.pos
    file, gap = entry.file or pos.file, _max_gap(entry, source, place)
    delays = {"delay_s": _or_zero(entry.delay_s), "attitude_delay_s": _or_zero(entry.attitude_delay_s)}
    way = entry.interpolation
    if is_sbet(file):
        if source.toml.world.kind == "local" or pos.angles != "roll_pitch_heading":
            raise FlightError(f'{place}: {file}: SBET holds latitude, longitude, height and angles = "roll_pitch_heading"')
        with in_words_of_sbet(file):
            records = read_sbet(source.folder / file)
            made = Trajectory(*records, max_gap_s=gap, **delays, interpolation=way)
            refuse_impossible_speed(records.time_s, records.position_m, gap)
            return made
    time_s, found, table = _recorded(file, source, place, gap)
    velocity = found.velocity_mps
    if velocity is not None and way == "cubic":
        source.note([f"{file}: velocities left out: a cubic trajectory has those of its positions."])
        velocity = None
    with in_words_of_table(table, pos.angles):
        made = Trajectory(
            time_s, found.position_m, found.quaternion, max_gap_s=gap, velocity_mps=velocity, **delays, interpolation=way
        )
        refuse_impossible_speed(time_s, found.position_m, gap)
        return made


def _recorded(file: str, source: Source, place: str, max_gap_s: float) -> tuple[np.ndarray, Samples, Table]:
    """Times and samples of a POS table, and its rows by name only: what it held may be large, and is not needed twice."""
    sheet, world, angles = source.sheet(file, place), source.toml.world.kind, source.toml.pos.angles
    table = sheet.parse([Column("time_s"), *navigation_columns(sheet, world, angles)], ignore=is_ignored)
    source.leave_out(table, "accuracies of POS samples are not used yet")
    if len(table) < 2:
        raise FlightError(f"{file}: {len(table)} samples; at least two are needed to interpolate")
    check_increasing(table, "time_s")
    time_s, found = table["time_s"], samples(table, world, angles)
    source.note(cautions.of_positions(table, time_s, found, max_gap_s))
    return time_s, found, dataclasses.replace(table, columns={})


def _or_zero(value: float | None) -> Any:
    """An absent number is exactly zero, and costs nothing."""
    return 0 if value is None else value


SMALL_MOTION = (("turn_x_deg", "turn_y_deg", "turn_z_deg"), ("shift_x_m", "shift_y_m", "shift_z_m"))


def _poses(file: str, source: Source, place: str) -> PosePerImage:
    sheet, world, angles = source.sheet(file, place), source.toml.world.kind, source.toml.pos.angles
    small = [Column(n, required=any(m in sheet.header for m in names)) for names in SMALL_MOTION for n in names]
    table = sheet.parse([Column("image", text=True), *navigation_columns(sheet, world, angles), *small], ignore=is_ignored)
    source.leave_out(table, "accuracies of poses are not used yet")
    order = _rows_by_image(table, source)
    position, quaternion, _ = samples(table, world, angles)
    source.note(cautions.of_poses(table, position))
    turn, shift = (np.stack([table[n] for n in names], axis=-1)[order] if names[0] in table else None for names in SMALL_MOTION)
    return PosePerImage(position[order], quaternion[order], None if turn is None else np.radians(turn), shift)


def _rows_by_image(table: Table, source: Source) -> list[int]:
    """The row of each image, in the order of images.csv."""
    rows: dict[str, int] = {}
    names = source.images["image"]
    for row, name in enumerate(table["image"]):
        if name not in names:
            table.fail(row, "image", f"no image {name!r}{meant(name, names)}; images.csv has {listed(names)}")
        if name in rows:
            table.fail(row, "image", f"image {name!r} is there twice; the first is line {table.lines[rows[name]]}")
        rows[name] = row
    for row, name in enumerate(names):
        if name not in rows:
            source.images.fail(row, "image", f"image {name!r} has no line in {table.file}")
    return [rows[name] for name in names]


def _rotation(matrix: list[list[float]]) -> Fixed:
    r = np.array(matrix, dtype=np.float64)
    if not (np.allclose(r @ r.T, np.eye(3), atol=1e-6) and np.linalg.det(r) > 0):
        raise WhiskjaxError("matrix is not a rotation: its rows must be orthogonal unit vectors, right-handed")
    # Exact zeros and ones stay Python ints and are folded away while tracing.
    entry = lambda v: int(v) if v in (0.0, 1.0, -1.0) else jnp.asarray(v)
    return Fixed(tuple(tuple(entry(v) for v in row) for row in r.tolist()))


def _encoder(entry: "TurnLink", source: Source, place: str) -> Encoder:
    file, column = entry.encoder.file, entry.encoder.column.removesuffix("_deg") + "_deg"
    sheet = source.sheet(file, place)
    if column not in sheet.header:
        known = [name.removesuffix("_deg") for name in sheet.header if name.endswith("_deg")]
        wanted = column.removesuffix("_deg")
        raise FlightError(
            f"{place}: no encoder {wanted!r}{meant(wanted, known)}: {file}, line 1 has no column {column}; the encoders there "
            f"are {listed(known) or 'none'}"
        )
    table = sheet.parse([Column("time_s")], pattern=lambda name: Column(name, blank=True) if name.endswith("_deg") else None)
    check_increasing(table, "time_s")
    sampled = ~np.isnan(table[column])
    if sampled.sum() < 2:
        raise FlightError(f"{file}, column {column}: {sampled.sum()} samples; at least two are needed to interpolate")
    refuse_codes(table, column, np.flatnonzero(sampled))
    source.note(cautions.of_encoder(table, column, np.flatnonzero(sampled)))
    time, angle, gap = table["time_s"][sampled], np.radians(table[column][sampled]), _max_gap(entry, source, place)
    _, unclear = unwrapped(time, angle, np.diff(time) > gap, entry.wraps)
    if unclear:
        table.fail(int(np.flatnonzero(sampled)[unclear.sample]), column, unclear.what)
    name = f"{file}, {column}"
    return Encoder(time, angle, gap, name, interpolation=entry.interpolation, wraps=entry.wraps)


def _basis(basis: Any) -> Any:
    match basis.kind:
        case "bias":
            return Bias()
        case "drift":
            return Drift(basis.start_s, basis.span_s)
        case "orientation_images":
            return OrientationImages(basis.start_s, basis.spacing_s, basis.nodes)
        case "spline":
            return Spline(basis.start_s, basis.spacing_s, basis.nodes)
        case "random_walk":
            return Process.random_walk(basis.nodes_s, basis.start_sigma)
        case "ornstein_uhlenbeck":
            return Process.ornstein_uhlenbeck(basis.nodes_s, basis.correlation_s)
        case "smooth":
            return Process.smooth(basis.nodes_s, basis.correlation_s)


def _camera(entry: "AnyCamera", source: Source, place: str) -> Any:
    c = source.first_centre
    match entry.kind:
        case "frame":
            focal, per_image = _focal(entry.focal_px, source, place)
            return FrameCamera(
                focal, np.array(entry.principal_point_px) - c, entry.distortion, entry.size_px, per_image=per_image
            )
        case "line":
            return LineCamera(
                entry.focal_px,
                entry.principal_sample_px - c,
                entry.offset_px,
                float(entry.along_sign),
                float(entry.across_sign),
                entry.deformation_px,
                entry.half_width_px,
                None if entry.samples_px is None else np.array(entry.samples_px) - c,
                entry.along,
                entry.wave_px,
                entry.wavelength_px,
            )
        case "looks":
            table = source.sheet(entry.file, place).parse([Column(name) for name in ("sample", "x", "y", "z")])
            check_increasing(table, "sample")
            for row in np.flatnonzero(table["z"] >= 0):
                table.fail(int(row), "z", "is not negative, but a camera looks along -z; put an axes link before the camera")
            return LookTable(table["sample"] - c, np.stack([table[axis] for axis in "xyz"], axis=-1))
        case "by":
            return _by(entry, _camera, source, place)


def _refraction(entry: "RefractionTable", source: Source, place: str) -> Refraction:
    if source.toml.world.kind == "local":
        raise FlightError(f"{place}: light is bent by air at heights above sea level, which a local world does not have")
    return Refraction(entry.scale, entry.wavelength_um)


def _focal(focal_px: float | None, source: Source, place: str) -> tuple[Any, bool]:
    """One focal length for all images, from flight.toml, or one for each, from images.csv."""
    column = source.images["focal_px"] if "focal_px" in source.images else np.full(len(source.images), np.nan)
    blank = np.isnan(column)
    if blank.all():
        if focal_px is None:
            raise FlightError(f"{place}: focal_px is missing: give it here, or for each image in images.csv")
        return focal_px, False
    if focal_px is not None:
        raise FlightError(f"{place}: focal_px is given here and in images.csv, column focal_px; keep one of them")
    if blank.any():
        source.images.fail(int(np.argmax(blank)), "focal_px", "is blank, while other images have a focal length")
    return column, True
