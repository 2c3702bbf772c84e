"""A textbook pushbroom: a three-line camera that flies straight and level over relief, all in closed form.

World x east, y north, z up; the platform flies east at speed v and height h and is turned by the drift angle `crab` to the right.
The detector of focal length f (px) lies across the platform's forward axis, a view of the angle a at f tan(a) in front of it. A
point at height z seen from (v t, 0, h) is imaged at f times its offset (forward, left) over h - z.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj
from whiskjax.flights.flight import Image, Measurements, Points, World

SPEED_MPS, HEIGHT_M, FOCAL_PX, LINE_S = 60.0, 1200.0, 1200.0, 0.1  # pixels of 1 m and lines of 6 m on the ground z = 0
SAMPLE_PX, CENTRE_PX = 0.5, 500.0  # 1-sigma of the sample; the sample at the principal point
LINES = 0.5  # 1-sigma of the line, in lines
VIEW_RAD = {"fore": np.radians(20.0), "nadir": 0.0, "aft": np.radians(-20.0)}
FIRST_S, LAST_S = 20.0, 60.0


def seen(point_m, view_rad, crab_rad):
    """Time and sample at which points (n, 3) cross the line of a view."""
    c, s = np.cos(crab_rad), np.sin(crab_rad)
    # On the line: forward = tan(a) (h - z), with forward = c dx - s dy and left = s dx + c dy of (dx, dy) from the platform.
    depth, dy = HEIGHT_M - point_m[:, 2], point_m[:, 1]
    dx = (np.tan(view_rad) * depth + s * dy) / c
    return (point_m[:, 0] - dx) / SPEED_MPS, CENTRE_PX + FOCAL_PX * (s * dx + c * dy) / depth


def px_per_line(point_m, crab_rad):
    """Focal-plane pixels along and across the line that the platform's way in one line period is, seen at the point's depth."""
    move = SPEED_MPS * LINE_S * FOCAL_PX / (HEIGHT_M - point_m[:, 2])
    return np.stack([move * np.sin(crab_rad), move * np.cos(crab_rad)], axis=-1)


def sensor(crab_rad=0.0):
    """The same instrument as a chain of whiskjax; samples count to the left."""
    t = np.arange(0.0, 81.0, 1.0)
    place = np.stack([SPEED_MPS * t, 0 * t, HEIGHT_M + 0 * t], axis=-1)
    down = np.diag([1.0, -1.0, -1.0])  # body x forward, y right, z down over a heading of east
    attitude = Rotation.from_matrix(down @ Rotation.from_euler("z", crab_rad).as_matrix()).as_quat()
    links = {
        "body": wj.Trajectory(t, place, np.broadcast_to(attitude, (len(t), 4)), max_gap_s=1.5),
        "flu": wj.Axes("x -y -z"),
        "boresight": wj.Mount(angles_rad=np.zeros(3)),
    }
    cameras = {v: wj.LineCamera(FOCAL_PX, CENTRE_PX, FOCAL_PX * np.tan(a), along="y") for v, a in VIEW_RAD.items()}
    return wj.Sensor(links, wj.By("view", cameras))


def flight(seed, crab_rad=0.0, control=40, ties=20, sigmas="lines"):
    """Points seen by all three views, lines measured to half a line, which is said in lines, or wrongly in pixels."""
    rng = np.random.default_rng(seed)
    n = control + ties
    point = np.stack([rng.uniform(2000, 2900, n), rng.uniform(-400, 400, n), rng.uniform(0, 400, n)], axis=-1)
    time, sample = (np.concatenate(parts) for parts in zip(*(seen(point, a, crab_rad) for a in VIEW_RAD.values()), strict=True))
    rays = len(time)
    line = (time - FIRST_S) / LINE_S + LINES * rng.standard_normal(rays)
    half, none = np.full(rays, LINES), np.full(rays, np.nan)
    told = {"sigma_line_px": none, "sigma_lines": half} if sigmas == "lines" else {"sigma_line_px": half}
    known = np.where((np.arange(n) < control)[:, None], point, np.nan)
    times = wj.LineTimes([0.0, (LAST_S - FIRST_S) / LINE_S], [FIRST_S, LAST_S])
    made = wj.Flight(
        name="textbook pushbroom",
        sensor=sensor(crab_rad),
        images=[Image(view, lines=times, view=view, strip="one") for view in VIEW_RAD],
        points=Points([f"P{i}" for i in range(n)], known, np.zeros((n, 3)), ["control"] * control + ["tie"] * ties),
        measurements=Measurements(
            image=np.repeat(np.arange(3), n),
            point=np.tile(np.arange(n), 3),
            line_px=line,
            sample_px=sample + SAMPLE_PX * rng.standard_normal(rays),
            sigma_sample_px=np.full(rays, SAMPLE_PX),
            **told,
        ),
        unknowns=[wj.Unknown(f"boresight {x}", f"boresight.angles_rad[{i}]", scale=1e-3) for i, x in enumerate("xyz")],
        world=World("local"),
    )
    return made, np.tile(point, (3, 1))
