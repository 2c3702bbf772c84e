"""The seven instruments of the README as lists of the same few links, built and drawn.

    python docs/seven_chains.py        writes docs/seven_chains.png

The sensors here carry made-up numbers; tests/chain/test_seven_chains.py images through each of them.
"""

import pathlib

import jax
import numpy as np

import whiskjax as wj
from whiskjax.chain.samples import quaternions_from_matrices

TIME_S = np.linspace(0.0, 10.0, 11)


def trajectory(height_m: float = 3000.0) -> wj.Trajectory:
    """Straight and nearly level, north of the equator."""
    zero = 0 * TIME_S
    lat, lon = np.radians(32.5) + 1e-5 * TIME_S, np.radians(120.5) + zero
    return wj.Trajectory.from_geodetic(TIME_S, lat, lon, height_m + zero, zero, 0.01 + zero, zero, max_gap_s=2.0)


def level_poses(*axes: str) -> wj.PosePerImage:
    """Two poses above the same place, turned from north-east-down by a signed permutation."""
    body = trajectory().pose(wj.Shot(time_s=TIME_S[:2]))
    for a in axes:
        body = body @ wj.Axes(a).pose(wj.Shot())
    return wj.PosePerImage(np.asarray(body.origin_m), quaternions_from_matrices(np.asarray(body.matrix)))


def encoder(*angles_deg: float) -> wj.Encoder:
    """From the first angle to the last one over the record."""
    return wj.Encoder(TIME_S, np.radians(np.linspace(angles_deg[0], angles_deg[-1], len(TIME_S))), 2.0)


def sensors() -> dict[str, wj.Sensor]:
    """Every chain of the README's table."""
    whisk = {
        s: wj.LineCamera(10750.0, across_sign=sign, samples_px=(-1000, 1000)) for s, sign in (("left", 1.0), ("right", -1.0))
    }
    views = {n: wj.LineCamera(26000.0, along="y", offset_px=26000.0 * np.tan(np.radians(v))) for n, v in VIEWS.items()}
    frame = wj.FrameCamera(30975.0, (13210.0, 8502.0))
    zoom = wj.FrameCamera(np.array([2000.0, 4000.0]), (320.0, 180.0), per_image=True)
    small = [0.001, -0.002, 0.003]
    return {
        "haian (whiskbroom)": wj.Sensor(
            {
                "body": trajectory(),
                "flu": wj.Axes("x -y -z"),
                "gps_arm": wj.Mount([0.0, 0.2, 0.9]),
                "platform": wj.By("swing", {"left": wj.Mount(angles_rad=small), "right": wj.Mount(angles_rad=small)}),
                "scan": wj.Turn("x", encoder(-50, 50)),
                "pitch": wj.Turn("y", encoder(-2, 2)),
                "sensor": wj.Mount([0.0, 0.0, -2.0], small),
            },
            wj.By("swing", whisk),
        ),
        "songshan (three-line)": wj.Sensor(
            {
                "body": trajectory(),
                "flu": wj.Axes("x -y -z"),
                "boresight": wj.Mount(angles_rad=small),
                "centre": wj.Mount([0.1, 0.2, 1.0], lever_sign=-1),
            },
            wj.By("view", views),
        ),
        "tianshan (many looks)": wj.Sensor(
            {
                "body": trajectory(10000.0),
                "outer": wj.Turn("x", encoder(10, 30)),
                "inner": wj.Turn("y", encoder(-5, 5)),
                "camera_axes": wj.Axes("x -y -z"),
            },
            wj.FrameCamera(1e5, (0.0, 0.0)),
        ),
        "misb_uas (zoom turret)": wj.Sensor(
            {
                "body": trajectory(),
                "boresight": wj.Mount(angles_rad=small),
                "azimuth": wj.Turn("z", encoder(80, 110)),
                "elevation": wj.Turn("y", encoder(-50, -40)),
                "camera_axes": wj.Axes("y -z -x"),
            },
            zoom,
        ),
        "ign_frame (survey camera)": wj.Sensor({"body": level_poses("y x -z"), "boresight": wj.Mount(angles_rad=small)}, frame),
        "rtk_drone_nadir (drone)": wj.Sensor(
            {"body": level_poses(), "boresight": wj.Mount(angles_rad=small), "camera_axes": wj.Axes("y x -z")},
            wj.FrameCamera(4394.0, (2736.0, 1824.0), (-0.1, 0.01, 0.0, 1e-4, -1e-4)),
        ),
        "clarreo (gimballed pushbroom)": wj.Sensor(
            {
                "body": trajectory(400e3),
                "base": wj.Mount([0.3, 25.4, 6.8], small),
                "azimuth": wj.Turn("y", encoder(-2, 2), sign=-1),
                "yoke": wj.Mount(angles_rad=small),
                "elevation": wj.Turn("x", encoder(-3, 3)),
                "head": wj.Mount(angles_rad=small),
                "camera_axes": wj.Axes("y x -z"),
            },
            wj.LookTable([0, 240, 479], [[-0.08, 0.0, -1.0], [0.0, 0.001, -1.0], [0.08, 0.0, -1.0]]),
        ),
    }


VIEWS = {"forward": 27.0, "nadir": 0.0, "backward": -14.0}

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    from whiskjax.show.chains import draw_chains

    figure = draw_chains(sensors())
    figure.savefig(pathlib.Path(__file__).with_suffix(".png"), dpi=130)
