"""One image whose pose is so wrong that points cannot be intersected: the image is named, not a point."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.estimate.block.conftest import SCENE
from whiskjax.estimate.block.wrong_image import wrong_image
from whiskjax.flights import songshan

ROWS, COLUMNS, POINTS = 3, 5, 62
WRONG = {
    "heading": Rotation.from_euler("z", 180, degrees=True),
    "quarter": Rotation.from_euler("z", 90, degrees=True),
    "to the sky": Rotation.from_euler("x", 180, degrees=True),
    "to the horizon": Rotation.from_euler("y", 100, degrees=True),
}
ERRORS = (wj.FrameErrors("photo", (1e-3,) * 3, (1.0,) * 3),)


def fifteen(wrong="heading", which=7, seed=3):
    """Fifteen images in three strips of five, 62 points, three of them control; one image is recorded turned."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(COLUMNS) * 150.0, np.arange(ROWS) * 250.0)
    place = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 900.0)])
    kappa = np.repeat([0.0, 180.0, 0.0], COLUMNS)
    true = Rotation.from_euler("ZYX", np.column_stack([kappa, rng.normal(0, 1, (15, 2))]), degrees=True)
    point = np.column_stack([rng.uniform(-100, 700, POINTS), rng.uniform(-100, 600, POINTS), rng.uniform(0, 90, POINTS)])
    image, seen = np.divmod(np.arange(15 * POINTS), POINTS)
    q = np.einsum("nji,nj->ni", true.as_matrix()[image], point[seen] - place[image])
    pixel = np.array([1000.0, 800.0]) - 2500.0 * q[:, :2] / q[:, 2:] * np.array([1.0, -1.0])
    inside = (np.abs(pixel - (1000.0, 800.0)) < (1000.0, 800.0)).all(axis=1)
    twice = np.bincount(seen[inside], minlength=POINTS)[seen] > 1
    keep = inside & twice
    image, seen, pixel = image[keep], seen[keep], pixel[keep] + 0.3 * rng.standard_normal((keep.sum(), 2))
    recorded = true * Rotation.from_rotvec(rng.normal(0, 1e-3, (15, 3)))
    spoiled = recorded.as_matrix()
    if wrong:
        spoiled[which] = spoiled[which] @ WRONG[wrong].as_matrix()
    control = np.unique(seen)[[0, 20, -1]]
    role = np.where(np.isin(np.arange(POINTS), control), "control", "tie")
    block = wj.Block(
        wj.Shot(image=image),
        pixel,
        np.full(pixel.shape, 0.3),
        seen,
        np.where((role == "control")[:, None], point, np.nan),
        np.broadcast_to(np.eye(3) * 0.02**2, (POINTS, 3, 3)),
        role,
        points=[f"G{i:02}" for i in range(POINTS)],
        images=[f"im{i:02}" for i in image],
    )
    poses = wj.PosePerImage(place + rng.normal(0, 1.0, place.shape), Rotation.from_matrix(spoiled).as_quat())
    return wj.Sensor({"photo": poses}, wj.FrameCamera(2500.0, (1000.0, 800.0))), block


def test_the_block_is_fine():
    sensor, block = fifteen(wrong="")
    assert wj.adjust(sensor, block, errors=ERRORS).is_sound


@pytest.mark.parametrize("more", [{}, {"blunders": wj.Blunders()}], ids=["plain", "blunders"])
@pytest.mark.parametrize("which", [0, 7, 13])
@pytest.mark.parametrize("wrong", WRONG)
def test_the_image_is_named(wrong, which, more):
    sensor, block = fifteen(wrong, which)
    with pytest.raises(wj.SensorError, match=rf"^adjust: image im{which:02}: its rays are wrong, the others agree"):
        wj.adjust(sensor, block, errors=ERRORS, **more)


def test_a_strip_that_was_flown_the_other_way_is_named(drawn):
    """Songshan: all three lines of one strip look backwards; its single images are no more wrong than the others of it."""
    body, strip = drawn.sensor["body"], SCENE.data.strips
    start = songshan.start_s(len(strip))
    time = np.asarray(body.knots.time_s)
    turned = Rotation.from_quat(np.stack([np.asarray(c) for c in body.quaternion], axis=-1)).as_matrix()
    west = (time >= start[1]) & (time <= start[1] + songshan.STRIP_S)
    turned[west] = turned[west] @ np.diag([-1.0, -1.0, 1.0])
    wrong = wj.Trajectory(
        time, np.stack(body.position_m, axis=-1), Rotation.from_matrix(turned).as_quat(), max_gap_s=body.knots.max_gap_s
    )
    links = dict(zip(drawn.sensor.names, drawn.sensor.links, strict=True)) | {"body": wrong}
    sensor = wj.Sensor(links, drawn.sensor.camera)
    with pytest.raises(wj.SensorError, match=r"^adjust: strip west: its rays are wrong, the others agree"):
        wj.adjust(sensor, drawn.block, songshan.unknowns(SCENE), errors=songshan.frame_errors(SCENE))


def test_a_wrong_point_is_no_wrong_image():
    """One tie whose rays are parallel, another whose ray is far off: the point is named as ever."""
    sensor, block = fifteen(wrong="")
    tie = np.flatnonzero(block.role == "tie")[5]
    rays = np.flatnonzero(block.point == tie)
    same = np.concatenate([np.flatnonzero(block.point != tie), np.repeat(rays[:1], 3)])
    with pytest.raises(wj.SensorError, match=f"point G{tie:02}: its rays do not meet: they are parallel"):
        wj.adjust(sensor, block.keep(same), errors=ERRORS)
    parted = np.zeros(POINTS, dtype=bool)
    parted[np.unique(block.point)[:4]] = True
    assert wrong_image(sensor, block, parted) is None


def test_two_wrong_images_are_not_one():
    """Neither explains it all: no image is named that would leave the others agreeing."""
    sensor, block = fifteen("to the sky", 2)
    both = sensor["photo"]
    matrix = np.array(Rotation.from_quat(np.stack([np.asarray(c) for c in both.quaternion], axis=-1)).as_matrix())
    matrix[12] = matrix[12] @ WRONG["to the sky"].as_matrix()
    poses = wj.PosePerImage(np.stack([np.asarray(c) for c in both.position_m], axis=-1), Rotation.from_matrix(matrix).as_quat())
    with pytest.raises(wj.SensorError, match="do not meet"):
        wj.adjust(wj.Sensor({"photo": poses}, sensor.camera), block, errors=ERRORS)
