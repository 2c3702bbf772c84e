"""What whiskjax reaches on blocks: ign_frame adjusted from perturbed poses, sxb_frame from its coarse starts."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj

from . import convert_ign_frame as ign
from . import convert_sxb_frame as sxb
from .figures import Figure, Reached
from .reach_ign_frame import OFF_DEG, OFF_FOCAL_PX, OFF_PRINCIPAL_PX

SET = "blocks"
IGN, SXB = "ign_frame", "sxb_frame"
# Of every image on its own, about and along each axis of the camera; POS is told the same.
POSE_DEG, POSE_M, SEED = 0.005, 0.05, 1
# A block without control cannot tell its focal length from the heights of its points: the laboratory's, as good as it writes it.
LABORATORY_PX = 0.1
GCP_SIGMA_M = 0.03
# DBAT 0.9.1.2, data/script/sxb/result/report.txt: centre (m), omega, phi, kappa (deg) and their deviations, from 16 surveyed
# points, of which the set holds 11. https://github.com/niclasborlin/dbat, commit 0e33f62.
DBAT = np.array(
    [
        [999660.940086, 112368.368648, 1916.563176, 0.829772, -0.417236, -89.914549],
        [1000062.186284, 112625.534228, 1916.417372, -0.124396, 0.007180, 92.621856],
        [1000077.371177, 112417.544493, 1910.362078, -0.159645, 0.006196, 94.400652],
        [1000094.134327, 112202.936957, 1906.983111, -0.202540, 0.134993, 96.145997],
        [1000482.579395, 112370.473450, 1937.066185, 0.521419, -0.220515, -92.540800],
    ]
)
DBAT_SIGMA = np.array(
    [
        [0.465, 0.657, 0.097, 0.0209, 0.0146, 0.00234],
        [0.397, 0.743, 0.0935, 0.0238, 0.0124, 0.00215],
        [0.343, 0.565, 0.0567, 0.0181, 0.0108, 0.00166],
        [0.376, 0.869, 0.103, 0.0280, 0.0118, 0.00214],
        [0.797, 0.655, 0.161, 0.0206, 0.0252, 0.00267],
    ]
)


def adjust_sxb(source: Path, out: Path) -> wj.Adjustment:
    """Poses known to 100 m and a few degrees, nothing recorded: control points alone hold the block."""
    flight = wj.read_flight(sxb.convert(source, out).folder)
    coarse = wj.FrameErrors("photo", turn_sigma_rad=(0.1,) * 3, shift_sigma_m=(100.0,) * 3)
    free = wj.FrameErrors("photo", turn_sigma_rad=(np.inf,) * 3, shift_sigma_m=(np.inf,) * 3)
    return wj.adjust(flight.sensor, flight.block(), errors=[coarse, free])


def perturbed(flight: wj.Flight) -> wj.Sensor:
    """Every image turned by 0.005 deg and shifted by 0.05 m about and along each axis, at random."""
    photo = flight.sensor["photo"]
    assert isinstance(photo, wj.PosePerImage)
    rng = np.random.default_rng(SEED)
    n = photo.stations
    turn, shift = rng.normal(0, np.radians(POSE_DEG), (n, 3)), rng.normal(0, POSE_M, (n, 3))
    place, quaternion = (np.stack([np.asarray(c) for c in cs], axis=-1) for cs in (photo.position_m, photo.quaternion))
    moved = wj.PosePerImage(place, quaternion, turn, shift).pose(wj.Shot(image=np.arange(n)))
    start = wj.PosePerImage(np.asarray(moved.origin_m), quaternions(np.asarray(moved.matrix)))
    links = dict(zip(flight.sensor.names, flight.sensor.links, strict=True)) | {"photo": start}
    return wj.Sensor(links, flight.sensor.camera)


def quaternions(matrix: np.ndarray) -> np.ndarray:
    """Of rotation matrices, (n, 4), x y z w."""
    return Rotation.from_matrix(matrix).as_quat()


def adjust_ign(source: Path, out: Path, known: str) -> wj.Adjustment:
    """Boresight, focal length and principal point with the poses, all started off, from the producer's tie points.

    **Arguments:** `known`: what tells focal length and height apart: "laboratory" (the focal length; GCP 1003 is a check point)
    or "control" (GCP 1003).
    """
    principal = tuple(c + off for c, off in zip(ign.PRINCIPAL_POINT_PX, OFF_PRINCIPAL_PX, strict=True))
    focal = ign.FOCAL_PX + OFF_FOCAL_PX
    ign.convert(source, out, boresight_deg=OFF_DEG, focal_px=focal, principal_point_px=principal, tie_role="tie")
    flight = wj.read_flight(out)
    block, unknowns = flight.block(), list(flight.unknowns)
    if known == "control":
        surveyed = block.role == "check"
        covariance = np.where(surveyed[:, None, None], np.eye(3) * GCP_SIGMA_M**2, block.covariance_m2)
        block = dataclasses.replace(block, role=np.where(surveyed, "control", block.role), covariance_m2=covariance)
    else:
        unknowns[3] = dataclasses.replace(unknowns[3], mean=ign.FOCAL_PX, sigma=LABORATORY_PX, scale=None)
    errors = [wj.FrameErrors("photo", turn_sigma_rad=(np.radians(POSE_DEG),) * 3, shift_sigma_m=(POSE_M,) * 3)]
    return wj.adjust(perturbed(flight), block, unknowns, errors=errors)


def largest_sigma(found: wj.Adjustment, truth: Sequence[float]) -> float:
    """The largest error of boresight and focal length in units of its own sigma.

    Not of the principal point: whether the source counts pixels from centres or corners, its data do not resolve.
    """
    return float(np.abs((found.value - np.array(truth)) / found.trust.sigma)[:4].max())


def reach_ign(source: Path, out: Path) -> list[Figure]:
    """The figures of ign_frame."""
    truth = (0.0, 0.0, 0.0, ign.FOCAL_PX, *ign.PRINCIPAL_POINT_PX)
    figures: list[Figure] = []
    for known, text in (
        ("laboratory", "1003 as check point, focal length known to 0.1 px"),
        ("control", "1003 as control point"),
    ):
        found = adjust_ign(source, out / f"{IGN}_block_{known}", known)
        ties = found.block.role[found.block.point] == "tie"
        column, row = np.sqrt((found.residual_px[ties] ** 2).mean(axis=0))
        (error,) = np.linalg.norm(found.errors_m("check" if known == "laboratory" else "control"), axis=1)
        figures += [
            # What the ties have with the producer's own poses: free poses leave no more.
            Figure(IGN, f"block, {text}: tie points, column RMS", float(column), "px", 0.147),
            Figure(IGN, f"block, {text}: tie points, row RMS", float(row), "px", 0.174),
            Figure(IGN, f"block, {text}: its 3-D error", float(error), "m"),
            Figure(IGN, f"block, {text}: boresight error", float(np.degrees(np.linalg.norm(found.value[:3]))), "deg"),
            Figure(IGN, f"block, {text}: focal length error", abs(float(found.value[3]) - ign.FOCAL_PX), "px"),
            Figure(IGN, f"block, {text}: largest of these two over its sigma", largest_sigma(found, truth), "1", 3.5),
        ]
    return figures


def reach_sxb(source: Path, out: Path) -> list[Figure]:
    """The figures of sxb_frame."""
    found = adjust_sxb(source, out / f"{SXB}_block")
    control = found.errors_m("control")
    return [
        Figure(SXB, "block: sigma0", float(np.sqrt(found.variance_factor)), "1", 1.2),
        Figure(SXB, "block: control points, RMS of x, y and z", float(np.sqrt((control**2).mean())), "m", 0.05),
        Figure(SXB, "block: largest difference from DBAT over DBAT's sigma", float(np.abs(from_dbat(found)).max()), "1", 3.0),
    ]


def from_dbat(found: wj.Adjustment) -> np.ndarray:
    """Poses less those that DBAT prints, in its sigmas, (5, 6)."""
    pose = found.sensor["photo"].pose(wj.Shot(image=np.arange(len(DBAT))))
    angles = Rotation.from_matrix(np.asarray(pose.matrix)).as_euler("XYZ", degrees=True)
    return (np.concatenate([np.asarray(pose.origin_m), angles], axis=1) - DBAT) / DBAT_SIGMA


def reach(source: Path, out: Path) -> Reached:
    """The figures of both blocks. `source`: the folder of all sets."""
    figures = [*reach_ign(source / IGN, out), *reach_sxb(source / SXB, out)]
    notes = [
        f"{IGN}: every pose of the block turned by {POSE_DEG} deg and shifted by {POSE_M} m (1-sigma) about and along each axis; "
        "without control or a known focal length, focal length and heights cannot be told apart",
        f"{SXB}: of DBAT's 16 surveyed points the set holds 11",
    ]
    return Reached(figures, [], notes)
