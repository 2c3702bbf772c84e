"""usgscsm (DOI-USGS, ba32d13b, public domain / CC0): the closed cases of its own tests, on a sphere that is no part of whiskjax.

Claim: the framers' ground points are met within 1e-8 m and those of the line scanner of constant velocity within 1e-10 m (they
are printed to 4e-9 and 1e-11 m); rays that miss the body say so, and pass its centre where usgscsm says; the distortions of LRO's
NAC and Dawn's framing camera are reproduced within 1e-8 mm. (The round trip of LRO's NAC: test_lro_nac.py.)
"""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from tests.peers.figures import Figure, assert_inside
from tests.peers.source import json_of
from tests.peers.strangers import CubicLine, Sphere
from whiskjax.rules import RESULTS
from whiskjax.rules.results import codes_of

PEER = "usgscsm"
MISSES = int(codes_of(RESULTS.ray_misses_ground))


def cases(folder: Path):
    """The cases by name."""
    return {case["name"]: case for case in json_of(folder, "usgscsm_closed.json")["cases"]}


def nearest_to_centre(sight):
    """The point of each ray that is nearest to the origin of the world."""
    origin, direction = np.asarray(sight.origin_m), np.asarray(sight.direction)
    return origin - (origin * direction).sum(axis=-1, keepdims=True) * direction


def largest(a, b):
    """Largest distance of points that belong together."""
    return float(np.linalg.norm(np.asarray(a) - np.array(b), axis=-1).max())


@functools.cache
def framers(folder: Path):
    """Sensor and shots of the simple and the orbital framer as one, ground points, misses of the body, and what they should be.

    (x_mm, y_mm, 50 mm) is the look of the pixel (x, y) at a focal length of 500 px of 0.1 mm. The orbital framer has its lines
    along x: there our column is its line.
    """
    simple, orbital = (cases(folder)[name] for name in ("simpleFramer", "orbitalFramer"))
    look = [(v["sample"] - 7.5, v["line"] - 7.5) for v in (*simple["values"], *simple["off_body"])]
    look += [(v["line"] - 8.0, v["sample"] - 8.0) for v in orbital["values"]]
    image = np.array([0] * (len(look) - 1) + [1])
    radius = np.where(image == 0, simple["sphere_radius_m"], orbital["sphere_radius_m"])
    position = np.array([case["position_m"] for case in (simple, orbital)])
    attitude = np.array([case["quaternion_xyzw_camera_to_body"] for case in (simple, orbital)])
    links = {"photo": wj.PosePerImage(position, attitude), "optics": wj.Axes("x -y -z")}
    sensor = wj.Sensor(links, wj.FrameCamera(500.0, (0.0, 0.0)))
    shot = wj.Shot(image=image)
    met = wj.image_to_ground(sensor, shot, np.array(look), Sphere(radius), throw=False)
    hit = np.array([True] * len(simple["values"]) + [False] * len(simple["off_body"]) + [True])
    ground = [v["ground_m"] for case in (simple, orbital) for v in case["values"]]
    beside = nearest_to_centre(wj.ray(sensor, shot, np.array(look)))[~hit]
    off = largest(np.asarray(met.point_m)[hit], ground), largest(beside, [v["nearest_m"] for v in simple["off_body"]])
    return sensor, codes_of(met.result), np.where(hit, 0, MISSES), off


@functools.cache
def scanner(folder: Path):
    """The line scanner: distance of its ground point, of the point beside the body, of the pixel on the way back, and its codes.

    Its look (-50, 0.1 (sample - 8), -0.05) mm: along -z of a camera of 500 px whose axes lie along y, z and x, and whose line
    lies half a pixel beside the middle.
    """
    case = cases(folder)["constVelocityLineScan"]
    lines = wj.LineTimes([0.0, 16.0], [-0.85, 0.75])
    time = np.array(lines.window_s)
    position = np.stack([np.full(2, 1000.0), np.zeros(2), -20 * time], axis=-1)
    body = wj.Trajectory(time, position, np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), max_gap_s=2.0)
    camera = wj.LineCamera(500.0, 8.0, offset_px=-0.5, samples_px=np.array([0.0, 16.0]))
    sensor = wj.Sensor({"body": body, "optics": wj.Axes("y z x")}, camera)
    (on,), (beside,), (start,) = case["values"], case["off_body"], case["ray_values"]
    looks = (on, beside, start)
    shot = wj.Shot(time_s=lines.time_at(jnp.array([v["line"] for v in looks])))
    pixel = np.array([(v["sample"], 0.0) for v in looks])
    met = wj.image_to_ground(sensor, shot, pixel, Sphere(case["sphere_radius_m"]), throw=False)
    sight = wj.ray(sensor, shot, pixel)
    back = wj.ground_to_image(sensor, wj.Shot(), np.array(on["ground_m"]), lines.window_s)
    off = (
        largest(met.point_m[0], on["ground_m"]),
        largest(nearest_to_centre(sight)[1], beside["nearest_m"]),
        largest(sight.origin_m[2], start["ray_origin_m"]),
    )
    pixel_off = max(abs(float(back.pixel_px[0]) - on["sample"]), abs(float(lines.line_at(back.time_s)) - on["line"]))
    return off, pixel_off, codes_of(met.result)


def distortions(folder: Path):
    """LRO NAC, by a camera of this test, and Dawn, by k1 = k f^2 of ours (any f): differences both ways, in mm."""
    nac, dawn = (cases(folder)[name] for name in ("lroNacDistortion", "dawnFcDistortion"))
    (value,) = nac["values"]
    lens, plain = CubicLine(700.0, nac["k"]), CubicLine(700.0)
    image = plain.pixel(lens.direction((value["distorted_mm"], 0.0)))
    back = lens.pixel(plain.direction((value["undistorted_mm"], 0.0)))
    of_nac = abs(float(image[0]) - value["undistorted_mm"]), abs(float(back[0]) - value["distorted_mm"])
    (value,) = dawn["values"]
    (u, v), distorted = value["undistorted_mm"], value["distorted_mm"]
    camera = wj.FrameCamera(150.0, (0.0, 0.0), (dawn["k"] * 150.0**2, 0.0, 0.0, 0.0, 0.0))
    seen = camera.pixel((u / 150, -v / 150, -1.0))
    x, y, z = camera.direction(tuple(distorted))
    of_dawn = largest(seen, distorted), largest((-150 * x / z, 150 * y / z), (u, v))
    return max(of_nac), max(of_dawn)


def figures(folder: Path) -> list[Figure]:
    """What is claimed."""
    _, codes, expected, (framed, framed_beside) = framers(folder)
    (scanned, scanned_beside, start), back, line_codes = scanner(folder)
    nac, dawn = distortions(folder)
    wrong = int((codes != expected).sum() + (line_codes[:2] != [0, MISSES]).sum())
    printed = "printed to 1e-8"
    return [
        Figure("framers, ground points on a sphere", framed, "m", 1e-8, printed),
        Figure("framers, rays past the body: their point nearest to the centre", framed_beside, "m", 1e-8, printed),
        Figure("line scanner, ground point", scanned, "m", 1e-10, "its closed form, 9e-12 m from what is printed"),
        Figure("line scanner, ray past the body, and where a ray starts", max(scanned_beside, start), "m", 1e-10, "the same"),
        Figure("line scanner, ground point -> line and sample", back, "px", 1e-7, "1e-9 m are printed, 1 px is 0.02 m"),
        Figure("rays that miss the body without saying so, or say so and do not", wrong, "", 0, "none may"),
        Figure("distortion of LRO NAC, both ways", nac, "mm", 1e-8, printed),
        Figure("distortion of Dawn FC, both ways", dawn, "mm", 1e-8, printed),
    ]


def test_figures(peer_values):
    assert_inside(figures(peer_values))


def test_the_orbital_framers_pixel_follows_the_ground_as_usgscsm_says(peer_values):
    """Its line is our column: 0.01 px a metre, 500 px at 50 km."""
    sensor, *_ = framers(peer_values)
    case = cases(peer_values)["orbitalFramer"]
    ground = np.array(case["values"][0]["ground_m"])
    found = jax.jacfwd(lambda p: wj.project(sensor, wj.Shot(image=1), p).pixel_px)(ground)
    expected = [case["ground_partials_px_per_m"][axis] for axis in ("line", "sample")]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
