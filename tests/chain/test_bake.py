"""A baked sensor images alike, whatever stays free."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests import oracles
from whiskjax.algebra.vectors import stack
from whiskjax.chain.bake import ready
from whiskjax.chain.imaging import image, sight
from whiskjax.chain.link import Given

TIME_S = np.linspace(0, 5, 11)
BODY = wj.Trajectory(
    TIME_S,
    np.linspace([0, 0, 1000.0], [300, 50, 1010.0], 11),
    np.stack([0.01 * TIME_S, 0.02 * TIME_S, 0 * TIME_S, 1 + 0 * TIME_S], -1),
    max_gap_s=1.0,
)
SENSOR = wj.Sensor(
    {
        "body": BODY,
        "arm": wj.Mount([0.3, 0.2, 0.1]),
        "platform": wj.By("swing", {"left": wj.Mount(angles_rad=[0.01, 0, 0]), "right": wj.Mount(angles_rad=[0, 0.02, 0])}),
        "scan": wj.Turn("x", wj.Encoder(TIME_S, 0.1 * np.sin(TIME_S), 1.0)),
    },
    wj.LineCamera(1000.0),
)
N = 6
RNG = np.random.default_rng(61)
SHOTS = wj.Shot(time_s=RNG.uniform(0.5, 4.5, N), swing=np.array([0, 1, 0, 1, 1, 0]))
POINTS = tuple(RNG.normal([100.0, 0, 0], 50.0, (N, 3)).T)
PIXELS = tuple(RNG.normal(0, 100.0, (N, 2)).T)
FREE = [set(c) for size in range(5) for c in itertools.combinations(SENSOR.names, size)]


@pytest.fixture(scope="module")
def plain():
    return stack(image(SENSOR, SHOTS, POINTS)), [stack(v) for v in sight(SENSOR, SHOTS, PIXELS)]


@pytest.mark.parametrize("free", FREE, ids=lambda f: "+".join(sorted(f)) or "none")
def test_a_baked_sensor_images_alike_for_any_free_links(plain, free):
    sensor, shots = wj.bake(SENSOR, SHOTS, free)
    # Nanometres at 1 km.
    np.testing.assert_allclose(stack(image(sensor, shots, POINTS)), plain[0], rtol=0, atol=1e-9)
    for got, expected in zip(sight(sensor, shots, PIXELS), plain[1], strict=True):
        np.testing.assert_allclose(stack(got), expected, rtol=1e-12, atol=1e-9)
    # Free links stay what they were; all others are given, and no two given ones are neighbours.
    given = [isinstance(link, Given) for link in sensor.links]
    assert {name for name, g in zip(sensor.names, given, strict=True) if not g} == free
    assert not any(a and b for a, b in itertools.pairwise(given))
    assert sensor.names[-1] == SENSOR.names[-1]
    assert len(shots.poses) == sum(given)


def test_named_joints_survive():
    sensor, shots = wj.bake(SENSOR, SHOTS, (), joints=("body", "platform"))
    assert sensor.names == ("body", "platform", "scan")
    assert len(shots.poses) == 3
    np.testing.assert_allclose(stack(image(sensor, shots, POINTS)), stack(image(SENSOR, SHOTS, POINTS)), rtol=0, atol=1e-9)
    for joint in ("body", "platform"):
        np.testing.assert_allclose(sensor.pose(shots, joint).origin_m, SENSOR.pose(SHOTS, joint).origin_m, rtol=0, atol=1e-9)


def test_the_camera_may_be_free_too():
    sensor, _ = wj.bake(SENSOR, SHOTS, ("camera", "scan"))
    assert sensor.camera is SENSOR.camera
    assert sensor.names == ("platform", "scan")


def test_what_is_baked_is_batched_in_the_shots_and_the_sensor_is_not():
    sensor, shots = wj.bake(SENSOR, SHOTS, ("platform",))
    one_by_one = jax.vmap(lambda shot, x, y, z: stack(image(sensor, shot, (x, y, z))))(
        jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a), (N,)), shots), *POINTS
    )
    np.testing.assert_allclose(one_by_one, stack(image(SENSOR, SHOTS, POINTS)), rtol=0, atol=1e-9)


def test_derivatives_with_respect_to_a_free_link_are_those_of_the_whole_chain():
    def pixels(sensor, shots):
        def f(angles):
            option = dataclasses.replace(sensor["platform"]["right"], angles_rad=angles)
            by = wj.By("swing", {"left": sensor["platform"]["left"], "right": option})
            links = {n: by if n == "platform" else link for n, link in zip(sensor.names, sensor.links, strict=True)}
            return stack(image(wj.Sensor(links, sensor.camera), shots, POINTS))

        return jax.jit(jax.jacfwd(f))(jnp.array([0.0, 0.02, 0.0]))

    whole, baked = pixels(SENSOR, SHOTS), pixels(*wj.bake(SENSOR, SHOTS, ("platform",)))
    assert np.abs(whole).max() > 100
    np.testing.assert_allclose(baked, whole, rtol=0, atol=1e-8)


def test_an_unknown_name_is_refused():
    for names in ({"free": ("nobody",)}, {"free": (), "joints": ("nobody",)}):
        with pytest.raises(wj.WhiskjaxError, match="no link named 'nobody'"):
            wj.bake(SENSOR, SHOTS, **names)


def test_the_doors_take_a_baked_sensor():
    sensor, shots = wj.bake(SENSOR, SHOTS, ("scan",))
    got = wj.project(sensor, shots, oracles.array(POINTS)).pixel_px
    np.testing.assert_allclose(got, wj.project(SENSOR, SHOTS, oracles.array(POINTS)).pixel_px, rtol=0, atol=1e-9)


READY = [set(), {"body"}, {"scan"}, {"arm", "scan"}, set(SENSOR.names)]


@pytest.mark.parametrize("free", READY, ids=lambda f: "+".join(sorted(f)) or "none")
def test_a_sensor_made_ready_images_alike_and_keeps_all_frames(plain, free):
    sensor, shots = ready(SENSOR, SHOTS, free)
    assert sensor.names == SENSOR.names and sensor.camera is SENSOR.camera
    assert {name for name, link in zip(sensor.names, sensor.links, strict=True) if not isinstance(link, Given)} == free
    np.testing.assert_allclose(stack(image(sensor, shots, POINTS)), plain[0], rtol=0, atol=1e-9)
    for got, expected in zip(sight(sensor, shots, PIXELS), plain[1], strict=True):
        np.testing.assert_allclose(stack(got), expected, rtol=1e-12, atol=1e-9)
    for name in SENSOR.names:
        np.testing.assert_allclose(sensor.pose(shots, name).origin_m, SENSOR.pose(SHOTS, name).origin_m, rtol=0, atol=1e-9)


def test_what_is_made_ready_is_batched_in_the_shots():
    sensor, shots = ready(SENSOR, SHOTS, ("platform",))
    one_by_one = jax.vmap(lambda shot, x, y, z: stack(image(sensor, shot, (x, y, z))))(
        jax.tree.map(lambda a: jnp.broadcast_to(jnp.asarray(a), (N,)), shots), *POINTS
    )
    np.testing.assert_allclose(one_by_one, stack(image(SENSOR, SHOTS, POINTS)), rtol=0, atol=1e-9)


def test_a_sensor_made_ready_asks_for_no_more_sines():
    def sines(sensor, shots):
        text = str(jax.make_jaxpr(lambda x, y, z: image(sensor, shots, (x, y, z)))(*POINTS))
        return text.count("_polynomials")

    turning = wj.Sensor({"body": BODY, "scan": SENSOR["scan"]}, SENSOR.camera)
    assert sines(turning, SHOTS) > 0
    assert sines(*ready(turning, SHOTS, ())) == 0
