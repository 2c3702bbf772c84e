"""float32 is refused where it would be wrong without saying so."""

import jax
import numpy as np
import pytest

import whiskjax as wj

TIME_S = np.array([0.0, 1.0, 2.0])
POSITION_M = np.array([[6378137.0, 0.0, 0.0]] * 3)
QUATERNION = np.array([[0.0, 0.0, 0.0, 1.0]] * 3)


@pytest.fixture(scope="module")
def frame():
    """A frame camera 1 km above the equator, looking down: camera z along the outward x axis."""
    upright = np.array([[0.0, 0.5**0.5, 0.0, 0.5**0.5]])
    poses = wj.PosePerImage(POSITION_M[:1] + [1000.0, 0.0, 0.0], upright)
    return wj.Sensor({"body": poses}, wj.FrameCamera(1000.0, (500.0, 500.0)))


PIXEL = [500.0, 500.0]
SHOT = wj.Shot(image=0)
REFUSED = {
    "geodetic_to_ecef": lambda sensor: wj.geodetic_to_ecef(0.1, 0.2, 3.0),
    "ecef_to_geodetic": lambda sensor: wj.ecef_to_geodetic([6378137.0, 0.0, 0.0]),
    "ned_rotation": lambda sensor: wj.ned_rotation(0.1, 0.2),
    "enu_rotation": lambda sensor: wj.enu_rotation(0.1, 0.2),
    "Trajectory": lambda sensor: wj.Trajectory(TIME_S, POSITION_M, QUATERNION, max_gap_s=2.0),
    "PosePerImage": lambda sensor: wj.PosePerImage(POSITION_M, QUATERNION),
    "Encoder": lambda sensor: wj.Encoder(1.7e9 + TIME_S, TIME_S, 2.0),
    "LineTimes": lambda sensor: wj.LineTimes([0.0, 10.0], [1.7e9, 1.7e9 + 1]),
    "ray": lambda sensor: wj.ray(sensor, SHOT, PIXEL),
    "project": lambda sensor: wj.project(sensor, SHOT, POSITION_M[0]),
    "image_to_ground": lambda sensor: wj.image_to_ground(sensor, SHOT, PIXEL, wj.HeightSurface(0.0)),
    "ground_to_image": lambda sensor: wj.ground_to_image(sensor, SHOT, POSITION_M[0]),
    "intersect": lambda sensor: wj.intersect(sensor, wj.Shot(image=np.zeros(1, int)), np.array([PIXEL]), np.zeros(1, int)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_float32_is_refused_with_the_line_to_paste(name, frame):
    with jax.enable_x64(False):
        with pytest.raises(RuntimeError, match=r'jax\.config\.update\("jax_enable_x64", True\)') as caught:
            REFUSED[name](frame)
    assert name.lower() in str(caught.value).lower()


@pytest.mark.parametrize("name", [n for n in REFUSED if n != "intersect"])
def test_float64_is_accepted(name, frame):
    REFUSED[name](frame)
