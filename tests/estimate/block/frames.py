"""A small block of frame images, and what POS may say of it."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj

SIGMA: dict[str, Any] = {"turn_sigma_rad": (1e-3,) * 3, "shift_sigma_m": (1.0,) * 3}
POS = (wj.FrameErrors("photo", **SIGMA),)
# Nothing was recorded; the start is off by no more than that.
FREE = (*POS, wj.FrameErrors("photo", (np.inf,) * 3, (np.inf,) * 3))
PLACE_M = np.array([[x, y, 900.0 + 20 * np.sin(x)] for y in (0.0, 250.0) for x in (0.0, 200.0, 400.0)])
KAPPA_DEG = np.array([0.0, 0, 0, 180, 180, 180])
POINTS = 24


def frames(turned_deg=0.0, control=3, seed=5):
    """Six frame images in two rows over 24 points, turned about the vertical; everything is off by its sigma."""
    rng = np.random.default_rng(seed)
    about = Rotation.from_euler("z", turned_deg, degrees=True)
    point = np.column_stack([rng.uniform(-50, 450, POINTS), rng.uniform(-50, 300, POINTS), rng.uniform(0, 90, POINTS)])
    true = about * Rotation.from_euler("ZYX", np.column_stack([KAPPA_DEG, rng.normal(0, 1, (6, 2))]), degrees=True)
    camera = wj.FrameCamera(3000.0, (2000.0, 1500.0))
    image, seen = np.divmod(np.arange(6 * POINTS), POINTS)
    offset = about.apply(point[seen]) - about.apply(PLACE_M)[image]
    q = np.einsum("nji,nj->ni", true.as_matrix()[image], offset)
    pixel = np.array([2000.0, 1500.0]) - 3000.0 * q[:, :2] / q[:, 2:] * np.array([1.0, -1.0])
    pixel = pixel + 0.3 * rng.standard_normal(pixel.shape)
    recorded = true * Rotation.from_rotvec(rng.normal(0, 1e-3, (6, 3)))
    places = about.apply(PLACE_M) + true.apply(rng.normal(0, 1.0, (6, 3)))
    role = np.array(["control"] * control + ["tie"] * (POINTS - control))
    block = wj.Block(
        wj.Shot(image=image),
        pixel,
        np.full(pixel.shape, 0.3),
        seen,
        np.where(np.arange(POINTS)[:, None] < control, about.apply(point + rng.normal(0, 0.02, (POINTS, 3))), np.nan),
        np.broadcast_to(np.eye(3) * 0.02**2, (POINTS, 3, 3)),
        role,
        points=[f"P{i}" for i in range(POINTS)],
        images=[f"im{i}" for i in image],
    )
    sensor = wj.Sensor({"photo": wj.PosePerImage(places, recorded.as_quat())}, camera)
    return sensor, block, about, point
