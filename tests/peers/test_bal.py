"""BAL dubrovnik-3-7 (gtsam 4.3.0's copy, simplified BSD; Agarwal et al. 2010): optimum by gtsam, parameters and sigmas by scipy.

Claim: `wj.adjust` with f, k1, k2 of every camera, free poses and points of 5 cm ends at the sum of squares 45.846326761643 within
1e-9, at the same parameters and points within 1e-6 of their sigmas, with the same sigmas within 1e-6.
"""

import functools
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.peers.bundle import Bundle
from tests.peers.figures import Figure, assert_inside
from tests.peers.source import json_of
from tests.real.sets import Rows

PEER = "BAL, gtsam"


@functools.cache
def both(folder: Path):
    """Our adjustment, the published optimum, and the sum of squares at the start."""
    given = json_of(folder, "bal_dubrovnik.json")
    cameras, points, marks = (Rows(folder / f"bal_dubrovnik_{name}.csv") for name in ("cameras", "points", "marks"))
    sigma = given["problem"]
    bundle = Bundle(
        turn=Rotation.from_rotvec(cameras.numbers("rotvec_x", "rotvec_y", "rotvec_z")),
        shift_m=cameras.numbers("t_x", "t_y", "t_z"),
        interior=cameras.numbers("f_px", "k1", "k2"),
        camera=marks.numbers("camera").astype(int),
        point=marks.numbers("point").astype(int),
        marks_px=marks.numbers("x_px_right", "y_px_up"),
        points_m=points.numbers("x", "y", "z"),
        sigma_interior=(sigma["f_prior_sigma_px"], sigma["k1_prior_sigma"], sigma["k2_prior_sigma"]),
        sigma_points_m=sigma["point_prior_sigma"],
        sigma_mark_px=sigma["sigma_mark_px"],
    )
    return bundle.adjust(), given["optimum"]


def figures(folder: Path) -> list[Figure]:
    """What is claimed."""
    ours, known = both(folder)
    value, sigma = (np.array([known[f"{s}{name}"] for name in ("f_px", "k1", "k2")]).T.ravel() for s in ("", "sigma_"))
    points, sigma_points = np.array(known["points"]), np.array(known["sigma_points"])
    formal = np.sqrt(np.diagonal(ours.covariance_m2, axis1=1, axis2=2))
    scipy = "where scipy stops (gtsam: 1e-9)"
    return [
        Figure(
            "sum of squares at the optimum", abs(ours.cost - 45.846326761643), "", 1e-9, "set before; two peers agree on 1e-12"
        ),
        Figure("f, k1, k2 of the cameras", np.abs((ours.value - value) / sigma).max(), "sigma", 1e-6, scipy),
        Figure("points", np.abs((ours.point_m - points) / sigma_points).max(), "sigma", 1e-6, scipy),
        Figure("sigmas of f, k1, k2", np.abs(ours.trust.sigma / sigma - 1).max(), "1", 1e-6, scipy),
        Figure("sigmas of the points", np.abs(formal / sigma_points - 1).max(), "1", 1e-6, scipy),
    ]


def test_figures(peer_values):
    assert_inside(figures(peer_values))
