"""Bad blocks: what cannot be adjusted is refused by name, what can is adjusted with a warning."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from tests.estimate.block.frames import FREE, POINTS, POS, frames
from whiskjax.estimate.block.connect import connections
from whiskjax.flights import songshan


def test_control_fixes_the_datum():
    """Poses off by a metre and a milliradian, free: three control points bring every point back, as close as is said."""
    normal = []
    for seed in range(20):
        sensor, block, _, truth = frames(seed=seed)
        found = wj.adjust(sensor, block, errors=FREE)
        assert found.result == wj.RESULTS.successful
        error = found.point_m - truth
        assert np.sqrt((error**2).mean()) < 1.0
        normal.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_m2), error).mean() / 3)
    # Errors of a block's points hang together (its datum has seven numbers): the mean of 20 blocks is good to about 0.1.
    assert 0.7 < np.mean(normal) < 1.3


def test_without_control_the_datum_rests_on_pos():
    sensor, block, _, truth = frames(control=0)
    found = wj.adjust(sensor, block, errors=POS)
    assert found.result == wj.RESULTS.successful
    assert "there is no control point: the datum of the block rests on POS" in found.warnings
    # POS is off by a metre in each of six images.
    error = found.point_m - truth
    normal = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_m2), error)
    assert 0.1 < normal.mean() / 3 < 3


@pytest.mark.parametrize("control", [0, 2])
def test_a_free_block_without_datum_is_refused(control):
    """Two points leave the turn about their line; the message names numbers of stations and the remedy."""
    sensor, block, *_ = frames(control=control)
    with pytest.raises(wj.SensorError, match=r"(turn|shift) [xyz] of station \d.*three control points or more"):
        wj.adjust(sensor, block, errors=FREE)


def test_two_unknowns_that_do_the_same_are_named():
    """The mount's angle about z and that of a second mount behind it, without priors."""
    sensor, block, *_ = frames()
    twice = {"photo": sensor["photo"], "one": wj.Mount(angles_rad=[0.0] * 3), "two": wj.Mount(angles_rad=[0.0] * 3)}
    unknowns = [wj.Unknown(f"kappa {name}", f"{name}.angles_rad[2]", scale=0.01) for name in ("one", "two")]
    with pytest.raises(wj.SensorError, match=r"kappa (one, kappa two|two, kappa one)"):
        wj.adjust(wj.Sensor(twice, sensor.camera), block, unknowns, errors=POS)


@pytest.mark.parametrize("turned_deg", [90.0, 180.0, -180.0, 540.0])
def test_a_block_may_be_turned(turned_deg):
    """Angles at +-180 deg are no place of their own: a block turned as a whole gives the same block, turned."""
    sensor, block, *_ = frames()
    expected = wj.adjust(sensor, block, errors=FREE)
    sensor, block, about, _ = frames(turned_deg)
    found = wj.adjust(sensor, block, errors=FREE)
    np.testing.assert_allclose(found.point_m, about.apply(expected.point_m), rtol=0, atol=1e-5)
    assert found.cost == pytest.approx(expected.cost, rel=1e-8)


def test_parallel_rays_are_named():
    sensor, block, *_ = frames()
    # A control point may be seen once: P1 is one.
    assert wj.adjust(sensor, block.keep((block.point != 1) | (block.key("image") == 2)), errors=POS).is_sound
    same = np.concatenate([np.flatnonzero(block.point != 7), np.repeat(np.flatnonzero(block.point == 7)[:1], 6)])
    with pytest.raises(wj.SensorError, match="point P7: its rays do not meet: they are parallel"):
        wj.adjust(sensor, block.keep(same), errors=POS)


@pytest.mark.parametrize("role", ["tie", "control"])
def test_a_ray_that_the_sensor_cannot_make_is_named(drawn, role):
    """A time in the turn between two strips, a view that the camera lacks: of tie points and of control points alike."""
    unknowns, errors = songshan.unknowns(SCENE), songshan.frame_errors(SCENE)
    block = drawn.block
    ray = int(np.flatnonzero(block.role[block.point] == role)[0])
    time, view = np.array(block.key("time_s")), np.array(block.key("view"))
    time[ray], view[ray] = 400.0, 3
    for change in ({"time_s": time}, {"view": view}):
        shot = dataclasses.replace(block.shots(), **change)
        with pytest.raises(
            wj.SensorError, match=rf"^ray {ray}, image {block.images[ray]}, {block.point_label(block.point[ray])}: "
        ):
            wj.adjust(drawn.sensor, dataclasses.replace(block, shot=shot), unknowns, errors=errors)


def test_senseless_questions_are_refused(drawn):
    sensor, block, *_ = frames()
    with pytest.raises(wj.WhiskjaxError, match="nothing but points is unknown"):
        wj.adjust(sensor, block)
    inside = [wj.Unknown("turn", "photo.turn_rad[0,0]", scale=1e-3)]
    with pytest.raises(wj.WhiskjaxError, match="unknown turn lives in photo"):
        wj.adjust(sensor, block, inside, errors=POS)
    with pytest.raises(wj.WhiskjaxError, match="no image"):
        wj.adjust(sensor, dataclasses.replace(block, shot=wj.Shot(view=np.zeros(len(block), dtype=int))), errors=POS)


BLOCK = frames()[1]


def changed(name, index, value):
    array = np.array(getattr(BLOCK, name))
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(
    "change, message",
    [
        (changed("pixel_px", (30, 1), np.nan), "ray 30, image im1, point P6: pixel_px is not a finite number"),
        (changed("sigma_px", (5, 0), 0.0), "ray 5, image im0, point P5: sigma_px must be a positive number"),
        (changed("sigma_px", (5, 0), np.nan), "ray 5, image im0, point P5: sigma_px must be a positive number"),
        (changed("point", 3, POINTS), "ray 3 sees point 24, but the points are 0 to 23"),
        (changed("point", 3, -1), "ray 3 sees point -1, but the points are 0 to 23"),
        (changed("position_m", (1, 2), np.nan), "point P1 is a control point, but its coordinates are not finite"),
        (changed("covariance_m2", (2, 0, 0), np.inf), "point P2 is a control point, but"),
        ({"role": np.array(["anchor"] * POINTS)}, "a point is a control, check, tie point, not .*anchor"),
        (
            {"pixel_px": BLOCK.pixel_px[:-1]},
            r"Block: pixel_px has shape \(143, 2\), expected \(rays, 2\) with rays = 144 as point has",
        ),
        ({"covariance_m2": np.zeros((POINTS, 3))}, r"covariance_m2 has shape \(24, 3\), expected \(points, 3, 3\)"),
        ({"points": ["P"]}, "1 names of points for 24"),
        ({"images": ["a", "b"]}, "2 names of images for 144"),
        ({"shot": wj.Shot(strip=np.full(144, 2)), "strips": ["east", "west"]}, "2 names of strips, but a ray is of strip 2"),
    ],
)
def test_a_wrong_block_is_refused(change, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        dataclasses.replace(BLOCK, **change)


def test_a_block_needs_rays():
    with pytest.raises(wj.WhiskjaxError, match="the block has no rays"):
        BLOCK.keep(np.zeros(len(BLOCK), dtype=bool))


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 11)), min_size=1, max_size=30))
def test_connections_are_those_of_the_graph(pairs):
    image, point = np.array(pairs).T
    none = np.zeros((len(pairs), 2))
    block = wj.Block(
        wj.Shot(image=image), none, none + 1, point, np.full((12, 3), np.nan), np.zeros((12, 3, 3)), np.full(12, "tie")
    )
    count, label = connected_components(coo_array((np.ones(len(pairs)), (image, 8 + point)), shape=(20, 20)), directed=False)
    expected = {frozenset(f"image {i}" for i in set(image.tolist()) if label[i] == k) for k in range(count)} - {frozenset()}
    assert {frozenset(group) for group in connections(block)} == expected
    assert sum(map(len, connections(block))) == len(set(image.tolist()))


def test_a_strip_tied_to_nothing_is_named(drawn):
    """No point in common: a warning tells which strip hangs on POS and control alone."""
    block = drawn.block
    strip = np.asarray(block.key("strip"))
    shared = [p for p in range(len(block.role)) if len(set(strip[block.point == p])) > 1]
    apart = block.keep(~np.isin(block.point, shared))
    named, numbered = [f"strip {name}" for name in block.strips], dataclasses.replace(apart, strips=())
    assert connections(block) == [named]
    assert connections(apart) == [[named[0]], [named[1]]]
    assert connections(numbered) == [["strip 0"], ["strip 1"]]
