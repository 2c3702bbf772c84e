"""The seven instruments of design and README are lists of the same few links, and one pair of functions images through all."""

import importlib.util
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj

_FILE = pathlib.Path(__file__).parents[2] / "docs" / "seven_chains.py"
_SPEC = importlib.util.spec_from_file_location("seven_chains", _FILE)
assert _SPEC and _SPEC.loader
seven_chains = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(seven_chains)
SENSORS = seven_chains.sensors()
LINKS = (wj.Trajectory, wj.PosePerImage, wj.Mount, wj.Axes, wj.Turn, wj.By)
PIXELS = {"FrameCamera": (100.0, 50.0), "LineCamera": (321.0, 0.0), "LookTable": (123.0, 0.0)}


@pytest.mark.parametrize("name", SENSORS)
def test_one_pair_of_functions_images_through_all(name):
    sensor = SENSORS[name]
    assert all(isinstance(link, LINKS) for link in sensor.links)
    camera = sensor.camera.options[0] if isinstance(sensor.camera, wj.By) else sensor.camera
    pixel = np.array(PIXELS[type(camera).__name__])
    shot = wj.Shot(time_s=2.25, image=1, swing=1, view=1)
    ground = wj.image_to_ground(sensor, shot, pixel, wj.HeightSurface(200.0))
    _, _, height = wj.ecef_to_geodetic(ground.point_m)
    assert abs(float(height) - 200.0) < 1e-6
    np.testing.assert_allclose(wj.project(sensor, shot, ground.point_m).pixel_px, pixel, atol=1e-6)
    if camera.is_line:
        keys = wj.Shot(swing=1, view=1)
        found = wj.ground_to_image(sensor, keys, ground.point_m, (1.0, 4.0), clip=False)
        assert abs(float(found.time_s) - 2.25) < 1e-9
    jacobian = jax.jacfwd(lambda p: wj.project(sensor, shot, p).pixel_px)(jnp.asarray(ground.point_m))
    back = jax.jacrev(lambda p: wj.project(sensor, shot, p).pixel_px)(jnp.asarray(ground.point_m))
    np.testing.assert_allclose(jacobian, back, rtol=1e-9, atol=1e-12)


def test_the_picture_names_every_link():
    from whiskjax.show.chains import draw_chains

    figure = draw_chains(SENSORS)
    texts = [t.get_text() for t in figure.axes[0].texts]
    for sensor in SENSORS.values():
        for frame in sensor.names:
            assert f"to {frame}" in texts
