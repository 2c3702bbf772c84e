"""What errors of recorded poses that are new at every look do to a pixel: white noise of frames, carried into the image."""

from ..algebra.vectors import Component, Mat3, Vec2, Vec3, add, mul
from ..chain.joints import JointDerivatives
from ..estimate.errors import FrameErrors, unit_motion
from ..estimate.memory import WHITE


def variance_px2(errors: tuple[FrameErrors, ...], turned: tuple[Mat3 | None, ...], swept: JointDerivatives) -> Vec3:
    """What the white errors add to the covariance (r00, r01, r11) of a pixel: the sum of sigma^2 g g^T over the small motions.

    One variance for each recorded quantity at its own joint; gathering them into one 6x6 would cost twice as much.

    **Arguments:** `turned`: of statements in level axes the rotation into the frame's axes.
    """
    total: Vec3 = (0, 0, 0)
    for one, into in zip(errors, turned, strict=True):
        for k in one.acting:
            if one.memory[k] == WHITE:
                moved = swept.follows(one.frame, unit_motion(k, into))
                total = tuple(add(t, o) for t, o in zip(total, _outer(one.sigma[k], moved), strict=True))
    return total


def _outer(sigma: Component, moved: Vec2) -> Vec3:
    x, y = (mul(sigma, c) for c in moved)
    return mul(x, x), mul(x, y), mul(y, y)
