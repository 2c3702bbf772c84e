"""The block adjustment of the three-line camera as one dense least-squares problem: every unknown and every point in one vector.

Collinearity of Wang et al. (2018) with scipy's interpolation and rotations; nothing is eliminated, nothing is cut into tiles.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BarycentricInterpolator, BSpline
from scipy.spatial.transform import Rotation, Slerp

from whiskjax.flights import songshan

STRIP_S, PERIOD_S = 190.0, 490.0  # a strip of 11.4 km at 60 m/s, and the 300 s of the turn to the next
FOCAL_PX, CENTRE_PX = 26_000.0, 16_377.5
VIEW_DEG = (27.0, 0.0, -14.0)
SIGMA = np.array([*np.radians([0.005, 0.005, 0.010]), 0.05, 0.05, 0.08])  # roll, pitch, yaw; x, y, z
CORRELATION_S = (60.0, 60.0, 120.0, 300.0, 300.0, 300.0)
PRIOR = np.array([1.0] * 3 + [math.radians(1.0)] * 3 + [100.0] * 21)
# Coefficients that are estimated, of (view, along = 0 or across = 1, power), across first: all but the nadir line's a0, a1, b0.
_ALL = [(view, row, power) for view in range(3) for row in (1, 0) for power in range(4)]
COEFFICIENTS = [c for c in _ALL if c not in ((1, 1, 0), (1, 1, 1), (1, 0, 0))]


def basis_rows(kind, start_s, spacing_s, nodes, t):
    """Weights of one strip's coefficients at times, (times, nodes): scipy's B-spline, or the cubic through the four nearest."""
    at = start_s + spacing_s * np.arange(nodes)
    if kind == "spline":
        rows = [BSpline.basis_element(at[k] + spacing_s * np.arange(-2, 3), False)(t) for k in range(nodes)]
        return np.nan_to_num(np.stack(rows, -1))  # NaN beyond four intervals
    rows = np.zeros((len(t), nodes))
    for i, time in enumerate(t):
        first = int(np.clip(np.floor((time - start_s) / spacing_s) - 1, 0, nodes - 4))
        rows[i, first : first + 4] = BarycentricInterpolator(at[first : first + 4], np.eye(4))(time)
    return rows


def segments(scene):
    """(start, number of nodes) of each strip."""
    intervals = math.ceil(STRIP_S / scene.spacing_s)
    early, more = (scene.spacing_s, 3) if scene.basis == "spline" else (0.0, 1)
    return [(PERIOD_S * i - early, intervals + more) for i in range(len(scene.data.strips))]


class Textbook:
    """Whitened residuals of one draw as a function of (6 x stations, 27 unknowns, 3 x points); points are in metres."""

    def __init__(self, scene, block, body, epochs):
        """**Arguments:** `epochs`: when POS observes each strip's coefficients, one array a strip."""
        rays, strip, time = len(block), np.asarray(block.key("strip")), np.asarray(block.key("time_s"))
        knots = np.asarray(body.knots.time_s)
        place = np.stack([np.asarray(c) for c in body.position_m], -1)
        attitude = Slerp(knots, Rotation.from_quat(np.stack([np.asarray(c) for c in body.quaternion], -1)))
        self.origin = np.stack([np.interp(time, knots, c) for c in place.T], -1)
        self.turned = attitude(time).as_matrix()
        self.stations = sum(n for _, n in segments(scene))
        self.weights, at_epochs, covariance, last = np.zeros((rays, self.stations)), [], [[] for _ in range(6)], 0
        for s, ((start, n), epoch) in enumerate(zip(segments(scene), epochs, strict=True)):
            here = np.flatnonzero(strip == s)
            self.weights[here, last : last + n] = basis_rows(scene.basis, start, scene.spacing_s, n, time[here])
            rows = np.zeros((n, self.stations))
            rows[:, last : last + n] = basis_rows(scene.basis, start, scene.spacing_s, n, epoch)
            at_epochs.append(rows)
            for axis, correlation in enumerate(CORRELATION_S):
                covariance[axis].append(np.exp(-np.abs(epoch[:, None] - epoch) / correlation))
            last += n
        self.pos = np.zeros((6, self.stations, self.stations))
        for axis in range(6):
            parts = [np.linalg.solve(np.linalg.cholesky(c), r) for c, r in zip(covariance[axis], at_epochs, strict=True)]
            self.pos[axis] = np.concatenate(parts)
        self.block, self.view = block, np.asarray(block.key("view"))
        self.control = np.flatnonzero(block.role == "control")
        self.shape = (6 * self.stations, len(PRIOR), 3 * len(block.role))

    def parts(self, z):
        """Motions (stations, 6), unknowns (27,) and points (points, 3)."""
        a, b, _ = self.shape
        return z[:a].reshape(6, -1).T * SIGMA[None], z[a : a + b] * PRIOR, z[a + b :].reshape(-1, 3)

    def residuals(self, z):
        """All of them: rays, POS, priors, control points."""
        motion, unknown, point = self.parts(z)
        x = (self.weights @ motion)[:, :, None]
        p = jnp.einsum("nji,nj->ni", self.turned, point[self.block.point] - self.origin) - x[:, 3:, 0]
        p = _turned_back(x[:, :3, 0], p) * jnp.array([[1.0, -1.0, -1.0]])  # forward, left, up
        p = p @ _matrix(unknown[3:6]) + unknown[None, :3]  # equation 9: the antenna at (u, v, w) from the projection centre
        image = -FOCAL_PX * p[:, :2] / p[:, 2:]
        cubic = jnp.zeros((3, 2, 4)).at[tuple(np.array(COEFFICIENTS).T)].set(unknown[6:])[self.view]

        def bent(s):
            powers = jnp.stack([(s / CENTRE_PX) ** k for k in range(4)], -1)
            return jnp.einsum("nak,nk->an", cubic, powers)

        s = image[:, 1]
        for _ in range(6):  # the sample whose place along the line is the image's
            s = image[:, 1] - bent(s)[0]
        offset = FOCAL_PX * jnp.tan(jnp.radians(jnp.array(VIEW_DEG)))[self.view]
        pixel = jnp.stack([CENTRE_PX + s, image[:, 0] - offset - bent(s)[1]], -1)
        rays = (self.block.pixel_px - pixel) / self.block.sigma_px
        pos = jnp.einsum("aek,ka->ae", self.pos, motion / SIGMA[None])
        sigma = jnp.sqrt(jnp.diagonal(jnp.asarray(self.block.covariance_m2[self.control]), axis1=1, axis2=2))
        known = (self.block.position_m[self.control] - point[self.control]) / sigma
        return jnp.concatenate([rays.ravel(), pos.ravel(), unknown / PRIOR, known.ravel()])

    def solve(self, point_m, steps=12):
        """Gauss-Newton on the dense system by numpy's lstsq: (z, cost, covariance of z)."""
        residuals, jacobian = jax.jit(self.residuals), jax.jit(jax.jacfwd(self.residuals))
        z = np.concatenate([np.zeros(self.shape[0] + self.shape[1]), point_m.ravel()])
        for _ in range(steps):
            step = np.linalg.lstsq(np.asarray(jacobian(z)), -np.asarray(residuals(z)), rcond=None)[0]
            z = z + step
            if np.abs(step).max() < 1e-9:
                break
        rows = np.asarray(jacobian(z))
        return z, float((np.asarray(residuals(z)) ** 2).sum()), np.linalg.inv(rows.T @ rows)


def _matrix(angles):
    """Rx Ry Rz."""
    (cx, cy, cz), (sx, sy, sz) = jnp.cos(angles), jnp.sin(angles)
    x = jnp.array([[1.0, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = jnp.array([[cy, 0, sy], [0, 1.0, 0], [-sy, 0, cy]])
    z = jnp.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1.0]])
    return x @ y @ z


def _turned_back(v, p):
    """exp(-[v]x) p, (n, 3) each, by the exponential series: v is small."""
    out = term = p
    for k in range(1, 9):
        term = jnp.cross(-v, term) / k
        out = out + term
    return out


def epochs_of(scene):
    """When POS observes: at the orientation images; for splines at the inner nodes and half way in the outer intervals."""
    found = []
    for start, n in segments(scene):
        t = start + scene.spacing_s * np.arange(n)
        if scene.basis == "spline":
            t = np.sort(np.append(t[1:-1], ((t[1] + t[2]) / 2, (t[-3] + t[-2]) / 2)))
        found.append(t)
    return found


SCENES = {
    "orientation images": songshan.Scene("B", ties=40, pos_hz=20.0, spacing_s=24.0),
    "spline": songshan.Scene("B", ties=40, pos_hz=20.0, spacing_s=24.0, basis="spline"),
}
