"""The filter of location.cpp by numpy: all runs at once, one look after the other.

Vectors and matrices are tuples of components, each an array over the runs: with numpy's products of arrays of small matrices the
same filter takes five times as long. The formulas of the chain are for anything that can be added and multiplied, and the other
peers in Python share them.
"""

from collections.abc import Callable

import numpy as np

from .location import FOCAL_PX, Located, Recorded, Sigmas, Start

A_M = 6378137.0
E2 = (2 - 1 / 298.257223563) / 298.257223563


def dot(v, w):
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


def _turn_y(angle, v):
    sin, cos = angle
    return cos * v[0] + sin * v[2], v[1], cos * v[2] - sin * v[0]


def _turn_z(angle, v):
    sin, cos = angle
    return cos * v[0] - sin * v[1], sin * v[0] + cos * v[1], v[2]


def _square(variance, v):
    """A variance along a vector of two components, as (mm, mn, nn)."""
    m, n = v
    scaled_m = variance * m
    return scaled_m * m, scaled_m * n, variance * n * n


def noise(sigmas: Sigmas, alpha, beta, a, b, per_m):
    """Covariance (mm, mn, nn) of a pixel at (a, b) focal lengths, from registration and all recorded errors."""
    (sa, ca), (sb, cb) = alpha, beta
    # The body's axes in the camera's frame; x is the gimbal's roll axis as well.
    x, y, z = (ca, 0.0, sa), (sb * sa, cb, -sb * ca), (-cb * sa, sb, cb * ca)
    aa, ab, bb = 1 + a * a, a * b, 1 + b * b

    def turn(w):
        return aa * w[1] - ab * w[0] - b * w[2], ab * w[1] - bb * w[0] + a * w[2]

    def shift(w):
        return w[0] - a * w[2], w[1] - b * w[2]

    position, attitude, gimbal = ([s * s for s in of] for of in (sigmas.position_m, sigmas.attitude_rad, sigmas.gimbal_rad))
    # The three axes are orthonormal: equal sigmas along all of them give (1 + a a, a b, 1 + b b), the rest is added.
    shifts = [[position[0] * aa, position[0] * ab, position[0] * bb]]
    shifts += [_square(position[k] - position[0], shift(w)) for k, w in ((1, y), (2, z)) if position[k] != position[0]]
    turns = [_square(attitude[0] + gimbal[0], turn(x)), _square(attitude[1], turn(y)), _square(attitude[2], turn(z))]
    turns += [_square(gimbal[1], (aa, ab))]
    registration = sigmas.pixel_px**2
    scale = per_m * per_m
    mm, mn, nn = (scale * sum(s[i] for s in shifts) + FOCAL_PX**2 * sum(t[i] for t in turns) for i in range(3))
    return mm + registration, mn, nn + registration


def platform(lat, lon, height_m):
    """ECEF position; lat and lon as (sine, cosine)."""
    (slat, clat), (slon, clon) = lat, lon
    normal = A_M / (1 - E2 * slat * slat) ** 0.5
    out = (normal + height_m) * clat
    return out * clon, out * slon, ((1 - E2) * normal + height_m) * slat


def camera_from_ecef(lat, lon, pitch, heading, alpha, roll):
    """Its rows; every angle as (sine, cosine), roll that of the platform and the gimbal together: they have one axis."""
    (slat, clat), (sa, ca), (sr, cr) = lat, alpha, roll
    axes = (ca, sr * sa, -cr * sa), (0.0, cr, sr), (sa, -sr * ca, cr * ca)  # the camera's in the body's
    ned = (_turn_z(heading, _turn_y(pitch, axis)) for axis in axes)
    return [_turn_z(lon, (-slat * n - clat * d, e, clat * n - slat * d)) for n, e, d in ned]


def look_at(rows, offset):
    """Pixel at (a, b) focal lengths, pixels per metre at the target's depth, and the pixel's derivatives by the target."""
    u = [dot(row, offset) for row in rows]
    inverse_depth = 1 / u[2]
    a, b, per_m = u[0] * inverse_depth, u[1] * inverse_depth, FOCAL_PX * inverse_depth
    hm = [per_m * (rows[0][i] - a * rows[2][i]) for i in range(3)]
    hn = [per_m * (rows[1][i] - b * rows[2][i]) for i in range(3)]
    return a, b, per_m, hm, hn


def angles(numbers) -> list:
    """Latitude, longitude, pitch, heading, alpha, roll of platform and gimbal together, beta: the arguments of the chain."""
    lat, lon, _, roll, pitch, heading, beta, alpha, *_ = numbers
    return [lat, lon, pitch, heading, alpha, roll + beta, beta]


def prepared(recorded: Recorded, start: Start, sigmas: Sigmas, full: bool) -> Callable[[], Located]:
    """The filter as a call."""
    numbers = np.ascontiguousarray(np.swapaxes(recorded.numbers(), 1, 2))
    return lambda: _filter(numbers, start, sigmas, full)


def _filter(numbers: np.ndarray, start: Start, sigmas: Sigmas, full: bool) -> Located:
    """numbers: (10, looks, runs)."""
    height, (pixel_m, pixel_n) = numbers[2], numbers[8:]
    trigonometry = [(np.sin(angle), np.cos(angle)) for angle in angles(numbers)[: None if full else -1]]
    runs = numbers.shape[-1]
    x = [np.zeros(runs) for _ in range(3)]
    pxx, pxy, pxz, _, pyy, pyz, _, _, pzz = (np.full(runs, c) for c in start.covariance_m2.ravel())
    guess = start.guess_ecef_m
    mm = nn = sigmas.pixel_px**2
    mn = 0.0
    for k in range(len(height)):
        lat, lon, pitch, heading, alpha, roll, *beta = ((s[k], c[k]) for s, c in trigonometry)
        position = platform(lat, lon, height[k])
        offset = [x[i] - (position[i] - guess[i]) for i in range(3)]
        a, b, per_m, hm, hn = look_at(camera_from_ecef(lat, lon, pitch, heading, alpha, roll), offset)
        if full:
            mm, mn, nn = noise(sigmas, alpha, beta[0], a, b, per_m)

        P = (pxx, pxy, pxz), (pxy, pyy, pyz), (pxz, pyz, pzz)
        pm, pn = [dot(row, hm) for row in P], [dot(row, hn) for row in P]
        smm, smn, snn = dot(hm, pm) + mm, dot(hm, pn) + mn, dot(hn, pn) + nn
        inverse = 1 / (smm * snn - smn * smn)
        imm, imn, inn = inverse * snn, -inverse * smn, inverse * smm
        km = [imm * pm[i] + imn * pn[i] for i in range(3)]
        kn = [imn * pm[i] + inn * pn[i] for i in range(3)]
        innovation_m, innovation_n = pixel_m[k] - FOCAL_PX * a, pixel_n[k] - FOCAL_PX * b
        x = [x[i] + innovation_m * km[i] + innovation_n * kn[i] for i in range(3)]

        # Joseph's form (I - K H) P (I - K H)^T + K R K^T, as M - (M H^T - K R) K^T with M = P - K (H P).
        M = [[P[i][j] - km[i] * pm[j] - kn[i] * pn[j] for j in range(3)] for i in range(3)]
        left_m = [dot(M[i], hm) - mm * km[i] for i in range(3)]
        left_n = [dot(M[i], hn) - nn * kn[i] for i in range(3)]
        if full:
            left_m = [left_m[i] - mn * kn[i] for i in range(3)]
            left_n = [left_n[i] - mn * km[i] for i in range(3)]
        upper = (0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)
        pxx, pxy, pxz, pyy, pyz, pzz = (M[i][j] - left_m[i] * km[j] - left_n[i] * kn[j] for i, j in upper)
    covariance = np.stack([pxx, pxy, pxz, pxy, pyy, pyz, pxz, pyz, pzz], -1).reshape(runs, 3, 3)
    return np.stack(x, -1), covariance
