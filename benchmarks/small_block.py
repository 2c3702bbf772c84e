"""CPU seconds of `wj.adjust` of three frame images and seven points: the first in a process, and the next ones.

    python -m benchmarks.small_block

The first includes all that is compiled; without a compilation cache (JAX_COMPILATION_CACHE_DIR unset) that is what a user waits
for.
"""

import time

import jax
import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj

AGAIN = 5


def scene(rng: np.random.Generator) -> tuple[wj.Sensor, wj.Block]:
    """Three control and four tie points; marks of 0.3 px, POS of 1 mrad and 1 m."""
    point = np.column_stack([rng.uniform(-50, 450, 7), rng.uniform(-50, 150, 7), rng.uniform(0, 90, 7)])
    place = np.array([[0.0, 50.0, 900.0], [200.0, 50.0, 917.0], [400.0, 50.0, 883.0]])
    true = Rotation.from_euler("ZYX", rng.normal(0, 1, (3, 3)), degrees=True)
    image, seen = np.divmod(np.arange(21), 7)
    q = np.einsum("nji,nj->ni", true.as_matrix()[image], point[seen] - place[image])
    pixel = np.array([2000.0, 1500.0]) - 3000.0 * q[:, :2] / q[:, 2:] * np.array([1.0, -1.0])
    recorded = true * Rotation.from_rotvec(rng.normal(0, 1e-3, (3, 3)))
    block = wj.Block(
        wj.Shot(image=image),
        pixel + 0.3 * rng.standard_normal(pixel.shape),
        np.full(pixel.shape, 0.3),
        seen,
        np.where(np.arange(7)[:, None] < 3, point, np.nan),
        np.broadcast_to(np.eye(3) * 0.02**2, (7, 3, 3)),
        np.array(["control"] * 3 + ["tie"] * 4),
    )
    photo = wj.PosePerImage(place + rng.normal(0, 1.0, (3, 3)), recorded.as_quat())
    return wj.Sensor({"photo": photo}, wj.FrameCamera(3000.0, (2000.0, 1500.0))), block


def main() -> None:
    """Print them."""
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(3)
    errors = [wj.FrameErrors("photo", turn_sigma_rad=(1e-3,) * 3, shift_sigma_m=(1.0,) * 3)]
    focal = [wj.Unknown("focal length", "camera.focal_px", 3000.0, 10.0)]
    for k in range(1 + AGAIN):
        sensor, block = scene(rng)
        begins = time.process_time()
        found = wj.adjust(sensor, block, focal, errors=errors)
        took = time.process_time() - begins
        print(f"{'again' if k else 'first'} {took:7.3f} CPU s, {found.steps} steps, focal length {found.value[0]:.3f} px")


if __name__ == "__main__":
    main()
