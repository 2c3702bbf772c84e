"""Residuals as people look at them: one row an observation, with names and the place in the image."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...estimate.calibration import Calibration
from ...estimate.reliability import Reliability
from ...flights.flight import Flight, Image
from ..scales import Scales, axes_of, places_of, scales_of, words_of

STAGES = ("before", "after")
FEW = 4  # below so many points an image has no pattern and no statistics of its own


@dataclasses.dataclass(frozen=True)
class Residuals:
    """The n observations of a calibration, measured - projected, before and after it.

    `x` is along the detector line of a line camera (the sample) or the column of a frame, `y` across the line, in focal-plane
    pixels, or the row; `scales` turns residuals into lines and metres. `place` is where in the image the point was measured:
    sample (px) and line (a count), or column and row (px). `weight` is what a robust loss left of an observation: 1 without one,
    0 for a blunder that was left out.
    """

    images: tuple[Image, ...]
    image: Int[np.ndarray, " n"]
    points: tuple[str, ...]
    is_control: Bool[np.ndarray, " n"]
    place: Float[np.ndarray, "n 2"]
    time_s: Float[np.ndarray, " n"] | None
    before_px: Float[np.ndarray, "n 2"]
    after_px: Float[np.ndarray, "n 2"]
    sigma_px: Float[np.ndarray, "n 2"]
    weight: Float[np.ndarray, " n"]
    reliability: Reliability
    scales: Scales
    is_line: bool

    def __len__(self) -> int:
        return len(self.image)

    @property
    def roles(self) -> tuple[str, ...]:
        """The roles that there are, "control" first."""
        return ("control",) * bool(self.is_control.any()) + ("check",) * bool((~self.is_control).any())

    @property
    def axes(self) -> tuple[str, str]:
        """What the two axes of a residual are called."""
        return axes_of(self.is_line)

    @property
    def words(self) -> tuple[str, str]:
        """The same two where there is room for it."""
        return words_of(self.is_line)

    @property
    def places(self) -> tuple[str, str]:
        """What the two coordinates of a place are called, with their units."""
        return places_of(self.is_line)

    def stage(self, stage: str) -> Float[np.ndarray, "n 2"]:
        """The residuals of a stage, "before" or "after"."""
        return self.before_px if stage == "before" else self.after_px

    def arrows(self, stage: str) -> Float[np.ndarray, "n 2"]:
        """The residuals of a stage as an image shows them: across the line positive towards the later lines."""
        later = 1.0 if self.scales.px_per_line is None else np.where(self.scales.px_per_line < 0, -1.0, 1.0)
        return np.stack([self.stage(stage)[:, 0], later * self.stage(stage)[:, 1]], axis=-1)

    def role(self, i: int) -> str:
        """Whether an observation took part ("control") or not ("check")."""
        return "control" if self.is_control[i] else "check"

    def label(self, i: int) -> str:
        """An observation by its names."""
        return f"{self.points[i]} in image {self.images[self.image[i]].name}"

    @property
    def count(self) -> Int[np.ndarray, " images"]:
        """How many observations each image has."""
        return np.bincount(self.image, minlength=len(self.images))

    def worst_images(self, limit: int) -> list[int]:
        """At most so many images, in the order of the flight: all, or those with the largest residuals after.

        Images with less than half of the usual number of points show no pattern; they come last in the choice.
        """
        if len(self.images) <= limit:
            return list(range(len(self.images)))
        square = np.bincount(self.image, (self.after_px**2).sum(axis=1), len(self.images)) / self.count
        rms = np.where(self.count < 0.5 * np.median(self.count), -1.0, np.nan_to_num(np.sqrt(square), nan=np.inf))
        return sorted(int(i) for i in np.argsort(-rms, kind="stable")[:limit])


def gather(calibration: Calibration, flight: Flight) -> Residuals:
    """Residuals of a calibration that was made from `flight.observations()`, with the flight's names.

    **Raises:** `ValueError` where the calibration is of other observations.
    """
    m = flight.measurements
    keep = np.flatnonzero(np.asarray(flight.points.roles)[m.point] != "tie")
    if len(keep) != len(calibration.observations):
        raise ValueError(
            f"the calibration has {len(calibration.observations)} observations and the flight {len(keep)}: "
            "show a calibration with the flight that it was made from"
        )
    used, image = np.unique(m.image[keep], return_inverse=True)
    seen = calibration.observations
    return Residuals(
        images=tuple(flight.images[i] for i in used),
        image=image,
        points=tuple(str(flight.points.names[i]) for i in m.point[keep]),
        is_control=seen.is_control,
        place=np.stack([m.sample_px[keep], m.line_px[keep]], axis=-1),
        time_s=seen.key("time_s"),
        before_px=calibration.residual_before_px,
        after_px=calibration.residual_after_px,
        sigma_px=seen.sigma_px,
        weight=calibration.robust_weight,
        reliability=calibration.reliability,
        scales=scales_of(flight, calibration.sensor, seen.shot, seen.point_m, keep),
        is_line=flight.is_line,
    )
