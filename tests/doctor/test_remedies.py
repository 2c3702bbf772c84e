"""Every remedy by itself: what it changes, against code that shares nothing with it, and that no two are called alike."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.doctor.scenes import SIMULATED
from tests.doctor.spoils import attitudes, is_cure, named, recorded
from whiskjax.chain.mounts import CONVENTIONS
from whiskjax.doctor.conventions import conventions
from whiskjax.doctor.poses import about, omega_phi_kappa, roll_pitch_heading
from whiskjax.doctor.robust import Rows, fit
from whiskjax.doctor.uniform import uniform

EXACT = [
    "sign of roll",
    "sign of pitch",
    "sign of heading",
    "signs of roll and pitch",
    "roll and pitch exchanged",
    "heading from east",
    "transposed rotations",
    "coordinates exchanged",
    "images 18 s late",
    "POS 1 s late",
    "encoders 2 s early",
    "encoder sign",
    "half an encoder's angle",
]


@pytest.fixture(scope="module", params=["haian", "tianshan", "songshan"])
def flight(request):
    return SIMULATED[request.param]()


def test_names_differ(flight):
    names = [r.name for r in conventions(flight)]
    assert len(set(names)) == len(names)


def test_there_are_24_conventions_of_axes():
    matrices = {np.asarray(wj.Axes(axes).pose(wj.Shot()).matrix).tobytes() for axes in CONVENTIONS}
    assert len(CONVENTIONS) == len(matrices) == 24


@pytest.mark.parametrize("mistake", EXACT)
def test_remedy_undoes_the_mistake(flight, mistake):
    """Pixels come back to rounding."""
    spoil = named(mistake)
    spoiled = spoil.make(flight)
    if spoiled is None:
        assert mistake in (
            "coordinates exchanged",
            "POS 1 s late",
            "encoders 2 s early",
            "encoder sign",
            "half an encoder's angle",
        )
        return
    remedies = [r for r in conventions(spoiled) if is_cure(spoil, r.name)]
    o = flight.observations()
    pixel = np.asarray(wj.project(flight.sensor, o.shot, o.point_m).pixel_px)
    cured = [r.apply(spoiled) for r in remedies]
    again = [wj.project(c.sensor, (s := c.observations()).shot, s.point_m, throw=False).pixel_px for c in cured]
    away = [np.abs(np.asarray(a) - pixel).max() for a in again]
    assert np.nanmin(away) < 1e-4  # px: quaternions and ECEF coordinates to rounding, at focal lengths of 1e4 to 1e5 px


def test_uniform_flights_image_alike(flight):
    """Axes and signs as numbers are the same chain."""
    turned = dataclasses.replace(flight, sensor=_with_negative_turns(flight.sensor))
    o = flight.observations()
    for each in (flight, turned):
        pixel = np.asarray(wj.project(each.sensor, o.shot, o.point_m, throw=False).pixel_px)
        same = np.asarray(wj.project(uniform(each).sensor, o.shot, o.point_m, throw=False).pixel_px)
        # Behind turns with the other sign some looks are nearly in the focal plane, millions of pixels out: there rounding of the
        # direction moves the pixel by as much more as its square.
        np.testing.assert_allclose((same - pixel) / (1 + (pixel / 1e4) ** 2), 0 * pixel, rtol=0, atol=1e-6)


def _with_negative_turns(sensor):
    def other(link):
        return wj.Turn(link.axis, link.encoder, -link.sign) if isinstance(link, wj.Turn) else link

    links = {n: other(x) for n, x in zip(sensor.names, sensor.links, strict=True)}
    return wj.Sensor(links, sensor.camera, sensor.refraction)


def test_angles_are_those_of_scipy():
    r = Rotation.random(50, rng=np.random.default_rng(5))
    roll, pitch, heading = roll_pitch_heading(r.as_matrix())
    np.testing.assert_allclose(np.stack([heading, pitch, roll], axis=-1), r.as_euler("ZYX"), atol=1e-12)
    np.testing.assert_allclose(np.stack(omega_phi_kappa(r.as_matrix()), axis=-1), r.as_euler("XYZ"), atol=1e-12)
    angle = np.linspace(-3, 3, 7)
    for axis in "xyz":
        np.testing.assert_allclose(about(axis, angle), Rotation.from_euler(axis, angle[:, None]).as_matrix(), atol=1e-15)


def test_attitudes_of_spoils_come_back(flight):
    """The helper of the tests is right: no change changes nothing."""
    same = attitudes(flight, lambda r: r)
    for a, b in zip(recorded(flight), recorded(same), strict=True):
        q, p = (np.stack([np.asarray(c) for c in x.quaternion], axis=-1) for x in (a, b))
        np.testing.assert_allclose(np.abs((q * p).sum(axis=1)), 1, atol=1e-12)


def test_robust_fit_is_not_pulled_by_blunders():
    """A line through points of which a third lie anywhere, from a start far off."""
    rng = np.random.default_rng(3)
    t = rng.uniform(-1, 1, (60, 2))
    truth = np.array([3.0, -200.0])
    seen = truth[0] + truth[1] * t + rng.normal(size=t.shape)
    seen[:20] += rng.uniform(-1000, 1000, (20, 2))

    def of(x):
        by = np.stack([-np.ones_like(t), -t], axis=-1)
        return Rows(seen - x[0] - x[1] * t, by, 1e-6 * x, 1e-6 * np.eye(2))

    found = fit(of, np.array([0.0, 5000.0]), np.ones(60, dtype=bool), 60)
    np.testing.assert_allclose(found.x, truth, atol=1.0)
