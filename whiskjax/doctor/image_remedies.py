"""Image measurements and cameras by another convention: order, direction, first pixel and unit of image coordinates."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..chain.by import By
from ..chain.camera import FrameCamera
from ..chain.line_camera import LineCamera
from ..chain.lines import LineTimes
from ..chain.sensor import Sensor
from ..estimate.unknown import Unknown
from ..flights.flight import Flight
from .remedy import Amount, Remedy, constant

_TABLE = "observations.csv"
# Pixels of 0.5 um and of 50 um: what millimetres make of pixels, as natural logarithms.
_LEAST, _MOST = math.log(20.0), math.log(2000.0)
_APART = 20.0  # sigmas
_USUAL = (_LEAST + _MOST) / 2


def image_remedies(flight: Flight) -> Iterator[Remedy]:
    """All that is tried of the image coordinates."""
    yield Remedy(
        "line and sample exchanged",
        "image axes",
        "The line stands in the column of the sample, and the sample in that of the line.",
        _exchanged,
        constant(f"{_TABLE}: exchange the columns line and sample (and their sigmas)"),
    )
    if flight.is_line:
        yield from _of_lines(flight)
    else:
        for axis, name, what in ((0, "sample", "from right to left"), (1, "line", "from the bottom upwards")):
            yield Remedy(
                f"{name} counted {what}",
                "image axes",
                f"The {name} counts {what}: the image is mirrored.",
                lambda f, _, axis=axis: _mirrored(f, axis),
                constant(f"{_TABLE}: {name} = {'columns' if axis == 0 else 'rows'} - 1 - {name} (first pixel 0)"),
            )
    yield Remedy(
        "first pixel",
        "first pixel",
        "Image coordinates were measured from another first pixel than the camera's, as 0 or 1, a pixel's corner or its centre.",
        _shifted,
        lambda v: (
            f"{_TABLE}: add {v or 0.0:+.3f} to line and sample; near 0.5 or 1, the program that measured counts from another "
            "pixel than the camera's numbers do: [pixel] first_pixel_centre holds for both"
        ),
        Amount("px", 1.0, 1e-2),
    )
    yield Remedy(
        "focal length in mm",
        "unit of the image",
        "The focal length is not in pixels, but in millimetres: it is too small by the pixels of a millimetre.",
        _longer,
        lambda v: f"flight.toml: camera.focal_px (images.csv: focal_px) and its unknowns' priors times {math.exp(v or 0.0):.6g}",
        Amount("times", 1.0, 1e-5, _USUAL, math.exp, lambda f, px: -_ratio(f, px), _LEAST, _MOST),
    )
    if _is_spread(flight):
        yield Remedy(
            "image coordinates in mm",
            "unit of the image",
            "Image coordinates are millimetres from the principal point, x to the right and y up, where pixels are read.",
            _in_millimetres,
            lambda v: (
                f"{_TABLE}: sample = principal column + k x, line = principal row - k y, with x and y in mm and "
                f"k = {math.exp(v or 0.0):.6g} px/mm, and sigmas times k"
            ),
            Amount("px/mm", 1.0, 1e-5, _USUAL, math.exp, _of_millimetres, _LEAST, _MOST),
        )


def _of_lines(flight: Flight) -> Iterator[Remedy]:
    yield Remedy(
        "direction of samples",
        "image axes",
        "Samples count the other way along the detector.",
        lambda f, _: _with_cameras(f, lambda c: eqx.tree_at(lambda x: x.along_sign, c, -c.along_sign) if _is_line(c) else c),
        constant("flight.toml: camera.along_sign: the other sign"),
    )
    if any(_is_line(c) and bool((np.asarray(c.offset_px) != 0).any()) for c in _cameras(flight.sensor)):
        yield Remedy(
            "direction of views",
            "image axes",
            "The views look the other way: forward stands for backward.",
            lambda f, _: _with_cameras(f, lambda c: eqx.tree_at(lambda x: x.offset_px, c, -c.offset_px) if _is_line(c) else c),
            constant("flight.toml: camera.offset_px of every view: the other sign"),
        )
    yield Remedy(
        "lines counted backwards",
        "order of lines",
        "The first line of each image is the one that was exposed last.",
        _backwards,
        constant("lines.csv: reverse the times of each image"),
    )


def _is_line(camera: Any) -> bool:
    return isinstance(camera, LineCamera)


def _cameras(sensor: Sensor) -> list[Any]:
    return _leaves(sensor.camera)


def _leaves(camera: Any) -> list[Any]:
    return [leaf for option in camera.options for leaf in _leaves(option)] if isinstance(camera, By) else [camera]


def _with_cameras(flight: Flight, change: Callable[[Any], Any]) -> Flight:
    def each(camera: Any) -> Any:
        if isinstance(camera, By):
            return By(camera.key, {n: each(o) for n, o in zip(camera.names, camera.options, strict=True)})
        return change(camera)

    sensor = flight.sensor
    links = dict(zip(sensor.names, sensor.links, strict=True))
    return dataclasses.replace(flight, sensor=Sensor(links, each(sensor.camera), sensor.refraction))


def _exchanged(flight: Flight, _: float | None) -> Flight:
    m = flight.measurements
    sigma = np.where(m.is_in_lines, m.sigma_sample_px, m.sigma_line_px)
    new = dataclasses.replace(m, line_px=m.sample_px, sample_px=m.line_px, sigma_sample_px=sigma)
    if not flight.is_line:
        new = dataclasses.replace(new, sigma_line_px=m.sigma_sample_px)
    return dataclasses.replace(flight, measurements=new)


def _principal_px(flight: Flight) -> Float[np.ndarray, "n 2"]:
    """Column and row (sample and zero) of the principal point at every measurement."""
    camera = flight.sensor.camera
    options, index = [camera], np.zeros(len(flight.measurements), dtype=int)
    if isinstance(camera, By):
        options = _leaves(camera)
        if len(options) == len(camera.options):
            index = np.array([flight.key_index(image, camera.key) for image in flight.images])[flight.measurements.image]
    return np.stack([_principal(c) for c in options])[index]


def _principal(camera: Any) -> Float[np.ndarray, "2"]:
    if isinstance(camera, FrameCamera):
        return np.asarray(camera.principal_point_px).reshape(-1)[:2]
    return np.array([float(camera.principal_sample_px) if _is_line(camera) else 0.0, 0.0])


def _mirrored(flight: Flight, axis: int) -> Flight:
    """About the middle of the image, where its size is known, else about the principal point."""
    m, middle = flight.measurements, _principal_px(flight)[:, axis]
    size = [(image.columns, image.rows)[axis] for image in flight.images]
    camera = flight.sensor.camera
    if all(size):
        middle = (np.array(size, dtype=float)[m.image] - 1) / 2
    elif isinstance(camera, FrameCamera) and camera.size_px is not None:
        middle = np.full(len(m), (float(camera.size_px[..., axis]) - 1) / 2)
    if axis == 0:
        return dataclasses.replace(flight, measurements=dataclasses.replace(m, sample_px=2 * middle - m.sample_px))
    return dataclasses.replace(flight, measurements=dataclasses.replace(m, line_px=2 * middle - m.line_px))


def _shifted(flight: Flight, by_px: float | None) -> Flight:
    """Image coordinates moved by a number of pixels; of line cameras, whose lines are times, the times of the lines."""
    by, m = float(by_px or 0.0), flight.measurements
    sample = dataclasses.replace(m, sample_px=m.sample_px + by)
    if not flight.is_line:
        return dataclasses.replace(flight, measurements=dataclasses.replace(sample, line_px=m.line_px + by))

    def late(lines: LineTimes) -> LineTimes:
        line, time = np.asarray(lines.line), np.asarray(lines.time_s)
        return LineTimes(line, time + by * (time[-1] - time[0]) / (line[-1] - line[0]))

    return dataclasses.replace(with_lines(flight, late), measurements=sample)


def with_lines(flight: Flight, change: Callable[[LineTimes], LineTimes]) -> Flight:
    """The flight with other line tables."""
    images = [i if i.lines is None else dataclasses.replace(i, lines=change(i.lines)) for i in flight.images]
    return dataclasses.replace(flight, images=images)


def _backwards(flight: Flight, _: float | None) -> Flight:
    def reverse(lines: LineTimes) -> LineTimes:
        line, time = np.asarray(lines.line), np.asarray(lines.time_s)
        return LineTimes(line, (time[0] + time[-1]) - time[::-1])

    m = flight.measurements
    ends = np.array([(0.0, 0.0) if i.lines is None else (i.lines.line[0], i.lines.line[-1]) for i in flight.images], dtype=float)
    line = ends[m.image].sum(axis=1) - m.line_px
    return dataclasses.replace(with_lines(flight, reverse), measurements=dataclasses.replace(m, line_px=line))


def _longer(flight: Flight, log_factor: float | None) -> Flight:
    """Focal lengths, and what is known of them, times a factor."""
    factor = math.exp(log_factor or 0.0)

    def known(unknown: Unknown) -> Unknown:
        if unknown.places[0].path[-1] != "focal_px":
            return unknown
        scaled = {name: None if (v := getattr(unknown, name)) is None else v * factor for name in ("mean", "sigma", "scale")}
        return Unknown(unknown.name, unknown.where, **scaled)

    def longer(camera: Any) -> Any:
        if not hasattr(camera, "focal_px"):
            return camera
        return eqx.tree_at(lambda c: c.focal_px, camera, jnp.asarray(np.asarray(camera.focal_px) * factor))

    return dataclasses.replace(_with_cameras(flight, longer), unknowns=[known(x) for x in flight.unknowns])


def _in_millimetres(flight: Flight, log_factor: float | None) -> Flight:
    factor, m, principal = math.exp(log_factor or 0.0), flight.measurements, _principal_px(flight)
    new = dataclasses.replace(
        m, sample_px=principal[:, 0] + factor * m.sample_px, sigma_sample_px=np.asarray(m.sigma_sample_px) * factor
    )
    if not flight.is_line:
        new = dataclasses.replace(
            new, line_px=principal[:, 1] - factor * m.line_px, sigma_line_px=np.asarray(m.sigma_line_px) * factor
        )
    return dataclasses.replace(flight, measurements=new)


def _is_spread(flight: Flight) -> bool:
    """Whether image points lie away from the principal point by more than noise; where all lie in it any unit would do."""
    m, sigma = flight.measurements, np.asarray(flight.measurements.sigma_sample_px)
    return float(np.median(np.abs(m.sample_px - _principal_px(flight)[:, 0]))) > _APART * float(np.median(sigma))


def _spread(px: Float[np.ndarray, "n 2"], is_line: bool) -> float:
    """How far image points lie from the principal point, the median."""
    away = np.abs(px[:, 0]) if is_line else np.hypot(px[:, 0], px[:, 1])
    away = away[np.isfinite(away)]
    return float(np.median(away)) if away.size else 0.0


def _ratio(flight: Flight, projected_px: Float[Any, "n 2"]) -> float:
    """The logarithm of how much farther from the principal point the points are imaged than they were measured."""
    m, principal = flight.measurements, _principal_px(flight)
    measured = np.stack([m.sample_px, m.line_px], axis=-1) - principal
    return _log(_spread(projected_px - principal, flight.is_line), _spread(measured, flight.is_line))


def _of_millimetres(flight: Flight, projected_px: Float[Any, "n 2"]) -> float:
    m = flight.measurements
    measured = np.stack([m.sample_px, m.line_px], axis=-1)
    return _log(_spread(projected_px - _principal_px(flight), flight.is_line), _spread(measured, flight.is_line))


def _log(above: float, below: float) -> float:
    return math.log(above / below) if above > 0 and below > 0 else _USUAL
