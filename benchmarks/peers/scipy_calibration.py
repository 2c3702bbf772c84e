"""The calibration of gauss_newton.cpp by scipy: vectorised residuals and their analytic derivatives.

Jin et al. (2024), equation 9: q = R_sen^T (S^T R_pos^T (M^T (P - X_gps) - u_gps) - u_sen), x = -f q1 / q3, y = -s f q2 / q3.
"""

from math import cos, sin

import numpy as np

from . import Baked, MissingPeer

try:
    from scipy.optimize import least_squares
except ImportError as error:
    raise MissingPeer("scipy is not installed: pip install 'whiskjax[bench]'") from error


def _rotation(angles_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rx(omega) Ry(phi) Rz(kappa), and as columns the axes about which each angle turns it (in the outer frame)."""
    (so, sp, sk), (co, cp, ck) = ([f(a) for a in angles_rad] for f in (sin, cos))
    x = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    xy = x @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    return xy @ np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]]), np.stack([np.eye(3)[0], x[:, 1], xy[:, 2]], -1)


class ScipyCalibration:
    """One calibration of 15 unknowns u = (value - prior mean) / prior sigma, in the order of gauss_newton.cpp.

    **Arguments**: observed: of one lane; prior_mean, prior_sigma (15,).
    """

    def __init__(self, observed: Baked, prior_mean: np.ndarray, prior_sigma: np.ndarray):
        self.mean, self.sigma, self.focal_px = prior_mean, prior_sigma, observed.focal_px
        self.point = np.einsum("nji,nj->ni", observed.ecef_from_platform, observed.point_m - observed.antenna_m)
        (ss, cs), (sp, cp) = observed.scan_sin_cos.T, observed.pitch_sin_cos.T
        rows = [[cp, 0 * cp, sp], [ss * sp, cs, -ss * cp], [-cs * sp, ss, cs * cp]]  # Rx(scan) Ry(pitch)
        self.turn = np.moveaxis(np.array(rows), -1, 0).copy()
        self.right = observed.right
        self.sign = np.stack([np.ones(len(self.right)), np.where(self.right, -1.0, 1.0)], -1)
        self.pixel, self.weight = observed.pixel_px, 1 / observed.sigma_px

    def _camera(self, u: np.ndarray):
        """Rotations, points in front of each of them, and pixels (n, 2)."""
        u_gps, left, right, u_sen, sen = (self.mean + self.sigma * u).reshape(5, 3)
        (left, left_axes), (right, right_axes), (sen, sen_axes) = map(_rotation, (left, right, sen))
        outer = np.stack([left, right])[self.right] @ self.turn
        pos_axes = np.stack([left_axes, right_axes])[self.right]
        from_gps = self.point - u_gps
        from_sen = (from_gps[:, None, :] @ outer)[:, 0] - u_sen
        q = from_sen @ sen
        image = -self.focal_px * self.sign * q[:, :2] / q[:, 2:]
        return outer, pos_axes, from_gps, sen, sen_axes, from_sen, q, image

    def residual(self, u: np.ndarray) -> np.ndarray:
        """Whitened residuals measured - projected, and priors, (2 n + 15,)."""
        *_, image = self._camera(u)
        return np.concatenate([(self.weight * (self.pixel - image)).ravel(), u])

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Their derivatives by u, (2 n + 15, 15)."""
        outer, pos_axes, from_gps, sen, sen_axes, from_sen, q, image = self._camera(u)
        n = len(q)
        by_q = np.zeros((n, 2, 3))
        by_q[:, [0, 1], [0, 1]] = -self.focal_px * self.sign / q[:, 2:]
        by_q[:, :, 2] = -image / q[:, 2:]
        # What a shift of the point in a frame does to the whitened pixel; a turn by d about axis w shifts it by p x w d.
        at_sen = (self.weight[:, :, None] * by_q) @ sen.T
        at_gps = at_sen @ outer.transpose(0, 2, 1)
        turned = -np.cross(at_gps, from_gps[:, None, :]) @ pos_axes
        rows = np.zeros((n, 2, 15))
        rows[:, :, 0:3] = at_gps
        left = self.right == 0
        rows[left, :, 3:6], rows[~left, :, 6:9] = turned[left], turned[~left]
        rows[:, :, 9:12] = at_sen
        rows[:, :, 12:15] = -np.cross(at_sen, from_sen[:, None, :]) @ sen_axes
        return np.concatenate([rows.reshape(2 * n, 15) * self.sigma, np.eye(15)])

    def solve(self) -> np.ndarray:
        """The minimum u from the prior mean, by scipy's own method and tolerances (its "lm" takes 1.4 times as long)."""
        return least_squares(self.residual, np.zeros(15), jac=self.jacobian).x
