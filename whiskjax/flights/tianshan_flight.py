"""The simulated looks of `tianshan` as a flight: navigation and gimbal recorded in time, so that it can be written and read."""

import jax
import numpy as np

from ..chain.camera import FrameCamera
from ..chain.mounts import Axes
from ..chain.sensor import Sensor
from ..chain.trajectory import Trajectory
from ..chain.turn import Encoder, Turn
from ..earth.ellipsoid import geodetic_to_ecef
from . import tianshan
from .flight import Flight, Image, Measurements, Points

TARGET = "target"
STANDARD = tianshan.Scene()
# A little more than the time between two looks, which are the samples.
_MAX_GAP_S = tianshan.SPACING_S + 0.5


def simulate(seed: int, scene: tianshan.Scene = STANDARD) -> Flight:
    """One run of looks with the errors of Table 1.

    **Arguments:** `seed`: of `tianshan.draw`, whose first run this is; `scene`: at least two looks.

    **Returns:** a frame image for each look, and the check point "target", which all of them saw. Records and readings are
    samples at the times of the looks; their errors are the flight's noise.
    """
    recorded, pixel = jax.tree.map(lambda value: np.asarray(value[0]), tianshan.draw(scene, 1, seed))
    time = tianshan.time_s(scene)
    r = recorded
    body = Trajectory.from_geodetic(
        time, r.lat_rad, r.lon_rad, r.height_m, r.roll_rad, r.pitch_rad, np.mod(r.heading_rad, 2 * np.pi), max_gap_s=_MAX_GAP_S
    )
    sensor = Sensor(
        {
            "body": body,
            "gimbal_roll": Turn("x", Encoder(time, r.gimbal_roll_rad, _MAX_GAP_S, "gimbal_roll")),
            "gimbal_pitch": Turn("y", Encoder(time, r.gimbal_pitch_rad, _MAX_GAP_S, "gimbal_pitch")),
            "view": Axes("x -y -z"),
        },
        FrameCamera(tianshan.FOCAL_PX, (0.0, 0.0)),
    )
    lat_deg, lon_deg, height_m = scene.target
    position = np.asarray(geodetic_to_ecef(np.radians(lat_deg), np.radians(lon_deg), height_m))
    sigma = np.full(scene.looks, tianshan.PIXEL_SIGMA_PX)
    return Flight(
        name=f"tianshan, {scene.path} of {scene.looks} looks, seed {seed}",
        sensor=sensor,
        images=[Image(f"look-{i + 1}", time_s=t) for i, t in enumerate(time.tolist())],
        points=Points([TARGET], position[None], np.zeros((1, 3)), ["check"]),
        measurements=Measurements(
            np.arange(scene.looks), np.zeros(scene.looks, dtype=int), pixel[:, 1], pixel[:, 0], sigma, sigma
        ),
        noise=tianshan.noise(),
        reference_point="camera",
        notes="Simulated after Liu et al. (2019): one target, seen by a gimballed camera from an aircraft.",
    )
