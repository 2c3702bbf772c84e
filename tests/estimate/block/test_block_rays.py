"""Residuals of rays and all their derivatives against finite differences of `wj.project`."""

import dataclasses

import jax
import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from whiskjax.estimate.block.rays import depend
from whiskjax.estimate.given import given, held, posed
from whiskjax.flights import songshan


def three_lines():
    """Rays of all views and strips, with numbers in every link; unknowns of every kind."""
    scene = dataclasses.replace(SCENE, drift=True)
    d = songshan.simulate_block(scene, 4)
    rng = np.random.default_rng(0)
    unknowns = list(songshan.unknowns(scene))
    unknowns += [wj.Unknown(f"focal {view}", f"camera.{view}.focal_px", scale=10.0) for view in songshan.VIEWS]
    unknowns += [wj.Unknown("offset", tuple(f"camera.{view}.offset_px" for view in songshan.VIEWS), scale=10.0)]
    size = np.array([x.size for x in unknowns])
    start = np.array([float(v) for v in (0.0,) * len(unknowns)])
    start[-4:-1], start[-1] = songshan.FOCAL_PX, 5.0
    sensor = wj.assign(d.sensor, unknowns, start + size * rng.uniform(-0.3, 0.3, len(size)) * np.minimum(1, 0.02 / size))
    stations = sensor["pos_error"].stations
    turn, shift = rng.normal(0, 1e-4, (stations, 3)), rng.normal(0, 0.1, (stations, 3))
    sensor = with_motions(sensor, "pos_error", turn, shift)
    rays = rng.choice(len(d.block), 60, replace=False)
    block = d.block.keep(rays)
    return sensor, block.shot, d.point_m[block.point], block.pixel_px, "pos_error", unknowns


def frames():
    """Frame images of two cameras, with poses that were moved."""
    rng = np.random.default_rng(1)
    place = np.array([[0.0, 0, 900], [200, 30, 950], [400, -20, 870]])
    photo = wj.PosePerImage(
        place, rng.normal([0, 0, 0, 1], 0.05, (3, 4)), rng.normal(0, 0.01, (3, 3)), rng.normal(0, 2.0, (3, 3))
    )
    cameras = {"wide": wj.FrameCamera(3000.0, (2000.0, 1500.0)), "long": wj.FrameCamera(5000.0, (2010.0, 1480.0))}
    mount = wj.Mount(angles_rad=[0.01, -0.02, 0.03], lever_arm_m=[0.1, 0.2, -0.3])
    sensor = wj.Sensor({"photo": photo, "mount": mount}, wj.By("view", cameras))
    image, view = np.arange(24) % 3, np.arange(24) % 2
    point = np.column_stack([rng.uniform(-100, 500, (24, 2)), rng.uniform(0, 80, 24)])
    unknowns = [wj.Unknown(f"angle {i}", f"mount.angles_rad[{i}]", scale=0.01) for i in range(3)]
    unknowns += [wj.Unknown(f"lever {i}", f"mount.lever_arm_m[{i}]", scale=1.0) for i in range(3)]
    unknowns += [wj.Unknown(f"focal {v}", f"camera.{v}.focal_px", scale=10.0) for v in cameras]
    unknowns += [wj.Unknown(f"column {v}", f"camera.{v}.principal_point_px[0]", scale=10.0) for v in cameras]
    return sensor, wj.Shot(image=image, view=view), point, rng.uniform(0, 4000, (24, 2)), "photo", unknowns


def with_motions(sensor, name, turn, shift):
    link = sensor[name]
    if isinstance(link, wj.Correction):
        link = wj.Correction(link.basis, turn, shift)
    else:
        link = wj.PosePerImage(np.stack(link.position_m, -1), np.stack(link.quaternion, -1), turn, shift)
    links = dict(zip(sensor.names, sensor.links, strict=True)) | {name: link}
    return wj.Sensor(links, sensor.camera)


CASES = {"three lines": three_lines, "frames": frames}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return CASES[request.param]()


def moved(sensor, name, values):
    """The sensor with all stations' motions moved by the same six numbers: that moves every ray by them."""
    turn, shift = (np.asarray(m) for m in sensor[name].motions)
    return with_motions(sensor, name, turn + np.asarray(values)[:3], shift + np.asarray(values)[3:])


def differences(projected, k, step):
    """Central differences by each of k numbers, extrapolated once (Richardson): (k, rays, 2), and the values at zero."""
    columns = []
    for i in range(k):
        up, down, half_up, half_down = (np.asarray(projected(s * step[i] * np.eye(k)[i])) for s in (1, -1, 0.5, -0.5))
        columns.append((4 * (half_up - half_down) - (up - down) / 2) / 3 / step[i])
    return np.array(columns), np.asarray(projected(np.zeros(k)))


def assert_columns(found, expected, step):
    """Within 1e-6 px of what a step of the differences changes (rounding of the pixel), and every column moves something."""
    found = np.stack([np.stack([np.broadcast_to(c, expected.shape[1]) for c in axis]) for axis in found], axis=-1)
    scale = np.asarray(step)[:, None, None]
    np.testing.assert_allclose(found * scale, expected * scale, rtol=0, atol=1e-6)
    assert (np.abs(expected * scale).max(axis=(1, 2)) > 1e-3).all()


def test_all_derivatives(case):
    sensor, shot, point, pixel, link, unknowns = case
    _, numbers, _ = posed(sensor, given("test", "unknowns", unknowns))
    of = jax.jit(lambda p, m: depend(sensor, shot, p, m, link, numbers))
    found = of(tuple(point.T), tuple(pixel.T))
    project = jax.jit(lambda s, p: wj.project(s, shot, p, throw=False).pixel_px)

    values = held(sensor, unknowns)
    step = np.array([0.02 * x.size for x in unknowns])
    by_unknown, here = differences(lambda v: project(wj.assign(sensor, unknowns, values + v), point), len(values), step)
    np.testing.assert_allclose(np.stack(found.residual, -1), pixel - here, rtol=0, atol=1e-8)
    size = np.asarray(numbers.scale)
    assert_columns(found.by_unknown, by_unknown * size[:, None, None], step / size)

    step = np.full(3, 1.0)
    by_point, _ = differences(lambda v: project(sensor, point + v), 3, step)
    assert_columns(found.by_point, by_point, step)

    step = np.array([1e-4] * 3 + [0.1] * 3)
    by_motion, _ = differences(lambda v: project(moved(sensor, link, v), point), 6, step)
    assert_columns(found.by_motion, by_motion, step)


def test_single_stations_as_unknowns(case):
    """Numbers of single stations, given as plain unknowns, act with the weight of their station."""
    sensor, shot, point, pixel, link, _ = case
    unknowns = [
        wj.Unknown(f"{f} {k} {i}", f"{link}.{f}[{k},{i}]", scale=1.0) for f, k, i in (("turn_rad", 1, 0), ("shift_m", 2, 2))
    ]
    _, numbers, _ = posed(sensor, given("test", "unknowns", unknowns))
    of = jax.jit(lambda p, m: depend(sensor, shot, p, m, None, numbers))
    found = of(tuple(point.T), tuple(pixel.T))
    assert found.by_motion == ((), ())
    project = jax.jit(lambda s: wj.project(s, shot, point, throw=False).pixel_px)
    values, step = held(sensor, unknowns), np.array([1e-3, 1.0])
    expected, _ = differences(lambda v: project(wj.assign(sensor, unknowns, values + v)), 2, step)
    size = np.asarray(numbers.scale)
    assert_columns(found.by_unknown, expected * size[:, None, None], step / size)
