"""Two small flights that between them hold every link and every camera that a folder can hold."""

import numpy as np

import whiskjax as wj
from whiskjax.chain.link import Fixed
from whiskjax.chain.samples import ecef_samples, quaternions_from_matrices
from whiskjax.flights.flight import Image, Measurements, Points, World

LAT, LON = np.radians(-33.9), np.radians(151.2)


def scanner() -> wj.Flight:
    """Line cameras by view over a wgs84 world: trajectory with velocities, every correction, encoders on two clocks."""
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 4.0, 0.1) + 345600.0
    s = t - t[0]
    lat, lon = LAT + 9e-6 * s, LON + 2e-6 * s
    attitude = np.radians([[1.0], [0.4], [338.0]]) + np.radians(0.1) * rng.normal(size=(3, len(t)))
    velocity = np.stack([57 + 0 * s, 12 + 0 * s, 0.1 * s], axis=-1)
    body = wj.Trajectory.from_geodetic(
        t,
        lat,
        lon,
        1500 + 0.05 * s**2,
        *attitude,
        max_gap_s=0.15,
        velocity_ned_mps=velocity,
        delay_s=0.002,
        attitude_delay_s=-0.001,
    )
    scan = wj.Encoder(t, np.radians(3 * s - 6), 0.15, "scan")
    tilt = wj.Encoder(t[0] - 0.02 + np.arange(90) * 0.05, np.radians(0.3 * np.sin(np.arange(90) / 9)), 0.06, "tilt")
    quarter = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    links = {
        "body": body,
        "drift": wj.Correction(wj.Drift(t[0], 4.0), 1e-5 * rng.normal(size=(2, 3)), rng.normal(size=(2, 3))),
        "wave": wj.Correction(wj.OrientationImages(t[0] - 1, 1.0, 7), 1e-5 * rng.normal(size=(7, 3)), None),
        "smooth": wj.Correction(wj.Spline(t[0] - 1.5, 1.0, 8), None, 0.1 * rng.normal(size=(8, 3))),
        "walk": wj.Correction(wj.Process.random_walk([t[0] - 1, t[0] + 2, t[0] + 9], 0.5), 1e-5 * rng.normal(size=(3, 3)), None),
        "forget": wj.Correction(wj.Process.ornstein_uhlenbeck([t[0] - 1, t[0] + 9], 3.0), 1e-5 * rng.normal(size=(2, 3)), None),
        "warm": wj.Correction(wj.Process.smooth([t[0] - 1, t[0] + 9], 3.0), None, 0.1 * rng.normal(size=(2, 3))),
        "bias": wj.Correction(wj.Bias(), 1e-6 * rng.normal(size=(1, 3)), None),
        "flu": wj.Axes("x -y -z"),
        "arm": wj.Mount(np.array([0.3, -0.2, 1.1]), np.radians([0.1, -0.2, 90.3]), "zyx", -1),
        "quarter": Fixed(tuple(tuple(row) for row in quarter)),
        "platform": wj.By(
            "view", {"fore": wj.Mount(angles_rad=np.radians([0.01, 0.02, 0.03])), "aft look": wj.Mount(np.array([0.0, 0, 1]))}
        ),
        "scan": wj.Turn("x", scan, -1, 0.003, np.radians(0.05)),
        "tilt": wj.Turn("y", tilt),
        "again": wj.Turn("y", tilt, -1, gain=1.0021, polynomial_rad=np.radians([0.013, -0.7, 0.02])),
    }
    looks = np.stack([np.linspace(-0.1, 0.1, 21), 0.001 * np.cos(np.arange(21)), -np.ones(21)], axis=-1)
    cameras = {
        "fore": wj.LineCamera(
            5000.0,
            512.5,
            300.0,
            -1.0,
            1.0,
            1e-2 * rng.normal(size=(2, 4)),
            500.0,
            np.array([0.0, 1023.0]),
            along="y",
            wave_px=[[0.1, -0.2], [0.3, 0.05]],
            wavelength_px=200.0,
        ),
        "aft look": wj.LookTable(np.arange(21) * 50.0, looks),
    }
    sensor = wj.Sensor(links, wj.By("view", cameras))
    images = [
        Image("a", lines=wj.LineTimes([0.0, 100, 250], t[0] + [0.5, 1.5, 3.2]), view="fore", strip="1", columns=1024, rows=251),
        Image("b", lines=wj.LineTimes([0.0, 250], t[0] + [0.6, 3.0]), view="aft look", strip="1"),
    ]
    return _observed("every line link", sensor, images, [0, 0, 1, 1, 1], [10.0, 240.5, 3.25, 100, 200], World(), 1500.0)


def frames() -> wj.Flight:
    """Zoomed frame cameras by swing in a local world: poses with small motions, distortion, a focal length per image."""
    rng = np.random.default_rng(8)
    n = 4
    position = np.array([1e6, 2e5, 1000.0]) + 50 * rng.normal(size=(n, 3))
    nadir = np.array([np.diag([1.0, 1.0, 1.0]), [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]])
    quaternion = quaternions_from_matrices(nadir[[0, 1, 0, 1]]) + 0.02 * rng.normal(size=(n, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    poses = wj.PosePerImage(position, quaternion, 1e-3 * rng.normal(size=(n, 3)), 0.1 * rng.normal(size=(n, 3)))
    focal = 4000 + rng.normal(size=n)
    camera = {
        name: wj.FrameCamera(focal, np.array([2000.25, 1500.5]), k, np.array([4000.0, 3000.0]), per_image=True)
        for name, k in (("left", np.array([-0.05, 0.01, 0.0, 1e-4, -2e-4])), ("right", np.zeros(5)))
    }
    sensor = wj.Sensor({"body": poses, "mount": wj.Mount(None, np.radians([0.5, 0.1, -0.3]))}, wj.By("swing", camera))
    images = [Image(f"{8811 + i}", swing="right" if i % 2 else "left", columns=4000, rows=3000) for i in range(n)]
    world = World("local", (48.6, 7.7, 140.0))
    return _observed("every frame link", sensor, images, [0, 1, 2, 3, 3], [100.0, 2000, 1500, 2900, 7], world, 140.0)


def _wandering() -> list[wj.FrameErrors]:
    turn = np.radians((0.005, 0.0, 0.01)).tolist()
    return [wj.FrameErrors("wave", turn, (0.05, 0.05, 0.08), (60.0, 60.0, 120.0, 0.0, 0.0, 0.0), anew="strip")]


def _free() -> list[wj.FrameErrors]:
    """Nothing was recorded; by how much the start may be off."""
    start = wj.FrameErrors("body", np.radians((1.0, 1.0, 3.0)).tolist(), (50.0, 50.0, 80.0))
    return [start, wj.FrameErrors("body", (np.inf,) * 3, (np.inf,) * 3, anew="image")]


def _observed(name, sensor, images, image, line, world, height) -> wj.Flight:
    """Points below the sensor, seen exactly where they are."""
    n = len(image)
    zero = np.zeros(n)
    sample = np.linspace(120.0, 900.0, n)
    roles = ["control", "check", "tie", "control", "control"][:n]
    line_camera = "arm" in sensor.names
    flight = wj.Flight(
        name=name,
        sensor=sensor,
        images=images,
        points=Points([f"p{i}" for i in range(n)], np.zeros((n, 3)), np.full((n, 3), 0.02), roles),
        measurements=Measurements(np.array(image), np.arange(n), np.array(line), sample, zero + 0.5, zero + 0.25),
        unknowns=[
            wj.Unknown("turn", f"{'arm' if line_camera else 'mount'}.angles_rad[1]", 0.001, np.radians(0.3)),
            wj.Unknown("other", "camera.fore.focal_px" if line_camera else "body.shift_m[1,2]", scale=2.0),
        ],
        errors=[
            wj.FrameErrors("body" if line_camera else "mount", np.radians([0.03, 0.0, 0.0801]).tolist(), (0.1, 0.2, 0.0)),
            wj.FrameErrors("scan" if line_camera else "mount", shift_sigma_m=(0.0, 0.0, 0.3), correlation_s=np.inf, axes="level"),
            *(_wandering() if line_camera else _free()),
        ],
        world=world,
        epoch="2024-05-01T00:00:00Z",
        reference_point="antenna",
        notes='two lines,\nand "quotes"',
    )
    points = []
    for i in range(n):
        keys = {k: flight.key_index(images[image[i]], k) for k in ("swing", "view")}
        shot = flight.shot(np.array([image[i]]), np.array([line[i]]))
        shot = wj.Shot(time_s=None if shot.time_s is None else shot.time_s[0], image=image[i], **keys)
        look = wj.ray(sensor, shot, np.array([sample[i], 0.0 if flight.is_line else line[i]]))
        points.append(np.asarray(look.origin_m) + height * np.asarray(look.direction))
    known = Points(flight.points.names, np.array(points), flight.points.sigma_enu_m, flight.points.roles)
    return wj.Flight(**{**vars(flight), "points": known})


def ecef_of(lat_deg, lon_deg, height_m):
    """ECEF position of one geodetic position."""
    zero = np.zeros(1)
    return ecef_samples(np.radians([lat_deg]), np.radians([lon_deg]), np.array([height_m]), zero, zero, zero)[0][0]
