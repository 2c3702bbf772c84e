"""Where a number lives in a sensor."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.chain.address import Address, make_room, parse, put, read

TIME_S = [0.0, 1.0, 2.0]
SENSOR = wj.Sensor(
    {
        "body": wj.Trajectory(TIME_S, np.zeros((3, 3)), [[0, 0, 0, 1.0]] * 3, max_gap_s=2.0),
        "drift": wj.Correction(wj.Drift(0.0, 2.0)),
        "wander": wj.Correction(wj.Process.random_walk(TIME_S)),
        "poses": wj.PosePerImage(np.zeros((4, 3)), [[0, 0, 0, 1.0]] * 4),
        "platform": wj.By("swing", {"left": wj.Mount(angles_rad=[1.0, 2.0, 3.0]), "right-2": wj.Mount()}),
        "scan": wj.Turn("x", wj.Encoder(TIME_S, TIME_S, 2.0)),
        "flu": wj.Axes("x -y -z"),
    },
    wj.By(
        "view",
        {
            "nadir": wj.LineCamera(1000.0),
            "frame": wj.FrameCamera([1000.0, 2000.0], (1.0, 2.0), per_image=True),
            "looks": wj.LookTable([0.0, 1.0], [[0.0, 0.0, -1.0], [0.1, 0.0, -1.0]]),
        },
    ),
)


@pytest.mark.parametrize(
    "text, address",
    [
        ("platform.left.angles_rad[0]", Address("platform", ("left", "angles_rad"), (0,))),
        ("platform.left.angles_deg[0]", Address("platform", ("left", "angles_rad"), (0,))),
        ("platform.right-2.angles_rad[2]", Address("platform", ("right-2", "angles_rad"), (2,))),
        ("camera.nadir.focal_px", Address("camera", ("nadir", "focal_px"), ())),
        ("camera.nadir.deformation_px[1, 3]", Address("camera", ("nadir", "deformation_px"), (1, 3))),
        (" body.delay_s ", Address("body", ("delay_s",), ())),
    ],
)
def test_places_are_parsed_and_written_back(text, address):
    assert parse(text) == address
    assert parse(address.text) == parse(address.inner) == address
    assert "_rad" not in address.text and "_deg" not in address.inner


@pytest.mark.parametrize(
    "text", ["body", "", "body.", ".delay_s", "body.delay_s[", "body.delay_s[-1]", "body.delay_s[a]", "1.x", "a b.c"]
)
def test_what_is_no_place_is_refused(text):
    with pytest.raises(wj.WhiskjaxError, match=r"no place in a sensor; places look like 'platform\.left\.angles_deg\[0\]'"):
        parse(text)


def test_numbers_are_read():
    assert float(read(SENSOR, parse("platform.left.angles_rad[1]"))) == 2.0
    assert float(read(SENSOR, parse("camera.nadir.focal_px"))) == 1000.0
    # What is absent is zero.
    for text in ("body.delay_s", "platform.right-2.lever_arm_m[1]", "scan.zero_rad", "drift.turn_rad[1,2]"):
        assert float(read(SENSOR, parse(text))) == 0.0


ABSENT = {
    "body.delay_s": (),
    "body.attitude_delay_s": (),
    "drift.turn_rad[1,2]": (2, 3),
    "drift.shift_m[0,0]": (2, 3),
    "poses.turn_rad[3,0]": (4, 3),
    "poses.shift_m[0,2]": (4, 3),
    "platform.right-2.lever_arm_m[0]": (3,),
    "platform.right-2.angles_rad[2]": (3,),
    "scan.delay_s": (),
    "scan.zero_rad": (),
    "scan.polynomial_rad[1]": (2,),
    "camera.frame.distortion[4]": (5,),
    "camera.nadir.deformation_px[1,3]": (2, 4),
}


@pytest.mark.parametrize("text", ABSENT)
def test_room_is_made_where_there_was_a_structural_zero(text):
    address = parse(text)
    sensor = make_room(SENSOR, address)
    leaf = sensor[address.link]
    for name in address.path:
        leaf = leaf[name] if isinstance(leaf, wj.By) else getattr(leaf, name)
    assert leaf.shape == ABSENT[text]
    np.testing.assert_array_equal(leaf, 0)
    changed = put(sensor, [address], [0.25])
    assert float(read(changed, address)) == 0.25
    # Everything else is as it was.
    assert eqx.tree_equal(put(changed, [address], [jnp.zeros(())]), sensor)


def test_room_is_made_where_there_was_a_structural_one():
    """And none where an int says what a part is."""
    address = parse("scan.gain")
    assert float(read(SENSOR, address)) == 1.0 and SENSOR["scan"].gain == 1
    sensor = make_room(SENSOR, address)
    assert sensor["scan"].gain.shape == () and float(sensor["scan"].gain) == 1.0
    for text in ("scan.sign", "platform.left.lever_sign"):
        with pytest.raises(wj.WhiskjaxError, match="is not a number that can be estimated"):
            make_room(SENSOR, parse(text))


PARTS = {
    "lever_arm_m": ((3,), wj.Mount),
    "angles_rad": ((3,), wj.Mount),
    "turn_rad": ((5, 3), lambda **absent: wj.Correction(wj.OrientationImages(-3.0, 2.0, 5), **absent)),
    "shift_m": ((4, 3), lambda **absent: wj.PosePerImage(np.ones((4, 3)), [[0, 0, 0, 1.0]] * 4, **absent)),
    "distortion": ((5,), lambda **absent: wj.FrameCamera(1000.0, (1.0, 2.0), **absent)),
    "deformation_px": ((2, 4), lambda **absent: wj.LineCamera(1000.0, half_width_px=50.0, **absent)),
    "wave_px": ((2, 2), lambda **absent: wj.LineCamera(1000.0, wavelength_px=400.0, **absent)),
    "polynomial_rad": ((2,), lambda **absent: wj.Turn("x", wj.Encoder(TIME_S, TIME_S, 2.0), **absent)),
}


@pytest.mark.parametrize("field", PARTS)
def test_what_is_absent_is_what_the_part_says(field):
    """A part that is given this array images as the part without it."""
    shape, make = PARTS[field]
    part, shot, q = make(), wj.Shot(time_s=0.5, image=1), (0.1, 0.02, -1.0)
    assert part.absent(field).shape == shape
    assert part.absent("order") is None
    same = make(**{field: part.absent(field)})
    if isinstance(part, wj.AbstractCamera):
        np.testing.assert_allclose(same.pixel(q), part.pixel(q), rtol=0, atol=1e-12)
    else:
        np.testing.assert_allclose(same.pose(shot).matrix, part.pose(shot).matrix, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(same.pose(shot).origin_m, part.pose(shot).origin_m)


def test_a_part_of_somebody_else_answers_for_itself():
    class Bent(wj.AbstractLink):
        given: ClassVar = ("table_m",)
        bend_m: jax.Array | None
        table_m: jax.Array

        def absent(self, field):
            return jnp.zeros(7) if field == "bend_m" else None

        def pose(self, shot):
            return wj.Pose()

        def check(self, shot):
            return wj.RESULTS.successful

    sensor = SENSOR.after("body", "bent", Bent(None, jnp.ones(2)))
    assert make_room(sensor, parse("bent.bend_m[6]"))["bent"].bend_m.shape == (7,)
    with pytest.raises(wj.WhiskjaxError, match=r"bent\.table_m\[0\] is not a number that can be estimated"):
        make_room(sensor, parse("bent.table_m[0]"))


@pytest.mark.parametrize(
    "text, message",
    [
        ("nobody.delay_s", "no link named 'nobody'"),
        ("body.lever_arm_m[0]", "Trajectory has no 'lever_arm_m'; it has .*delay_s"),
        ("platform.middle.angles_rad[0]", "no swing named 'middle'; there are left, right-2"),
        ("platform.left.angles_rad[3]", r"array there has shape \(3,\)"),
        ("platform.left.angles_rad", r"array there has shape \(3,\); name one of its entries"),
        ("body.delay_s[0]", r"array there has shape \(\)"),
        ("body.knots.max_gap_s", "not a number that can be estimated"),
        ("scan.axis", "not a number that can be estimated"),
        ("scan.sign", "not a number that can be estimated"),
        ("flu.axes", "not a number that can be estimated"),
        ("platform.left", "not a number that can be estimated"),
        ("body.knots.steps", "not a number that can be estimated"),
        # What is given: where the part was recorded, or what it is.
        ("body.knots.time_s[1]", "not a number that can be estimated"),
        ("wander.basis.time_s[0]", "not a number that can be estimated"),
        ("camera.nadir.along_sign", "not a number that can be estimated"),
        ("camera.nadir.half_width_px", "not a number that can be estimated"),
        ("camera.looks.sample_px[0]", "not a number that can be estimated"),
        # What is absent here is no zero: there is no value that leaves the sensor as it is.
        ("camera.frame.size_px[0]", "camera.frame.size_px"),
        ("camera.nadir.samples_px[0]", "camera.nadir.samples_px"),
        ("body.velocity_mps[0]", "body.velocity_mps"),
    ],
)
def test_what_cannot_be_estimated_is_refused(text, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        make_room(SENSOR, parse(text))


def test_many_numbers_are_put_at_once():
    texts = ["platform.left.angles_rad[2]", "camera.nadir.focal_px", "platform.left.angles_rad[0]", "camera.frame.focal_px[1]"]
    texts += ["camera.nadir.deformation_px[1,3]", "camera.nadir.deformation_px[0,0]"]
    addresses = [parse(t) for t in texts]
    sensor = SENSOR
    for address in addresses:
        sensor = make_room(sensor, address)
    values = [0.1, 1234.0, 0.3, 4321.0, 7.0, 8.0]
    changed = jax.jit(lambda v: put(sensor, addresses, list(v)))(np.array(values))
    assert [float(read(changed, a)) for a in addresses] == values
    np.testing.assert_array_equal(changed["platform"]["left"].angles_rad, [0.3, 2.0, 0.1])
    np.testing.assert_array_equal(changed["camera"]["frame"].focal_px, [1000.0, 4321.0])


def test_put_is_differentiable():
    address = parse("platform.left.angles_rad[1]")

    def entry(v):
        return put(SENSOR, [address], [v])["platform"]["left"].angles_rad

    np.testing.assert_array_equal(jax.jacfwd(entry)(5.0), [0, 1, 0])
    np.testing.assert_array_equal(jax.jacrev(entry)(5.0), [0, 1, 0])
