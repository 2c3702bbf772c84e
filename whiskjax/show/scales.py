"""Residuals in the units that people ask for: pixels as the chain has them, lines of a line camera, metres on the ground."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..algebra.vectors import unstack
from ..chain.image_scale import line_in_image, on_ground, scale_of_each
from ..chain.sensor import Sensor
from ..chain.shot import Shot
from ..flights.flight import Flight
from ..flights.line_sigmas import s_per_line
from ..rules.results import codes_of
from .plain import number

UNITS = ("px", "lines", "m")


class Scales(NamedTuple):
    """How large pixels are where n points were measured.

    - `ground_m`: where a pixel along each image axis leads on the level ground through the point, east and north, (n, 2, 2).
    - `px_per_line`: of a line camera, across the line, (n,): see `whiskjax.px_per_line`; None for a frame camera.

    NaN where the point is not seen, or from line to line the image stands still.
    """

    ground_m: Float[np.ndarray, "n 2 2"]
    px_per_line: Float[np.ndarray, " n"] | None

    @property
    def m_per_px(self) -> Float[np.ndarray, "n 2"]:
        """How long a pixel is along both image axes: see `whiskjax.m_per_px`."""
        return np.linalg.norm(self.ground_m, axis=-1)

    def metres(self, residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """A residual along both image axes, on the ground."""
        return residual_px * self.m_per_px

    def length(self, residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """How long a residual is on the ground, metres."""
        return np.linalg.norm(np.einsum("na,nag->ng", residual_px, self.ground_m), axis=-1)

    def lines(self, residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Measured - projected line number; NaN for a frame camera, which has none."""
        return np.full(len(residual_px), np.nan) if self.px_per_line is None else residual_px[:, 1] / self.px_per_line


def scales_of(
    flight: Flight, sensor: Sensor, shot: Shot, point_m: Float[np.ndarray, "n 3"], index: Int[np.ndarray, " n"]
) -> Scales:
    """Where the sensor sees points at its shots.

    **Arguments:** `index`: the flight's measurements behind the shots.
    """
    found = scale_of_each(sensor, shot, point_m)
    east, north = (unstack(axis) for axis in np.moveaxis(flight.world.from_enu(np.asarray(point_m)), -1, 0)[:2])
    ground = np.moveaxis(np.asarray(on_ground(found.px_per_m, east, north)), -1, 0)
    ground = np.where((codes_of(found.result) == 0)[:, None, None], ground, np.nan)
    if not flight.is_line:
        return Scales(ground, None)
    (_, across), result = line_in_image(found, s_per_line(flight, index))
    return Scales(ground, np.where(codes_of(result) == 0, np.asarray(across), np.nan))


def axes_of(is_line: bool) -> tuple[str, str]:
    """What the two axes of a residual are called, x and y."""
    return ("along", "across") if is_line else ("column", "row")


def words_of(is_line: bool) -> tuple[str, str]:
    """The same two where there is room for it."""
    return ("along the line", "across the line") if is_line else axes_of(is_line)


def places_of(is_line: bool) -> tuple[str, str]:
    """What the two coordinates of a measured place are called, with their units; lines are counted."""
    return ("sample (px)", "line") if is_line else ("column (px)", "row (px)")


def place_columns(is_line: bool) -> tuple[str, str]:
    """The same two as columns of a CSV file."""
    return ("sample_px", "line") if is_line else ("column_px", "row_px")


def scale_columns(is_line: bool, form: str) -> tuple[str, ...]:
    """Columns of a CSV file beside residuals in pixels: metres and lines, and what they were made with.

    **Arguments:** `form`: how the file names a residual, from its axis and unit: "{}_after_{}".
    """
    metres = (form.format("x", "m"), form.format("y", "m"), "x_m_per_px", "y_m_per_px")
    return (form.format("y", "lines"), "px_per_line", *metres) if is_line else metres


def scale_values(scales: Scales, residual_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n k"]:
    """The values of `scale_columns`."""
    columns = [scales.metres(residual_px), scales.m_per_px]
    if scales.px_per_line is not None:
        columns = [np.stack([scales.lines(residual_px), scales.px_per_line], axis=-1), *columns]
    return np.concatenate(columns, axis=1)


def in_words(is_line: bool) -> str:
    """What x and y of a residual are."""
    if is_line:
        return "x = along the detector line (sample), y = across it, both in focal-plane pixels at the time of the measured line"
    return "x = column, y = row"


def units_in_words(is_line: bool) -> dict[str, str]:
    """Lines and metres, for the units of a summary."""
    metres = "px times the length of a pixel on the ground along that image axis, in the level plane through the point"
    lines = {"lines": "y in px over px_per_line: measured - projected line number"} if is_line else {}
    return lines | {"m": metres}


def has_lines(summary: Mapping[str, Any]) -> bool:
    """Whether a summary is of a line camera."""
    return "lines" in summary["units"]


def axes_in(summary: Mapping[str, Any]) -> tuple[str, str]:
    """What the two axes of the residuals of a summary are called."""
    return axes_of(has_lines(summary))


def size_keys(summary: Mapping[str, Any]) -> dict[str, str]:
    """Keys of an RMS in lines and in metres along both axes in the rows of a summary, and the headings of their columns."""
    x, y = axes_in(summary)
    lines = {"rms_y_lines": f"lines: {y}"} if has_lines(summary) else {}
    return lines | {"rms_x_m": f"m: {x}", "rms_y_m": f"m: {y}"}


def one_keys(summary: Mapping[str, Any]) -> dict[str, str]:
    """Keys of one residual in lines, and its length in metres."""
    lines = {"y_lines": f"lines: {axes_in(summary)[1]}"} if has_lines(summary) else {}
    return lines | {"length_m": "m: length"}


def one_sizes(scales: Scales, residual_px: Float[np.ndarray, "n 2"], i: int) -> dict[str, float | None]:
    """Residual i of all in lines and metres, for the row of a summary."""
    metres = scales.metres(residual_px)[i]
    lines, length = scales.lines(residual_px)[i], scales.length(residual_px)[i]
    return {"y_lines": number(lines), "x_m": number(metres[0]), "y_m": number(metres[1]), "length_m": number(length)}


def axes_in_words(summary: Mapping[str, Any]) -> str:
    """One sentence under a table in pixels."""
    if has_lines(summary):
        return "Along and across the detector line, in focal-plane pixels, which across the line are not lines."
    return "Column and row of the image."


def caption(summary: Mapping[str, Any]) -> str:
    """One sentence under a table that has such columns."""
    if has_lines(summary):
        return (
            "Along and across the detector line. px: of the focal plane, which across the line are not lines; lines: those over "
            "how many pixels one line is; m: on level ground through the point."
        )
    return "m: on level ground through the point."
