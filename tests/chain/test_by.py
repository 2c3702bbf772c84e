"""Options told apart by a key of the shot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from whiskjax.chain.chosen_camera import ChosenCamera
from whiskjax.rules.results import codes_of, is_successful

R = wj.RESULTS
ANGLES = {"left": np.array([0.1, 0.2, 0.3]), "right": np.array([-0.4, 0.5, 0.6])}
MOUNTS = {name: wj.Mount(angles_rad=a) for name, a in ANGLES.items()}
BY = wj.By("swing", MOUNTS)


def matrices(link, shot):
    return np.broadcast_to(link.pose(shot).matrix, (*np.shape(shot.swing), 3, 3))


def test_an_index_chooses_the_option_of_that_place():
    for i, mount in enumerate(MOUNTS.values()):
        np.testing.assert_array_equal(BY.pose(wj.Shot(swing=i)).matrix, mount.pose(wj.Shot()).matrix)


def test_an_array_of_indices_chooses_element_by_element():
    swing = np.array([[0, 1, 1], [1, 0, 0]])
    got = matrices(BY, wj.Shot(swing=swing))
    for i in np.ndindex(swing.shape):
        np.testing.assert_array_equal(got[i], BY.pose(wj.Shot(swing=int(swing[i]))).matrix)


def test_a_traced_index_chooses_under_jit_and_vmap():
    choose = jax.jit(jax.vmap(lambda swing: BY.pose(wj.Shot(swing=swing)).matrix))
    np.testing.assert_allclose(choose(jnp.array([1, 0])), matrices(BY, wj.Shot(swing=np.array([1, 0]))), rtol=0, atol=1e-16)


def test_a_known_index_chooses_before_tracing():
    """The other option leaves no trace: By costs nothing where the batch shares its key."""
    by = jax.make_jaxpr(
        lambda a, b: wj.By("swing", {"l": wj.Mount(angles_rad=a), "r": wj.Mount(angles_rad=b)}).pose(wj.Shot(swing=1)).rotation
    )
    alone = jax.make_jaxpr(lambda b: wj.Mount(angles_rad=b).pose(wj.Shot()).rotation)
    a = np.zeros(3)
    assert len(by(a, a).eqns) == len(alone(a).eqns)
    assert BY.chosen(wj.Shot(swing=1)) is BY["right"]
    assert BY.chosen(wj.Shot(swing=np.array([0, 1]))) is BY


def test_what_all_options_share_stays_structural():
    pose = BY.pose(wj.Shot(swing=np.array([0, 1])))
    assert pose.translation == (0, 0, 0)
    axes = wj.By("view", {"a": wj.Axes("x y z"), "b": wj.Axes("x -y -z")}).pose(wj.Shot(view=np.array([0, 1])))
    assert axes.rotation[0] == (1, 0, 0)
    np.testing.assert_array_equal(axes.matrix[:, 1, 1], [1, -1])


def test_options_may_be_options_themselves():
    inner = wj.By("view", {"nadir": wj.Mount(lever_arm_m=[1.0, 0, 0]), "back": wj.Mount(lever_arm_m=[2.0, 0, 0])})
    by = wj.By("swing", {"left": inner, "right": wj.Mount(lever_arm_m=[3.0, 0, 0])})
    shot = wj.Shot(swing=np.array([0, 0, 1]), view=np.array([0, 1, 1]))
    np.testing.assert_array_equal(by.pose(shot).translation[0], [1.0, 2.0, 3.0])
    assert by.chosen(wj.Shot(swing=0, view=1)) is inner["back"]


def test_unknown_keys_are_flagged_where_they_are_arrays_and_refused_where_they_are_not():
    result = BY.check(wj.Shot(swing=np.array([-1, 0, 1, 2])))
    np.testing.assert_array_equal(is_successful(result), [False, True, True, False])
    assert (codes_of(result)[[0, 3]] == codes_of(R.unknown_key)).all()
    for swing in (-1, 2):
        with pytest.raises(wj.WhiskjaxError, match=rf"swing {swing} does not exist; there are 0 to 1 \(left, right\)"):
            BY.pose(wj.Shot(swing=swing))


def test_the_check_of_the_chosen_option_counts():
    short = wj.Turn("x", wj.Encoder([0.0, 1.0], [0.0, 1.0], 2.0))
    long = wj.Turn("x", wj.Encoder([0.0, 9.0], [0.0, 1.0], 10.0))
    by = wj.By("view", {"short": short, "long": long})
    np.testing.assert_array_equal(
        is_successful(by.check(wj.Shot(time_s=np.array([5.0, 5.0]), view=np.array([0, 1])))), [False, True]
    )
    assert bool(by.check(wj.Shot(time_s=5.0, view=0)) == R.time_outside_trajectory)


def test_names_lead_to_options():
    assert BY["left"] is MOUNTS["left"]
    with pytest.raises(wj.WhiskjaxError, match="no swing named 'middle'; there are left, right"):
        BY["middle"]


def test_a_shot_without_the_key_is_refused_with_the_remedy():
    with pytest.raises(wj.WhiskjaxError, match=r"no swing, which tells left and right apart: Shot\(swing=\.\.\.\)"):
        BY.pose(wj.Shot(view=0))


@pytest.mark.parametrize("key, options, message", [("colour", MOUNTS, "not 'colour'"), ("view", {}, "at least one option")])
def test_a_wrong_by_is_refused(key, options, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        wj.By(key, options)


# Cameras as options.

DIRECTION = np.random.default_rng(1).normal([0.1, -0.2, -1.0], 0.1, (5, 3))
VIEW = np.array([0, 1, 1, 0, 1])


def looks(shift):
    sample = np.array([0.0, 10.0, 25.0])
    return wj.LookTable(sample, np.stack([0.02 * (sample + shift), 0.001 * sample**1.1, -np.ones(3)], -1))


CAMERAS = {
    "frame": (wj.FrameCamera(1000.0, (10.0, 20.0)), wj.FrameCamera(2000.0, (30.0, 40.0))),
    "line": (wj.LineCamera(1000.0, offset_px=5.0), wj.LineCamera(1500.0, offset_px=-7.0, across_sign=-1.0)),
    "looks": (looks(0.0), looks(3.0)),
    "zoom": (
        wj.FrameCamera([1000.0, 1100.0, 1200.0], (10.0, 20.0), per_image=True),
        wj.FrameCamera([2000.0, 2100.0, 2200.0], (30.0, 40.0), per_image=True),
    ),
}
IMAGE = np.array([0, 1, 2, 2, 1])


@pytest.mark.parametrize("kind", CAMERAS)
def test_cameras_are_chosen_element_by_element(kind):
    by = wj.By("view", dict(zip("ab", CAMERAS[kind], strict=True)))
    q = oracles.split(DIRECTION)
    mixed = by.at(wj.Shot(view=VIEW, image=IMAGE)).pixel(q)
    for i, view in enumerate(VIEW):
        alone = by.at(wj.Shot(view=int(view), image=int(IMAGE[i]))).pixel(tuple(DIRECTION[i]))
        np.testing.assert_allclose([m[i] for m in mixed], alone, rtol=1e-13)


def test_cameras_of_different_kinds_can_be_mixed():
    by = wj.By("view", {"frame": CAMERAS["frame"][0], "line": CAMERAS["line"][0]})
    q = (0.01, -0.02, -1.0)
    mixed = by.at(wj.Shot(view=np.array([1, 0, 1]))).pixel(q)
    for i, view in enumerate((1, 0, 1)):
        alone = by.at(wj.Shot(view=view)).pixel(q)
        np.testing.assert_allclose([m[i] for m in mixed], alone, rtol=1e-13)


MERGED = {
    "frame": CAMERAS["frame"],
    "line": CAMERAS["line"],
    "bent lines": (
        wj.LineCamera(1000.0, 50.0, deformation_px=np.full((2, 4), 0.3), half_width_px=60.0, samples_px=(0.0, 100.0), along="y"),
        wj.LineCamera(
            1500.0, 51.0, 9.0, deformation_px=np.full((2, 4), -0.4), half_width_px=55.0, samples_px=(5.0, 90.0), along="y"
        ),
    ),
}


@pytest.mark.parametrize("kind", MERGED)
def test_cameras_of_one_kind_are_one_camera(kind):
    """Their numbers are chosen instead of their answers: one image is taken, and the answers are the same."""
    cameras = MERGED[kind]
    merged = wj.By("view", dict(zip("ab", cameras, strict=True))).at(wj.Shot(view=VIEW))
    assert type(merged) is type(cameras[0])
    asked = ChosenCamera(jnp.asarray(VIEW), cameras)
    q = oracles.split(np.concatenate([DIRECTION[:4], [[0.1, 0.1, 1.0]]]))  # the last one lies behind the camera
    pixel = asked.pixel(q)
    np.testing.assert_allclose(merged.pixel(q), pixel, rtol=1e-14)
    for got, expected in zip(merged.direction(pixel), asked.direction(pixel), strict=True):
        np.testing.assert_allclose(np.broadcast_to(got, VIEW.shape), np.broadcast_to(expected, VIEW.shape), rtol=1e-14)
    results = codes_of(merged.check_direction(q))
    np.testing.assert_array_equal(results, codes_of(asked.check_direction(q)))
    assert (results != codes_of(R.successful)).tolist() == [False] * 4 + [True]
    np.testing.assert_array_equal(np.broadcast_to(merged.sees(pixel), 5), np.broadcast_to(asked.sees(pixel), 5))
    assert merged.is_line == asked.is_line
    if merged.is_line:
        np.testing.assert_allclose(merged.miss(q), asked.miss(q), rtol=1e-14)


def test_cameras_that_differ_in_what_they_hold_stay_apart():
    """One with a deformation, one without; a line along x, one along y."""
    plain = wj.LineCamera(1000.0)
    for other in (wj.LineCamera(1000.0, deformation_px=np.zeros((2, 4))), wj.LineCamera(1000.0, along="y")):
        assert type(wj.By("view", {"a": plain, "b": other}).at(wj.Shot(view=VIEW))) is ChosenCamera
