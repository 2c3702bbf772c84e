"""What the tests of this room compare with: the paper's chain and Kalman filters as plain loops over full matrices.

Numpy and PROJ only. The chain is written so that complex numbers pass, and derivatives are complex steps: exact to rounding.
"""

from typing import NamedTuple

import numpy as np

from tests import oracles

FOCAL_PX = 1e5
MOTIONS = 8  # turn and shift of the body's axes, turn of the roll gimbal about x, of the pitch gimbal about y
TABLE_1 = np.array([*np.radians([0.03, 0.03, 0.08]), 10.0, 10.0, 20.0, *np.radians([0.01, 0.01])])

EXACT = np.zeros(MOTIONS)


def differentiated(f, x):
    """Jacobian (outputs, inputs) by complex steps."""
    x = np.asarray(x, dtype=complex)
    return np.stack([np.imag(f(x + 1e-30j * e)) / 1e-30 for e in np.eye(len(x))], axis=-1)


def skew(v):
    x, y, z = v
    return np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])


def turned(v):
    """exp([v]x), by its series."""
    if not np.any(v):
        return np.eye(3)
    term, total = np.eye(3), np.eye(3)
    for n in range(1, 9):
        term = term @ skew(v) / n
        total = total + term
    return total


def about(axis, angle):
    """Active rotation, of a complex angle too."""
    s, c = np.sin(angle), np.cos(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == "x" else [[c, 0, s], [0, 1, 0], [-s, 0, c]])


class Chain:
    """pixel = f (u_x / u_z, u_y / u_z), u = Ry(alpha) Rx(beta) Rx(roll) Ry(pitch) Rz(yaw) C_ne (x - platform), turning frames.

    `recorded` has arrays (looks,). Small motions `w` (8,) and a bias (turn, shift) (6,) of the body may be added at each call:
    the bias stands behind the motions.
    """

    def __init__(self, recorded, focal_px=FOCAL_PX):
        r = {name: np.asarray(value) for name, value in vars(recorded).items()}
        self.platform = oracles.ecef(r["lat_rad"], r["lon_rad"], r["height_m"])
        attitude = oracles.body_in_ned(r["roll_rad"], r["pitch_rad"], r["heading_rad"])
        self.ecef_from_body = (oracles.ecef_from_ned(r["lat_rad"], r["lon_rad"]) * attitude).as_matrix()
        self.beta, self.alpha, self.focal_px = r["gimbal_roll_rad"], r["gimbal_pitch_rad"], focal_px

    def image(self, k, point, w=(0,) * MOTIONS, bias=(0,) * 6):
        w, bias = np.asarray(w), np.asarray(bias)
        u = self.ecef_from_body[k].T @ (point - self.platform[k])
        u = u - skew(w[:3]) @ u - w[3:6]
        u = turned(bias[:3]).T @ (u - bias[3:])
        u = about("x", self.beta[k]).T @ u
        u = u - w[6] * np.array([0 * u[0], -u[2], u[1]])
        u = about("y", self.alpha[k]).T @ u
        u = u - w[7] * np.array([u[2], 0 * u[1], -u[0]])
        return self.focal_px * u[:2] / u[2]


class Filtered(NamedTuple):
    """After every look: state, covariance; before it: innovation, its covariance, and NIS."""

    state: np.ndarray
    covariance: np.ndarray
    innovation: np.ndarray
    innovation_covariance: np.ndarray
    nis: np.ndarray


def noise_of(h, k, x, sigma_px, sigma_w):
    """R: that of the pixel, and what the motions add."""
    g = differentiated(lambda w: h(k, x, w), np.zeros(MOTIONS))
    return np.diag(np.broadcast_to(sigma_px, 2) ** 2) + g @ np.diag(sigma_w**2) @ g.T


def kalman(h, z, x, p, *, sigma_px=2.0, sigma_w=EXACT, relinearised=0, estimated=None, moves=None, gate=np.inf):
    """The (iterated) extended filter, with full matrices.

    `h(k, x, w)` images the state; `estimated` is false for what is only considered; `moves(k)` gives transition and Q.
    """
    n = len(x)
    estimated = np.ones(n, dtype=bool) if estimated is None else np.asarray(estimated)
    kept = []
    for k in range(len(z)):
        if moves is not None:
            f, q = moves(k)
            x, p = f @ x, f @ p @ f.T + q
        if np.isnan(z[k]).any():
            kept.append((x, p, np.full(2, np.nan), np.full((2, 2), np.nan), np.nan))
            continue
        at, first = x, None
        for _ in range(relinearised + 1):
            jacobian = differentiated(lambda s, k=k: h(k, s, EXACT), at)
            r = noise_of(h, k, at, sigma_px, sigma_w)
            s = jacobian @ p @ jacobian.T + r
            gain = p @ jacobian.T @ np.linalg.inv(s) * estimated[:, None]
            innovation = z[k] - h(k, at, EXACT)
            first = first or (innovation, s, innovation @ np.linalg.solve(s, innovation))
            if first[2] > gate:
                gain = 0 * gain
            at = x + gain @ (innovation - jacobian @ (x - at))
        left = np.eye(n) - gain @ jacobian
        x, p = at, left @ p @ left.T + gain @ r @ gain.T
        kept.append((x, p, *first))
    return Filtered(*(np.array(part) for part in zip(*kept, strict=True)))


class Dense(NamedTuple):
    """A least-squares solution: state, covariance of what is estimated, and the looks linearised there."""

    state: np.ndarray
    formal: np.ndarray
    residual: np.ndarray
    rows: np.ndarray
    noise: np.ndarray
    cost: float


def least_squares(h, z, mean, prior, *, sigma_px=2.0, sigma_w=EXACT, estimated=None, steps=8):
    """Gauss-Newton with dense matrices, the looks weighted at the current state; what is considered keeps its mean."""
    n = len(mean)
    keep = np.ones(n, dtype=bool) if estimated is None else np.asarray(estimated)
    information = np.linalg.inv(prior)
    looks = [k for k in range(len(z)) if not np.isnan(z[k]).any()]
    x = np.array(mean, dtype=float)
    for step in range(steps + 1):
        rows = np.array([differentiated(lambda s, k=k: h(k, s, EXACT), x) for k in looks])
        residual = np.array([z[k] - h(k, x, EXACT) for k in looks])
        noise = np.array([noise_of(h, k, x, sigma_px, sigma_w) for k in looks])
        weight = np.linalg.inv(noise)
        normal = np.einsum("kan,kab,kbm->nm", rows, weight, rows) + information
        formal = np.zeros((n, n))
        formal[np.ix_(keep, keep)] = np.linalg.inv(normal[np.ix_(keep, keep)])
        if step < steps:
            x = x + formal @ (np.einsum("kan,kab,kb->n", rows, weight, residual) + information @ (mean - x))
    cost = np.einsum("ka,kab,kb->", residual, weight, residual) + (x - mean) @ information @ (x - mean)
    return Dense(x, formal, residual, rows, noise, cost)


def enu(point):
    """Columns east, north, up at a point of the ECEF world."""
    lat, lon, _ = oracles.geodetic(point)
    n, e, d = oracles.ecef_from_ned(lat, lon).as_matrix().T
    return np.stack([e, n, -d], axis=-1)


def assert_in_sigmas(got, expected, like, tolerance):
    """Covariances compared in units of the sigmas of one of them, so that no large entry hides a small one."""
    sigma = np.sqrt(np.diagonal(np.asarray(like), axis1=-2, axis2=-1))
    scale = sigma[..., :, None] * sigma[..., None, :]
    np.testing.assert_allclose(np.asarray(got) / scale, np.asarray(expected) / scale, rtol=0, atol=tolerance)
