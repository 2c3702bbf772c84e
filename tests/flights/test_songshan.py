"""The simulated three-line camera: rays against a textbook loop, errors against their model, counts against the scenario."""

import dataclasses
import math

import jax
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation, Slerp

import whiskjax as wj
from whiskjax.flights import songshan, songshan_draw

SMALL = {"ties": 300, "pos_hz": 20.0}
A, B = songshan.Scene("A", **SMALL), songshan.Scene("B", **SMALL)


@pytest.fixture(scope="module", params=[A, B], ids="AB")
def drawn(request):
    return request.param, songshan.simulate_block(request.param, 3)


def entries(block):
    """Which (point, strip) each ray belongs to, and the pairs."""
    pairs, index = np.unique(np.stack([block.point, block.key("strip")], axis=1), axis=0, return_inverse=True)
    return pairs, index.ravel()


class Textbook:
    """The imaging chain of Wang et al. (2018) once more, for one point at a time: the true poses' samples, scipy's rotations."""

    def __init__(self, body):
        self.time = np.asarray(body.knots.time_s)
        self.position = np.stack([np.asarray(c) for c in body.position_m], axis=-1)
        self.attitude = Slerp(self.time, Rotation.from_quat(np.stack([np.asarray(q) for q in body.quaternion], axis=-1)))
        # Angles of Table 3 (mean): R_c^b = Rx(ex) Ry(ey) Rz(ez), and the antenna at u seen from the projection centre.
        degrees = (-0.07614977683, -0.06546708276, -0.01759787143)
        self.boresight = Rotation.from_euler("XYZ", degrees, degrees=True)
        self.arm = np.array([0.0075601137, 0.0059411685, -0.01626891418])
        self.front_left_up = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
        self.line = {}
        for view, angle, a, b in (
            ("forward", 27.0, (5, 9, 4, -2), (-3, 3, 2, 1.5)),
            ("nadir", 0.0, (0, 0, 3, 1.5), (0, 2, -2, 1)),
            ("backward", -14.0, (-6, -8, -3, 2), (4, -3, 1, -1.5)),
        ):
            sample = np.linspace(0, 32755, 1025)
            y = sample - 16377.5
            x = np.full_like(y, 26000 * math.tan(math.radians(angle)))
            q = np.hypot(x, y) / 20000
            scale, s = 0.0030 + 3.0e-4 * q**2 - 1.5e-4 * q**4, y / 16377.5
            dx = x * scale + sum(c * s**k for k, c in enumerate(a)) + 0.25 * np.sin(2 * np.pi * y / 4000)
            dy = y * scale + sum(c * s**k for k, c in enumerate(b)) + 0.25 * np.cos(2 * np.pi * y / 4000)
            self.line[view] = sample, x + dx, y + dy

    def beside(self, view, point, t):
        """Sample of a point, and how far beside the line it is imaged, in pixels of the focal plane."""
        antenna = np.array([np.interp(t, self.time, c) for c in self.position.T])
        camera = self.attitude(t) * self.front_left_up * self.boresight
        centre = antenna - camera.apply(self.arm)  # equation 9
        q = camera.inv().apply(point - centre)
        x, y = -26000 * q[0] / q[2], -26000 * q[1] / q[2]
        sample, line_x, line_y = self.line[view]
        return np.interp(y, line_y, sample), x - np.interp(y, line_y, line_x)

    def image(self, view, point, start, stop):
        """Sample, and the time when the point is on the line."""
        t = brentq(lambda t: self.beside(view, point, t)[1], start, stop, xtol=1e-14, rtol=1e-14)
        return self.beside(view, point, t)[0], t


def noise_free(scene, drawn):
    """Samples and times of all rays, by the line search."""
    strip = drawn.block.key("strip")
    start = songshan.start_s(len(scene.data.strips))[strip]
    shot = wj.Shot(view=drawn.block.key("view"))
    return wj.ground_to_image(drawn.truth, shot, drawn.point_m[drawn.block.point], (start, start + songshan.STRIP_S))


def test_rays_against_a_textbook(drawn):
    scene, d = drawn
    found = noise_free(scene, d)
    textbook = Textbook(d.truth["body"])
    rays = np.random.default_rng(0).choice(len(d.block), 15, replace=False)
    for i in rays:
        start = songshan.start_s(len(scene.data.strips))[d.block.key("strip")[i]]
        view = songshan.VIEWS[d.block.key("view")[i]]
        sample, t = textbook.image(view, d.point_m[d.block.point[i]], start, start + songshan.STRIP_S)
        assert abs(sample - float(found.pixel_px[i, 0])) < 1e-6
        assert abs(t - float(found.time_s[i])) / songshan.LINE_S < 1e-6


def test_measured_is_imaged_plus_noise(drawn):
    """Errors of sample and line are white with the scene's sigma: the mean square within four sigma of one."""
    scene, d = drawn
    found, block = noise_free(scene, d), d.block
    error = np.stack(
        [
            block.pixel_px[:, 0] - np.asarray(found.pixel_px[:, 0]),
            (block.key("time_s") - np.asarray(found.time_s)) / songshan.LINE_S,
        ],
        axis=-1,
    )
    np.testing.assert_array_equal(block.pixel_px[:, 1], 0.0)
    for role, sigma in (("tie", 0.5), (("control", "check"), 0.3)):
        here = np.isin(block.role[block.point], role)
        np.testing.assert_array_equal(block.sigma_px[here, 0], sigma)
        normal = error[here] / sigma
        np.testing.assert_allclose((normal**2).mean(axis=0), 1.0, rtol=0, atol=4 * math.sqrt(2 / here.sum()))
        assert abs((normal[:, 0] * normal[:, 1]).mean()) < 4 / math.sqrt(here.sum())


def test_a_line_is_known_by_the_local_rate(drawn):
    """Its sigma is stated in pixels across the line, by how far the textbook's image goes on in the time of a line.

    Both by the recorded poses, whose errors change from sample to sample by as much as 1 % of the rate; what is left is the
    mounts, and the detector's scale of 0.003.
    """
    _, d = drawn
    textbook, time, rates = Textbook(d.sensor["body"]), np.asarray(d.block.key("time_s")), []
    for i in np.random.default_rng(1).choice(len(d.block), 40, replace=False):
        view, point = songshan.VIEWS[d.block.key("view")[i]], d.point_m[d.block.point[i]]
        before, after = (textbook.beside(view, point, time[i] + side * songshan.LINE_S / 2)[1] for side in (-1, 1))
        rates.append(abs(after - before))
        assert d.block.sigma_px[i, 1] / d.block.sigma_px[i, 0] == pytest.approx(rates[-1], rel=0.003)
    assert max(rates) > 1.3 * min(rates)


COUNTS = {"A": (70, 50, 20, 21), "B": (54, 40, 14, 5)}


def test_counts_of_the_scenario(drawn):
    scene, d = drawn
    block = d.block
    points, control, check, several = COUNTS[scene.name]
    assert [int((block.role == role).sum()) for role in ("control", "check", "tie")] == [control, check, scene.ties]
    pairs, index = entries(block)
    np.testing.assert_array_equal(np.bincount(index), 3)  # all three views of a strip, once
    assert len(set(zip(index.tolist(), block.key("view").tolist(), strict=True))) == len(block)
    strips = np.bincount(pairs[:, 0], minlength=len(block.role))
    assert strips.min() == 1 and int((strips[:points] > 1).sum()) == several
    assert np.isnan(block.position_m[points:]).all()
    assert np.abs(d.point_m[:, :2]).max() <= 4000
    surveyed = (block.position_m - d.point_m)[:points] / (0.002, 0.002, 0.010)
    np.testing.assert_allclose((surveyed**2).mean(axis=0), 1.0, rtol=0, atol=4 * math.sqrt(2 / points))


def test_rays_of_a_tie_point(drawn):
    """About 68,500 and 29,000 rays in all: 4.82 and 3.27 for each tie point; 300 of them say so within 6 %."""
    scene, d = drawn
    each = {"A": (68_500 - 300) / 14_157, "B": (29_000 - 177) / 8_802}[scene.name]
    assert (d.block.role[d.block.point] == "tie").sum() / scene.ties == pytest.approx(each, rel=0.06)


def test_same_seed_same_draw():
    first, again, other = (songshan.simulate_block(B, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.block.pixel_px, again.block.pixel_px)
    np.testing.assert_array_equal(first.block.key("time_s"), again.block.key("time_s"))
    np.testing.assert_array_equal(first.point_m, again.point_m)
    assert not np.isin(other.block.pixel_px[:, 0], first.block.pixel_px[:, 0]).any()


def test_fewer_ties_leave_everything_else():
    """The rays of the smaller block are the first ones of the larger."""
    many, few = songshan.simulate_block(B, 5), songshan.simulate_block(dataclasses.replace(B, ties=25), 5)
    rays, points = len(few.block), len(few.block.role)
    assert points == 54 + 25
    np.testing.assert_array_equal(many.block.role[:points], few.block.role)
    np.testing.assert_array_equal(many.block.position_m[:points], few.block.position_m)
    np.testing.assert_array_equal(many.block.point[:rays], few.block.point)
    np.testing.assert_allclose(many.block.pixel_px[:rays], few.block.pixel_px, rtol=0, atol=1e-7)
    for a, b in zip(many.truth["body"].position_m, few.truth["body"].position_m, strict=True):
        np.testing.assert_array_equal(a, b)


def bodies(seed, scene):
    """Recorded and true poses of a flight: positions (n, 3), and attitudes."""
    drawn = songshan.draw(jax.random.key(seed), scene, point_m=np.zeros((1, 3)))
    both = [sensor["body"] for sensor in (drawn.sensor, drawn.truth)]
    return [(np.stack(b.position_m, axis=-1), Rotation.from_quat(np.stack(b.quaternion, axis=-1))) for b in both]


def test_errors_of_pos():
    """Recorded minus true over 40 flights: sigmas of the scenario. Vibration is in the truth alone."""
    shifts, turns = [], []
    for seed in range(40):
        (recorded_m, recorded), (true_m, true) = bodies(seed, dataclasses.replace(A, pos_hz=0.2))
        shifts.append(true.inv().apply(recorded_m - true_m))
        turns.append(np.degrees((true.inv() * recorded).as_rotvec()))
    # Some 160 independent positions and 300 independent attitudes: four sigma.
    np.testing.assert_allclose(np.sqrt((np.array(shifts) ** 2).mean(axis=(0, 1))), (0.05, 0.05, 0.08), rtol=0.23)
    expected = np.hypot((0.005, 0.005, 0.010), 0.0007)
    np.testing.assert_allclose(np.sqrt((np.array(turns) ** 2).mean(axis=(0, 1))), expected, rtol=0.17)

    (still, shaken) = (bodies(0, dataclasses.replace(B, noise=noise, pos_hz=5.0)) for noise in ("nominal", "paper-like"))
    np.testing.assert_array_equal(still[0][1].as_quat(), shaken[0][1].as_quat())
    # Three times the vibration less once the same: 380 s know it to 5 %.
    np.testing.assert_allclose(np.degrees((still[1][1].inv() * shaken[1][1]).as_rotvec()).std(axis=0), 0.0014, rtol=0.2)


def test_direct_positioning():
    """scenarios.md: RMSE 2.78/2.75/8.05 m; single strips, all points. Heights are too low, as in the paper (mean -6.93 m)."""
    d = songshan.simulate_block(A, 0)
    block = d.block.keep(d.block.role[d.block.point] != "tie")
    pairs, index = entries(block)
    found = wj.intersect(d.sensor, block.shot, block.pixel_px, index, block.sigma_px)
    error = np.asarray(found.point_m) - block.position_m[pairs[:, 0]]
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0)), (2.78, 2.75, 8.05), rtol=0.12)
    assert error[:, 2].mean() < -7
    # With the detector as it lies and the true mounts, POS alone is left: the third direct positioning.
    links = dict(zip(d.sensor.names, d.sensor.links, strict=True)) | {n: d.truth[n] for n in ("boresight", "lever")}
    found = wj.intersect(wj.Sensor(links, d.truth.camera), block.shot, block.pixel_px, index, block.sigma_px)
    error = np.sqrt(((np.asarray(found.point_m) - block.position_m[pairs[:, 0]]) ** 2).mean(axis=0))
    assert (error < (0.30, 0.30, 0.45)).all()


@pytest.mark.parametrize("name", "AB")
def test_strips_are_flown_straight_ahead(name):
    """60 m/s at 2450 m over the middle of the field, two and two in opposite directions; body x ahead, z down within a degree."""
    true = songshan.Path.draw(jax.random.key(0)).recorded(songshan.DATA[name].strips, 20.0)
    ways = [(1, 0, 1), (-1, 0, -1), (0, 1, -1), (0, -1, 1)][: len(songshan.DATA[name].strips)]
    for start, (east, north, beside) in zip(songshan.start_s(len(ways)), ways, strict=True):
        t = start + np.array([0.0, 95.0, 190.0])
        pose = true.pose(wj.Shot(time_s=t))
        middle = np.array([abs(north), abs(east), 0]) * beside * {"A": 875, "B": 1050}[name] + (0, 0, 2450)
        np.testing.assert_allclose(pose.origin_m, middle + np.outer((-5700, 0, 5700), (east, north, 0)), rtol=0, atol=1e-6)
        np.testing.assert_allclose(pose.matrix[:, :, 0], np.broadcast_to((east, north, 0), (3, 3)), rtol=0, atol=0.02)
        np.testing.assert_allclose(pose.matrix[:, :, 2], np.broadcast_to((0, 0, -1), (3, 3)), rtol=0, atol=0.02)


@pytest.mark.parametrize("spacing_s", [4.0, 7.0, 60.0])
@pytest.mark.parametrize("basis", ["orientation images", "spline"])
def test_nodes_reach_over_all_strips(basis, spacing_s):
    scene = songshan.Scene("B", basis=basis, spacing_s=spacing_s)
    body = songshan.Path.draw(jax.random.key(0)).recorded(scene.data.strips, 1.0)
    start = songshan.start_s(2)
    wj.ray(songshan.sensor(scene, body), wj.Shot(time_s=np.append(start, start + 190.0), view=1), np.zeros((4, 2)))


def test_unknowns_have_places():
    scene = songshan.Scene("B", drift=True)
    body = songshan.Path.draw(jax.random.key(0)).recorded(scene.data.strips, 1.0)
    unknowns = songshan.unknowns(scene)
    names = [unknown.name for unknown in unknowns]
    assert len(set(names)) == 6 + (24 - 3) + 2 * 2 * 3
    assert not set(songshan.GAUGE) & set(names) and "a2_nadir" in names
    assert len(songshan.unknowns(songshan.Scene("B"))) == 27
    filled = wj.assign(songshan.sensor(scene, body), unknowns, np.arange(len(unknowns)) + 1.0)
    np.testing.assert_array_equal(filled["lever"].lever_arm_m, [1, 2, 3])
    np.testing.assert_array_equal(filled["boresight"].angles_rad, [4, 5, 6])
    # Row 0 along the line (b), row 1 across it (a).
    np.testing.assert_array_equal(filled["camera"]["forward"].deformation_px, [[11, 12, 13, 14], [7, 8, 9, 10]])
    np.testing.assert_array_equal(filled["camera"]["nadir"].deformation_px, [[0, 17, 18, 19], [0, 0, 15, 16]])


def test_cubics_follow_the_detector():
    """The model's sign and directions: a fitted cubic leaves the wave (0.18 px RMS) and little of r^5."""
    sample = np.linspace(0, 32755, 500)
    s = sample / 16377.5 - 1
    for view in songshan.VIEWS:
        fitted = [np.polynomial.polynomial.polyfit(s, d, 3) for d in songshan_draw.deformation_px(view, sample)]
        camera = dataclasses.replace(
            songshan.sensor(B, songshan.Path.draw(jax.random.key(0)).recorded(B.data.strips, 1.0)).camera[view],
            deformation_px=np.array([fitted[1], fitted[0]]),
        )
        looks = songshan_draw.detector(view).direction((sample, np.zeros(500)))
        x, y, z = (np.broadcast_to(np.asarray(c, dtype=float), 500) for c in looks)
        pixel = np.stack(camera.pixel((x, y, z)), axis=-1) - np.stack([sample, np.zeros(500)], axis=-1)
        assert np.abs(pixel).max() < 0.45
        np.testing.assert_allclose(np.sqrt((pixel**2).mean(axis=0)), 0.177, rtol=0.2)


def test_the_wave_is_what_the_cubics_lack():
    """With waves of 0.25 px, sine across the line and cosine along it, the camera is the detector but for a little of r^5."""
    sample = np.linspace(0, 32755, 500)
    wave = [(np.sin, np.cos)[i](2 * np.pi * (sample - 16377.5) / 4000) for i in (0, 1)]
    names = [x.name for x in songshan.wave_unknowns()]
    assert names[:4] == ["wave_as_forward", "wave_ac_forward", "wave_bs_forward", "wave_bc_forward"] and len(names) == 12
    recorded = songshan.sensor(B, songshan.Path.draw(jax.random.key(0)).recorded(B.data.strips, 1.0))
    waved = wj.assign(recorded, songshan.wave_unknowns(), np.tile([0.25, 0.0, 0.0, 0.25], 3)).camera
    for view in songshan.VIEWS:
        dx, dy = songshan_draw.deformation_px(view, sample)
        s, smooth = sample / 16377.5 - 1, (dy - 0.25 * wave[1], dx - 0.25 * wave[0])
        cubic = [np.polynomial.polynomial.polyfit(s, d, 3) for d in smooth]
        left = np.stack([np.polynomial.polynomial.polyval(s, c) - d for c, d in zip(cubic, smooth, strict=True)], axis=-1)
        camera = dataclasses.replace(waved[view], deformation_px=np.array(cubic))
        looks = songshan_draw.detector(view).direction((sample, np.zeros(500)))
        x, y, z = (np.broadcast_to(np.asarray(c, dtype=float), 500) for c in looks)
        pixel = np.stack(camera.pixel((x, y, z)), axis=-1) - np.stack([sample, np.zeros(500)], axis=-1)
        # Sample and line exchange (1 + slope): the cubics' slopes are 0.004 px to a px, and the table is linear.
        np.testing.assert_allclose(pixel, left * (-1, -1), rtol=0, atol=3e-3)


@pytest.mark.parametrize("basis", ["orientation images", "spline"])
def test_folder_and_back(tmp_path, basis):
    scene = dataclasses.replace(B, basis=basis, drift=True)
    flight = songshan.simulate(scene, 1)
    back = wj.read_flight(wj.write_flight(flight, tmp_path / "flight"))
    assert [image.name for image in back.images][:4] == ["east-forward", "east-nadir", "east-backward", "west-forward"]
    block = songshan.simulate_block(scene, 1).block
    for found in (flight.block(), back.block()):
        np.testing.assert_allclose(found.key("time_s"), block.key("time_s"), rtol=0, atol=1e-11)
        for name in ("view", "strip"):
            np.testing.assert_array_equal(found.key(name), block.key(name))
        np.testing.assert_array_equal(found.pixel_px, block.pixel_px)
        np.testing.assert_array_equal(found.sigma_px, block.sigma_px)
        np.testing.assert_array_equal(found.position_m, block.position_m)
        known = block.role != "tie"
        np.testing.assert_allclose(found.covariance_m2[known], block.covariance_m2[known], rtol=1e-12)
        assert list(found.role) == list(block.role) and list(found.points) == list(block.points)
    bases = [f.sensor["pos_error"].basis for f in (flight, back)]
    assert type(bases[0]) is type(bases[1]) and bases[0].nodes == bases[1].nodes
    np.testing.assert_array_equal(bases[0].node_s, bases[1].node_s)
    assert [u.where for u in back.unknowns] == [u.where for u in flight.unknowns]


@pytest.mark.parametrize("wrong", [{"name": "C"}, {"noise": "none"}, {"basis": "cubic"}])
def test_unknown_scene(wrong):
    with pytest.raises(wj.WhiskjaxError, match=next(iter(wrong.values()))):
        songshan.Scene(**wrong)
