"""Bundle adjustment of three cameras with f, k1 and k2 of their own and seven points, as two peers do it; ours by `wj.adjust`.

The model is that of "Bundle Adjustment in the Large" (Agarwal et al. 2010): P = R X + t, p = -P_xy / P_z, pixel = f (1 + k1 r^2 +
k2 r^4) p, x to the right and y up. Ours looks along -z as well, and its rows count downwards. No pose has a prior: the priors of
the points hold the datum.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

import whiskjax as wj

CAMERAS = ("first", "second", "third")
INTERIOR = ("focal_px", "distortion[0]", "distortion[1]")  # f, k1, k2


@dataclasses.dataclass(frozen=True)
class Bundle:
    """What is measured and known.

    **Arguments:** `turn`, `shift_m`: camera from world; `interior`: f, k1, k2 of each camera, with the priors' `sigma_interior`;
    `marks_px`: x right, y up, of `camera` and `point`; `points_m` with `sigma_points_m`.
    """

    turn: Rotation
    shift_m: Float[np.ndarray, "3 3"]
    interior: Float[np.ndarray, "3 3"]
    camera: Int[np.ndarray, " marks"]
    point: Int[np.ndarray, " marks"]
    marks_px: Float[np.ndarray, "marks 2"]
    points_m: Float[np.ndarray, "points 3"]
    sigma_interior: tuple[float, ...]
    sigma_points_m: float
    sigma_mark_px: float

    @property
    def pixel_px(self) -> Float[np.ndarray, "marks 2"]:
        """Column and row."""
        return self.marks_px * [1, -1]

    @property
    def centre_m(self) -> Float[np.ndarray, "3 3"]:
        """The projection centres."""
        return -self.turn.inv().apply(self.shift_m)

    def sensor(self, centre_m: np.ndarray, world_from_camera: Rotation) -> wj.Sensor:
        """One pose and one camera for each image."""
        cameras = {
            name: wj.FrameCamera(f, (0.0, 0.0), (k1, k2, 0.0, 0.0, 0.0))
            for name, (f, k1, k2) in zip(CAMERAS, self.interior, strict=True)
        }
        return wj.Sensor({"photo": wj.PosePerImage(centre_m, world_from_camera.as_quat())}, wj.By("image", cameras))

    def adjust(self, centre_m: np.ndarray | None = None, world_from_camera: Rotation | None = None) -> wj.Adjustment:
        """By whiskjax, from the given poses or from others."""
        centre_m = self.centre_m if centre_m is None else centre_m
        sensor = self.sensor(centre_m, self.turn.inv() if world_from_camera is None else world_from_camera)
        unknowns = [
            wj.Unknown(f"{field} of the {name}", f"camera.{name}.{field}", float(mean), sigma)
            for name, of_camera in zip(CAMERAS, self.interior, strict=True)
            for field, mean, sigma in zip(INTERIOR, of_camera, self.sigma_interior, strict=True)
        ]
        points = len(self.points_m)
        block = wj.Block(
            shot=wj.Shot(image=self.camera),
            pixel_px=self.pixel_px,
            sigma_px=np.full(self.marks_px.shape, self.sigma_mark_px),
            point=self.point,
            position_m=self.points_m,
            covariance_m2=np.tile(self.sigma_points_m**2 * np.eye(3), (points, 1, 1)),
            role=np.full(points, "control"),
        )
        # The sigmas of poses that nothing observes only whiten.
        start = wj.FrameErrors("photo", (0.1,) * 3, (1.0,) * 3)
        free = wj.FrameErrors("photo", (np.inf,) * 3, (np.inf,) * 3)
        return wj.adjust(sensor, block, unknowns, errors=[start, free], start_m=self.points_m)


def poses_of(adjusted: wj.Adjustment) -> tuple[np.ndarray, Rotation]:
    """Projection centres and attitudes world from camera that were found."""
    found = adjusted.sensor["photo"].pose(wj.Shot(image=np.arange(len(CAMERAS))))
    return np.asarray(found.origin_m), Rotation.from_matrix(np.asarray(found.matrix))


def in_sigmas(covariance: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference of covariance matrices (..., n, n), in units of the two sigmas of each entry."""
    sigma = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    return float(np.abs((covariance - expected) / (sigma[..., :, None] * sigma[..., None, :])).max())
