"""gtsam (4.3, simplified BSD): marginal covariances of a bundle adjustment, run here.

Claim: `wj.adjust` has gtsam's minimum within 1e-9 of the cost, and the covariances of every camera's f, k1, k2 and of every point
and the sigmas of every pose within 1e-7 of themselves; the bundle is gtsam's example dubrovnik-3-7, with weights of this test.
"""

import functools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.peers.bundle import Bundle, in_sigmas, poses_of
from tests.peers.figures import Figure, assert_inside

gtsam = pytest.importorskip("gtsam")

PEER = "gtsam"
FLIP = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))  # gtsam's cameras look along +z, y down


def example() -> Bundle:
    """Its three cameras, seven points and 19 marks; marks of 0.7 px, points of 0.1, and little known of the lenses."""
    data = gtsam.SfmData.FromBalFile(gtsam.findExampleDataFile("dubrovnik-3-7-pre"))
    cameras = [data.camera(i) for i in range(data.numberCameras())]
    world_from_camera = Rotation.from_matrix([c.pose().rotation().matrix() for c in cameras]) * FLIP
    tracks = [data.track(j) for j in range(data.numberTracks())]
    seen = [(*track.measurement(k), j) for j, track in enumerate(tracks) for k in range(track.numberMeasurements())]
    camera, pixel, point = zip(*seen, strict=True)
    return Bundle(
        turn=world_from_camera.inv(),
        shift_m=-world_from_camera.inv().apply([c.pose().translation() for c in cameras]),
        interior=np.array([(c.calibration().fx(), c.calibration().k1(), c.calibration().k2()) for c in cameras]),
        camera=np.array(camera),
        point=np.array(point),
        marks_px=np.array(pixel) * [1, -1],
        points_m=np.array([track.point3() for track in tracks]),
        sigma_interior=(30.0, 0.1, 0.1),
        sigma_points_m=0.1,
        sigma_mark_px=0.7,
    )


def solved_by_gtsam(bundle: Bundle):
    """Sum of squares, and the marginal covariances of interiors (cameras, 3, 3), points, and poses (turn, shift)."""
    poses, lenses, points = (lambda k, c=c: gtsam.symbol(c, int(k)) for c in "xkl")
    of_marks, of_points = (gtsam.noiseModel.Isotropic.Sigma(*s) for s in ((2, bundle.sigma_mark_px), (3, bundle.sigma_points_m)))
    of_lenses = gtsam.noiseModel.Diagonal.Sigmas(np.array(bundle.sigma_interior))
    graph, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, j, pixel in zip(bundle.camera, bundle.point, bundle.pixel_px, strict=True):
        graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(pixel, of_marks, poses(i), points(j), lenses(i)))
    for j, point in enumerate(bundle.points_m):
        graph.add(gtsam.PriorFactorPoint3(points(j), point, of_points))
        start.insert(points(j), point)
    turns = (bundle.turn.inv() * FLIP).as_matrix()
    for i, (turn, centre, interior) in enumerate(zip(turns, bundle.centre_m, bundle.interior, strict=True)):
        lens = gtsam.Cal3Bundler(*interior, 0.0, 0.0)
        graph.add(gtsam.PriorFactorCal3Bundler(lenses(i), lens, of_lenses))
        start.insert(lenses(i), lens)
        start.insert(poses(i), gtsam.Pose3(gtsam.Rot3(turn), centre))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(1e-15)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start, settings).optimize()
    marginals = gtsam.Marginals(graph, found)
    covariances = [
        np.array([marginals.marginalCovariance(key(k)) for k in range(n)])
        for key, n in ((lenses, len(turns)), (points, len(bundle.points_m)), (poses, len(turns)))
    ]
    return 2 * graph.error(found), covariances


@functools.cache
def both():
    """Ours, started again from its own poses, so that their motions are zero and small as gtsam's; and gtsam's."""
    bundle = example()
    ours = bundle.adjust(*poses_of(bundle.adjust()))
    return ours, solved_by_gtsam(bundle)


def figures() -> list[Figure]:
    """What is claimed."""
    ours, (cost, (lenses, points, poses)) = both()
    of_lenses = np.array([ours.trust.covariance[i : i + 3, i : i + 3] for i in (0, 3, 6)])
    sigma_poses = np.sqrt(np.diagonal(poses, axis1=1, axis2=2))
    rounding = "both invert one normal matrix"
    return [
        Figure("sum of squares at the optimum", abs(ours.cost - cost), "", 1e-9, "its last step"),
        Figure("covariances of f, k1, k2", in_sigmas(of_lenses, lenses), "sigma^2", 1e-7, rounding),
        Figure("covariances of the points", in_sigmas(ours.covariance_m2, points), "sigma^2", 1e-7, rounding),
        Figure("sigmas of the poses, turns and shifts", np.abs(ours.trust.stations / sigma_poses - 1).max(), "1", 1e-7, rounding),
    ]


def test_figures():
    assert_inside(figures())


def test_the_bundle_is_no_play_of_priors():
    """The data take half of the variance and more off f and k1 of two lenses, and tell something of every point."""
    ours, (_, (lenses, points, _)) = both()
    told = np.sqrt(np.diagonal(lenses, axis1=1, axis2=2)) / [30.0, 0.1, 0.1]
    assert (told[:2, :2] ** 2 < 0.5).all() and (np.diagonal(points, axis1=1, axis2=2) < 0.9 * 0.1**2).any(axis=1).all()
    assert ours.freedom == 2 * 19 + 3 * 3 + 3 * 7 - 3 * 3 - 6 * 3 - 3 * 7
