"""Mistakes that people make, made on purpose: each from a sound flight to a spoiled one, by code that shares none with the cures.

A spoil is None for flights on which the mistake cannot be made: no encoders, no size of the image.
"""

import dataclasses
import fnmatch
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import whiskjax as wj

NED_FROM_ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]], assume_valid=True)


class Spoil(NamedTuple):
    """A mistake, and the names of the remedies that undo it (patterns)."""

    name: str
    make: Callable[[Any], Any]
    cures: tuple[str, ...]


def relinked(flight, change):
    s = flight.sensor
    links = {name: change(name, link) for name, link in zip(s.names, s.links, strict=True)}
    return dataclasses.replace(flight, sensor=wj.Sensor(links, s.camera, s.refraction))


def recorded(flight):
    return [x for x in flight.sensor.links if isinstance(x, wj.Trajectory | wj.PosePerImage)]


def world_from_ned(flight, position):
    """By latitude and longitude, with scipy's rotations; in a local world east, north, up are the axes."""
    if flight.world.is_flat:
        return Rotation.concatenate([NED_FROM_ENU] * len(position))
    lat, lon, _ = (np.asarray(c) for c in jax.jit(wj.ecef_to_geodetic)(jnp.asarray(position)))
    return Rotation.from_euler("ZY", np.stack([lon, -lat - np.pi / 2], axis=-1))


def attitudes(flight, of):
    """With other attitudes: `of` is from scipy rotations ned_from_body to such rotations."""

    def change(_, link):
        if not isinstance(link, wj.Trajectory | wj.PosePerImage):
            return link
        position, q = (np.stack([np.asarray(c) for c in a], axis=-1) for a in (link.position_m, link.quaternion))
        level = world_from_ned(flight, position)
        new = (level * of(level.inv() * Rotation.from_quat(q))).as_quat()
        if isinstance(link, wj.PosePerImage):
            return wj.PosePerImage(position, new, link.turn_rad, link.shift_m)
        velocity = None
        if link.velocity_mps is not None and link.interpolation == "linear":
            velocity = np.stack([np.asarray(c) for c in link.velocity_mps], axis=-1)
        times = np.asarray(link.knots.time_s)
        return wj.Trajectory(
            times, position, new, max_gap_s=link.knots.max_gap_s, velocity_mps=velocity, interpolation=link.interpolation
        )

    return relinked(flight, change)


def angles(of):
    """A mistake in roll, pitch and heading, (n, 3), radians."""

    def turn(r):
        heading, pitch, roll = r.as_euler("ZYX").T
        roll, pitch, heading = of(roll, pitch, heading)
        return Rotation.from_euler("ZYX", np.stack([heading, pitch, roll], axis=-1))

    return lambda flight: attitudes(flight, turn)


def opk(of):
    """A mistake in omega, phi, kappa; of flights that give them."""

    def make(flight):
        if not any(isinstance(x, wj.PosePerImage) for x in recorded(flight)):
            return None
        return attitudes(flight, lambda r: NED_FROM_ENU * of(NED_FROM_ENU * r))

    return make


def axes(written):
    """Another convention for the first axes link, or, where there is none, an axes link that undoes a turned camera."""

    def make(flight):
        names = [n for n, x in zip(flight.sensor.names, flight.sensor.links, strict=True) if isinstance(x, wj.Axes)]
        if not names:
            last = flight.sensor.names[-1]
            return dataclasses.replace(flight, sensor=flight.sensor.after(last, "mounted", wj.Axes(written)))
        old = flight.sensor[names[0]].axes.split()
        signs = {"x": (0, 1), "y": (1, 1), "z": (2, 1)} | {"-x": (0, -1), "-y": (1, -1), "-z": (2, -1)}
        turned = []
        for word in written.split():  # the old axes, permuted and signed
            i, s = signs[word]
            turned.append(old[i] if s > 0 else old[i].removeprefix("-") if old[i][0] == "-" else "-" + old[i])
        return relinked(flight, lambda n, x: wj.Axes(" ".join(turned)) if n == names[0] else x)

    return make


def measured(flight, **columns):
    return dataclasses.replace(flight, measurements=dataclasses.replace(flight.measurements, **columns))


def exchanged(flight):
    m = flight.measurements
    if flight.is_line:
        return None
    columns = {"line_px": m.sample_px, "sample_px": m.line_px, "sigma_line_px": m.sigma_sample_px}
    return measured(flight, **columns, sigma_sample_px=m.sigma_line_px)


def mirrored(column):
    def make(flight):
        if flight.is_line:
            if column == "line_px":
                return None
            return recamera(flight, lambda c: eqx.tree_at(lambda x: x.along_sign, c, -c.along_sign))
        size = [image.columns if column == "sample_px" else image.rows for image in flight.images]
        if None in size:
            return None
        value = np.array(size, dtype=float)[flight.measurements.image] - 1 - getattr(flight.measurements, column)
        return measured(flight, **{column: value})

    return make


def recamera(flight, change):
    def each(c):
        if isinstance(c, wj.By):
            return wj.By(c.key, {n: each(o) for n, o in zip(c.names, c.options, strict=True)})
        return change(c)

    s = flight.sensor
    links = dict(zip(s.names, s.links, strict=True))
    return dataclasses.replace(flight, sensor=wj.Sensor(links, each(s.camera), s.refraction))


def first_pixel(by_px):
    def make(flight):
        m = flight.measurements
        if not flight.is_line:
            return measured(flight, sample_px=m.sample_px - by_px, line_px=m.line_px - by_px)
        images = []
        for image in flight.images:
            line, time = np.asarray(image.lines.line), np.asarray(image.lines.time_s)
            images.append(dataclasses.replace(image, lines=wj.LineTimes(line - by_px, time)))
        # Lines of the table's own numbers: what was line 0 is now called -by_px, and measured where it says 0.
        span = [(float(i.lines.line[0]), float(i.lines.line[-1])) for i in images]
        low, high = np.array(span)[m.image].T
        line = np.clip(m.line_px - 2 * by_px, low, high)
        return dataclasses.replace(measured(flight, sample_px=m.sample_px - by_px, line_px=line), images=images)

    return make


def focal_in_mm(pitch_mm):
    def make(flight):
        def mm(c):
            return eqx.tree_at(lambda x: x.focal_px, c, jnp.asarray(np.asarray(c.focal_px) * pitch_mm))

        def prior(x):
            if not x.where[: len("camera")] == "camera" or "focal_px" not in str(x.where):
                return x
            scaled = {k: None if getattr(x, k) is None else getattr(x, k) * pitch_mm for k in ("mean", "sigma", "scale")}
            return wj.Unknown(x.name, x.where, **scaled)

        return dataclasses.replace(recamera(flight, mm), unknowns=[prior(x) for x in flight.unknowns])

    return make


def image_in_mm(pitch_mm):
    def make(flight):
        m, camera = flight.measurements, flight.sensor.camera
        if flight.is_line:
            cameras = camera.options if isinstance(camera, wj.By) else [camera]
            (principal,) = {float(c.principal_sample_px) for c in cameras}
            columns = {"sample_px": (m.sample_px - principal) * pitch_mm, "sigma_sample_px": m.sigma_sample_px * pitch_mm}
            return measured(flight, **columns)
        column, row = np.asarray(camera.principal_point_px)
        return measured(
            flight,
            sample_px=(m.sample_px - column) * pitch_mm,
            line_px=(row - m.line_px) * pitch_mm,
            sigma_sample_px=m.sigma_sample_px * pitch_mm,
            sigma_line_px=m.sigma_line_px * pitch_mm,
        )

    return make


def places_exchanged(flight):
    p = np.asarray(flight.points.position_m)
    if flight.world.is_flat:
        return dataclasses.replace(flight, points=dataclasses.replace(flight.points, position_m=p[:, [1, 0, 2]]))
    lat, lon, height = (np.asarray(c) for c in jax.jit(wj.ecef_to_geodetic)(jnp.asarray(p)))
    if (np.abs(lon) > np.pi / 2).any():
        return None  # no latitude, which reading says
    new = np.asarray(jax.jit(jax.vmap(wj.geodetic_to_ecef))(lon, lat, height))
    return dataclasses.replace(flight, points=dataclasses.replace(flight.points, position_m=new))


def raised(by_m):
    """Heights of the points, off along the ellipsoid's normal."""

    def make(flight):
        p = np.asarray(flight.points.position_m)
        if flight.world.is_flat:
            up = np.array([0.0, 0, 1])
        else:
            lat, lon, _ = (np.asarray(c) for c in jax.jit(wj.ecef_to_geodetic)(jnp.asarray(p)))
            up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
        return dataclasses.replace(flight, points=dataclasses.replace(flight.points, position_m=p + by_m * up))

    return make


def images_late(by_s):
    def make(flight):
        if not any(isinstance(x, wj.Trajectory) for x in recorded(flight)):
            return None
        images = []
        for i in flight.images:
            if i.lines is not None:
                i = dataclasses.replace(i, lines=wj.LineTimes(np.asarray(i.lines.line), np.asarray(i.lines.time_s) + by_s))
            elif i.time_s is not None:
                i = dataclasses.replace(i, time_s=i.time_s + by_s)
            images.append(i)
        return dataclasses.replace(flight, images=images)

    return make


def turns(flight):
    links = zip(flight.sensor.names, flight.sensor.links, strict=True)
    return [n for n, x in links if isinstance(x, wj.Turn) and isinstance(x.encoder, wj.Encoder)]


def encoders(change, which=None):
    """Other records of the turns, all or the one of a number: `change` is from time and angle to those."""

    def make(flight):
        names = turns(flight)
        if not names or (which is not None and which >= len(names)):
            return None
        chosen = names if which is None else [names[which]]

        def turn(name, x):
            if name not in chosen:
                return x
            time, angle = change(np.asarray(x.encoder.knots.time_s), np.asarray(x.encoder.angle_rad))
            again = wj.Encoder(time, angle, x.encoder.knots.max_gap_s, wraps=False)
            return wj.Turn(x.axis, again, x.sign, x.delay_s, x.zero_rad)

        return relinked(flight, turn)

    return make


def pos_late(by_s):
    def make(flight):
        if not turns(flight):
            return None

        def later(_, x):
            if not isinstance(x, wj.Trajectory):
                return x
            return eqx.tree_at(lambda t: t.knots.time_s, x, x.knots.time_s + by_s)

        return relinked(flight, later)

    return make


def wrong_image(flight):
    """All that was measured in one image is of another one: 60 px away, and turned."""
    m, role = flight.measurements, np.asarray(flight.points.roles)
    seen = np.bincount(m.image[role[m.point] == "control"], minlength=len(flight.images))
    if (seen > 3).sum() < 2 or seen.max() > 0.51 * seen.sum():
        return None
    i = int(np.argmax(seen))
    here = m.image == i
    return measured(flight, sample_px=np.where(here, 0.9 * m.sample_px + 60.0, m.sample_px))


def wrong_point(flight):
    role, m = np.asarray(flight.points.roles), flight.measurements
    count = np.bincount(m.point, minlength=len(role)) * (role == "control")
    if (count > 0).sum() < 5:
        return None
    p = np.array(flight.points.position_m)
    p[int(np.argmax(count))] += np.array([300.0, -200.0, 250.0])
    return dataclasses.replace(flight, points=dataclasses.replace(flight.points, position_m=p))


def convergence(by_deg):
    turn = Rotation.from_euler("Z", -by_deg, degrees=True)
    return lambda flight: attitudes(flight, lambda r: Rotation.concatenate([turn] * len(r)) * r)


ROLL_PITCH_HEADING = {
    "sign of roll": lambda r, p, h: (-r, p, h),
    "sign of pitch": lambda r, p, h: (r, -p, h),
    "sign of heading": lambda r, p, h: (r, p, -h),
    "signs of roll and pitch": lambda r, p, h: (-r, -p, h),
    "roll and pitch exchanged": lambda r, p, h: (p, r, h),
    "heading from east": lambda r, p, h: (r, p, np.pi / 2 - h),
}


def _of_signs(r, signs):
    return Rotation.from_euler("XYZ", r.as_euler("XYZ") * np.array(signs))


def _reverse(r):
    """Angles of Rz Ry Rx, written as omega, phi, kappa of a rotation that is read as Rx Ry Rz."""
    kappa, phi, omega = r.as_euler("ZYX").T
    return Rotation.from_euler("XYZ", np.stack([omega, phi, kappa], axis=-1))


SPOILS = [
    *(Spoil(name, angles(of), (name, f"{name} *")) for name, of in ROLL_PITCH_HEADING.items()),
    Spoil("transposed rotations", lambda f: attitudes(f, lambda r: r.inv()), ("transposed rotations",)),
    Spoil("sign of phi", opk(lambda r: _of_signs(r, (1, -1, 1))), ("sign of phi",)),
    Spoil("order of omega, phi, kappa", opk(lambda r: _reverse(r)), ("order Rz Ry Rx of omega, phi, kappa",)),
    Spoil("transposed omega, phi, kappa", opk(lambda r: r.inv()), ("transposed omega, phi, kappa",)),
    Spoil("axes turned by 90 deg", axes("y -x z"), ("axes of *", "camera turned*")),
    Spoil("axes turned by 180 deg", axes("-x y -z"), ("axes of *", "camera turned*")),
    Spoil("axes permuted", axes("y z x"), ("axes of *", "camera turned*")),
    Spoil("line and sample exchanged", exchanged, ("line and sample exchanged",)),
    Spoil("sample mirrored", mirrored("sample_px"), ("sample counted*", "direction of samples")),
    Spoil("line mirrored", mirrored("line_px"), ("line counted*",)),
    Spoil("first pixel", first_pixel(1.0), ("first pixel",)),
    Spoil("focal length in mm", focal_in_mm(0.0065), ("focal length in mm",)),
    Spoil("image coordinates in mm", image_in_mm(0.0065), ("image coordinates in mm",)),
    Spoil("coordinates exchanged", places_exchanged, ("latitude and longitude of points *", "x and y of points *")),
    Spoil("height step of 45 m", raised(45.0), ("height of points",)),
    Spoil("convergence of 1.7 deg", convergence(1.7), ("convergence",)),
    Spoil("images 18 s late", images_late(18.0), ("images -18 s",)),
    Spoil("images 1 s early", images_late(-1.0), ("images +1 s",)),
    Spoil("POS 1 s late", pos_late(1.0), ("POS -1 s",)),
    Spoil("encoders 2 s early", encoders(lambda t, a: (t - 2.0, a)), ("encoders +2 s",)),
    Spoil("encoder sign", encoders(lambda t, a: (t, -a), 0), ("sign of encoder *",)),
    Spoil("half an encoder's angle", encoders(lambda t, a: (t, a / 2), 0), ("twice the angle of encoder *",)),
    Spoil("a wrong image", wrong_image, ("image * is wrong",)),
    Spoil("a wrong point", wrong_point, ("point * is wrong",)),
]


def is_cure(spoil, name):
    """Whether a remedy undoes the mistake."""
    return any(fnmatch.fnmatchcase(name, cure) for cure in spoil.cures)


def named(name):
    """A mistake by its name."""
    return next(s for s in SPOILS if s.name == name)
