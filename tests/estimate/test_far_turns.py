"""Axes that point elsewhere: an angle of 90 deg or so stands in for them, and the axes that would leave it small are named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.estimate.block.frames import POS, frames
from whiskjax.estimate.estimate import Estimate
from whiskjax.estimate.far_turns import far_turns
from whiskjax.flights import haian

CAMERA = wj.FrameCamera(3000.0, (0.0, 0.0))
SMALL_DEG = np.array([1.0, -2.0, 3.0])
BODY = wj.Trajectory(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0, 0, 1], (3, 1)), max_gap_s=2.0)


def matrix(axes):
    """Inner axis k lies along the k-th word."""
    found = np.zeros((3, 3))
    for k, word in enumerate(axes.split()):
        found["xyz".index(word[-1]), k] = -1 if word[0] == "-" else 1
    return found


def reason(answer):
    found = [one for one in answer.reasons if one.kind == "far from the start"]
    return found[0] if found else None


@pytest.fixture(scope="module")
def flight():
    return haian.simulate(4, truth=haian.draw_truth(jax.random.key(4)))


def free(flight):
    """Without priors of the angles, as somebody has them who does not know how the scanner is mounted."""
    return [
        wj.Unknown(x.name, x.where, scale=0.01) if x.name.startswith(("omega_pos", "phi_pos", "kappa_pos")) else x
        for x in flight.unknowns
    ]


def with_axes(sensor, axes):
    links = dict(zip(sensor.names, sensor.links, strict=True)) | {"flu": wj.Axes(axes)}
    return wj.Sensor(links, sensor.camera)


def test_axes_that_are_wrong_are_named(flight):
    """As flown x -y -z; given y x -z the mount of both swings turns by 90 deg, and the answer is sound but for this word."""
    observations = flight.observations()
    answer = wj.calibrate(with_axes(flight.sensor, "y x -z"), observations, free(flight), errors=flight.errors)
    found = reason(answer)
    assert found is not None and found.grade == "caution"
    assert {"kappa_pos_left", "kappa_pos_right"} <= set(found.figures["numbers"])
    assert found.figures["axes"] == {"flu": "x -y -z"} and 'axes = "x -y -z" of flu' in found.text
    assert 88 < abs(found.figures["angle_deg"][found.figures["numbers"].index("kappa_pos_left")]) < 92
    assert reason(wj.calibrate(flight.sensor, observations, free(flight), errors=flight.errors)) is None


def test_a_block_says_so_too():
    """The camera's axes are those of the photo; given as turned by a quarter, the mount turns back, 50 deg from its start."""
    sensor, block, _, truth = frames()
    links = {"photo": sensor["photo"], "back": wj.Axes("y -x z"), "mount": wj.Mount(angles_rad=np.radians([0.0, 0.0, -40.0]))}
    unknowns = [wj.Unknown(f"angle {i}", f"mount.angles_rad[{i}]", scale=0.01) for i in range(3)]
    found = wj.adjust(wj.Sensor(links, sensor.camera), block, unknowns, errors=POS, start_m=truth, max_steps=60)
    said = reason(found)
    assert said is not None and said.figures["axes"] == {"back": "x y z"} and said.figures["numbers"] == ["angle 2"]
    assert said.figures["angle_deg"][0] == pytest.approx(-50.0, abs=1.0)


@pytest.mark.parametrize("true", ["x -y -z", "-z y x", "y z x", "-x -y z"])
@pytest.mark.parametrize("given", ["x -y -z", "y x -z", "z x y"])
@pytest.mark.parametrize("where", ["before", "behind", "nowhere"])
def test_the_axes_leave_a_small_mount(true, given, where):
    """The whole rotation stays what it is, and what is left to the mount is within the small angles of its start."""
    small = Rotation.from_euler("XYZ", SMALL_DEG, degrees=True).as_matrix()
    whole = matrix(true) @ small if where != "behind" else small @ matrix(true)
    mounted = {
        "before": matrix(given).T @ whole,
        "behind": whole @ matrix(given).T,
        "nowhere": whole,
    }[where]
    angles = Rotation.from_matrix(mounted).as_euler("XYZ")
    links = {"body": BODY, "arm": wj.Mount(lever_arm_m=(0.1, 0.0, 0.0)), "mount": wj.Mount(angles_rad=np.zeros(3))}
    axes = {"axes": wj.Axes(given)}
    if where == "before":
        links = {"body": BODY, **axes, "arm": links["arm"], "mount": links["mount"]}
    elif where == "behind":
        links |= axes
    unknowns = [wj.Unknown(f"a{i}", f"mount.angles_rad[{i}]", scale=0.01) for i in range(3)]
    start = wj.Sensor(links, CAMERA)
    found = far_turns_of(wj.assign(start, unknowns, angles), unknowns)
    moved = {f"a{i}": np.degrees(a) for i, a in enumerate(angles) if abs(np.degrees(a)) > 20}
    assert {turn.name: np.degrees(turn.angle_rad) for turn in found} == pytest.approx(moved)
    for turn in found:
        assert turn.axes is not None and turn.is_new == (where == "nowhere")
        left = {
            "before": matrix(turn.axes).T @ whole,
            "behind": whole @ matrix(turn.axes).T,
            "nowhere": matrix(turn.axes).T @ whole,
        }[where]
        np.testing.assert_allclose(left, small, rtol=0, atol=1e-12)
        assert turn.frame == ("mount" if where == "nowhere" else "axes")


def far_turns_of(sensor, unknowns):
    k = len(unknowns)
    estimate = Estimate(
        value=np.zeros(k),
        covariance=np.eye(k),
        prior_share=np.zeros(k),
        cost=0.0,
        freedom=0,
        result=wj.RESULTS.successful,
        names=tuple(x.name for x in unknowns),
        places=tuple(x.places for x in unknowns),
    )
    return far_turns(sensor, estimate, np.zeros(k))


def test_an_angle_of_an_encoder_has_no_axes():
    """Its zero is off by 30 deg: said, with the number and the angle alone. And a whole turn is none."""
    encoder = wj.Encoder(np.arange(3.0), np.zeros(3), 2.0)
    sensor = wj.Sensor({"body": BODY, "scan": wj.Turn("x", encoder)}, CAMERA)
    (zero,) = [wj.Unknown("zero", "scan.zero_rad", scale=0.01)]
    for angle, expected in ((30.0, 30.0), (-150.0, -150.0), (350.0, None), (19.0, None)):
        found = far_turns_of(wj.assign(sensor, [zero], jnp.radians(jnp.array([angle]))), [zero])
        assert [np.degrees(turn.angle_rad) for turn in found] == pytest.approx([] if expected is None else [expected])
        assert all(turn.axes is None for turn in found)


def test_angles_are_counted_from_the_start(flight):
    """With the same wrong axes, and mounts that start at the quarter turn that makes up for them, nothing ends far."""
    numbers = [x for x in free(flight) if x.name.startswith("kappa_pos")]
    begun = wj.assign(with_axes(flight.sensor, "y x -z"), numbers, np.radians([90.0, 90.0]))
    answer = wj.calibrate(begun, flight.observations(), free(flight), errors=flight.errors)
    assert reason(answer) is None and np.degrees(answer.value[5]) == pytest.approx(90.0, abs=2.0)
