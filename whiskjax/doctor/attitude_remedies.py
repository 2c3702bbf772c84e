"""Attitudes that were written or read by another convention: signs, orders, transposes, a heading that counts from elsewhere."""

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..chain.trajectory import PosePerImage
from ..flights.flight import Flight
from .poses import (
    SWAP,
    about,
    is_recorded,
    lifted,
    omega_phi_kappa,
    roll_pitch_heading,
    tables,
    turned,
    world_turned,
)
from .remedy import Amount, Remedy, constant, degrees

ATTITUDE = "attitude"
Angles = tuple[np.ndarray, np.ndarray, np.ndarray]


def attitude_remedies(flight: Flight) -> Iterator[Remedy]:
    """All that is tried of the recorded attitudes."""
    if not is_recorded(flight):
        return
    file = tables(flight)
    yield from _signs(file)
    yield _of_angles(
        "roll and pitch exchanged",
        "Roll stands in the column of pitch, and pitch in that of roll.",
        f"{file}: exchange the columns roll_deg and pitch_deg",
        lambda r, p, h: (p, r, h),
    )
    # The same rotation has other angles, with a pitch beyond a right angle, as of a body whose z points up.
    yield _of_angles(
        "roll and pitch exchanged beyond 90 deg",
        "Roll stands in the column of pitch, and pitch, which is beyond 90 deg, in that of roll.",
        f"{file}: exchange the columns roll_deg and pitch_deg",
        lambda r, p, h: (np.pi - p, r + np.pi, h + np.pi),
        oddity=2,
    )
    yield _of_angles(
        "heading from east",
        "The heading counts anticlockwise from east, as mathematicians count, and not clockwise from north.",
        f"{file}: heading_deg = 90 - heading_deg",
        lambda r, p, h: (r, p, np.pi / 2 - h),
    )
    yield _of_rotation(
        "order of roll, pitch, heading",
        "The rotation is Rx(roll) Ry(pitch) Rz(heading) where Rz(heading) Ry(pitch) Rx(roll) is read.",
        f"{file}: convert the angles to ned_from_body = Rz(heading) Ry(pitch) Rx(roll), or write quaternions",
        lambda r: _product("xyz", *roll_pitch_heading(r)),
    )
    yield _of_rotation(
        "transposed rotations",
        "The attitude was written as body_from_ned where ned_from_body is read.",
        f"{file}: transpose the rotations (negate roll, pitch and heading and reverse their order), or the quaternions' x, y, z",
        lambda r: np.swapaxes(r, -1, -2),
    )
    yield Remedy(
        "transposed quaternions",
        ATTITUDE,
        "The attitude was written as body_from_world where world_from_body is read.",
        lambda f, _: world_turned(f, lambda r, level: np.swapaxes(r, -1, -2)),
        constant(f"{file}: change the signs of qx, qy and qz (world_from_body is read)"),
        oddity=3,
    )
    if any(isinstance(link, PosePerImage) for link in flight.sensor.links):
        yield from _opk(file)
    yield Remedy(
        "convergence",
        "heading offset",
        "Headings count from grid or magnetic north where true north is read: all are off by one angle.",
        lambda f, v: turned(f, lambda r: about("z", np.full(len(r), v)) @ r),
        lambda v: f"{file}: add {degrees(v or 0.0):+.4f} deg to heading_deg (of omega, phi, kappa: the column convergence_deg)",
        Amount("deg", np.radians(3.0), 1e-5, shown=degrees),
    )
    yield Remedy(
        "height of POS",
        "height",
        "Heights of the platform refer to another surface than those of the points: mean sea level, say, or another antenna.",
        lambda f, v: lifted(f, float(v or 0.0)),
        lambda v: f"{file}: add {v or 0.0:+.3f} m to height_m (z_m)",
        Amount("m", 60.0, 1e-2),
        oddity=2,
    )


def _signs(file: str) -> Iterator[Remedy]:
    names = ("roll", "pitch", "heading")
    for signs in itertools.product((1, -1), repeat=3):
        wrong = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
        if not wrong:
            continue
        many = "s" if len(wrong) > 1 else ""
        yield _of_angles(
            f"sign{many} of {' and '.join(wrong)}",
            f"The sign{many} of {' and '.join(wrong)} {'are' if many else 'is'} the other one.",
            f"{file}: change the sign{many} of {', '.join(f'{name}_deg' for name in wrong)}",
            lambda r, p, h, s=signs: (s[0] * r, s[1] * p, s[2] * h),
            oddity=len(wrong),
        )


def _opk(file: str) -> Iterator[Remedy]:
    names = ("omega", "phi", "kappa")
    for signs in itertools.product((1, -1), repeat=3):
        wrong = [name for name, sign in zip(names, signs, strict=True) if sign < 0]
        if wrong:
            many = "s" if len(wrong) > 1 else ""
            yield _of_opk(
                f"sign{many} of {' and '.join(wrong)}",
                f"The sign{many} of {' and '.join(wrong)} {'are' if many else 'is'} the other one.",
                f"{file}: change the sign{many} of {', '.join(f'{name}_deg' for name in wrong)}",
                lambda o, p, k, s=signs: _product("xyz", s[0] * o, s[1] * p, s[2] * k),
                oddity=1 + len(wrong),
            )
    told = f"{file}: convert the angles to Rx(omega) Ry(phi) Rz(kappa), or write quaternions"
    for name, order, of in (
        ("order Rz Ry Rx of omega, phi, kappa", "Rz(kappa) Ry(phi) Rx(omega)", lambda o, p, k: _product("zyx", k, p, o)),
        ("order Ry Rx Rz of omega, phi, kappa", "Ry(phi) Rx(omega) Rz(kappa)", lambda o, p, k: _product("yxz", p, o, k)),
    ):
        yield _of_opk(name, f"The rotation is {order} where Rx(omega) Ry(phi) Rz(kappa) is read.", told, of, oddity=2)
    yield _of_opk(
        "transposed omega, phi, kappa",
        "Omega, phi, kappa describe camera_from_world where world_from_camera is read.",
        f"{file}: convert the angles to the transposed rotations, or write quaternions with x, y, z negated",
        lambda o, p, k: np.swapaxes(_product("xyz", o, p, k), -1, -2),
        oddity=2,
    )


def _product(order: str, *angles: np.ndarray) -> np.ndarray:
    first, second, third = (about(axis, angle) for axis, angle in zip(order, angles, strict=True))
    return first @ second @ third


def _of_rotation(name: str, sentence: str, advice: str, turn: Callable[[np.ndarray], np.ndarray], oddity: int = 2) -> Remedy:
    return Remedy(name, ATTITUDE, sentence, lambda f, _: turned(f, turn), constant(advice), oddity=oddity)


def _of_angles(name: str, sentence: str, advice: str, change: Callable[..., Any], oddity: int = 1) -> Remedy:
    def turn(r: np.ndarray) -> np.ndarray:
        roll, pitch, heading = change(*roll_pitch_heading(r))
        return _product("zyx", heading, pitch, roll)

    return _of_rotation(name, sentence, advice, turn, oddity)


def _of_opk(name: str, sentence: str, advice: str, change: Callable[..., np.ndarray], oddity: int) -> Remedy:
    return _of_rotation(name, sentence, advice, lambda r: SWAP @ change(*omega_phi_kappa(SWAP @ r)), oddity)
