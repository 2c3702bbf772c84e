"""What people hand over by mistake: objects of another kind, shapes that do not meet, numbers that cannot be meant.

Each is refused in our own words before anything is compiled; the message says what to write instead.
"""

import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from tests.rules.test_public_arrays import (
    BIASED,
    BLOCK,
    EACH,
    LINES,
    LOOKS,
    OBSERVATIONS,
    POINT_M,
    QUATERNION,
    RAYS,
    SEEN,
    SENSOR,
    SHOT,
    UNKNOWN,
)
from whiskjax.flights.flight import Image, Measurements, Points, World

PIXELS, POINTS = np.zeros((5, 2)), np.tile(POINT_M, (5, 1))
FRAME = SENSOR["camera"]
RECORDED = wj.Sensor({"body": wj.Records(*np.full((3, 5), 0.1))}, FRAME)
READ = wj.Sensor({"body": SENSOR["body"], "turn": wj.Turn("x", wj.Readings(np.zeros(5)))}, FRAME)
ZOOMED = wj.Sensor({"body": SENSOR["body"], "mount": SENSOR["mount"]}, wj.FrameCamera(np.ones(3), (0.0, 0.0)))
EACH5, FOCAL = wj.Shot(image=np.zeros(5, int)), wj.Unknown("f", "camera.focal_px", scale=1.0)
HALF_MASKED = np.ma.array(np.tile(POINT_M, (2, 1)), mask=[[0, 0, 0], [1, 1, 1]])
FLIGHT = {
    "name": "f",
    "sensor": SENSOR,
    "images": [Image("a")],
    "points": Points(["P"], POINT_M[None], np.ones((1, 3)), ["control"]),
    "measurements": Measurements(*np.zeros((2, 1), dtype=int), *np.ones((4, 1))),
}

# Objects of another kind.
KINDS = {
    "a list of links": (lambda: wj.Sensor([SENSOR["body"]], FRAME), "Sensor: links is a list.*{'body': Trajectory"),
    "links that are none": (lambda: wj.Sensor({"body": "mount"}, FRAME), "Sensor: links: body: a link is needed here, not str"),
    "a camera that is none": (lambda: wj.Sensor({"body": SENSOR["body"]}, 3000.0), "Sensor: camera: .*not float"),
    "refraction that is none": (
        lambda: wj.Sensor({"body": SENSOR["body"]}, FRAME, True),
        r"refraction is a bool.*Refraction\(\)",
    ),
    "options that are none": (lambda: wj.By("view", {"nadir": 1.0}), r"By: options\['nadir'\] is a float"),
    "options as a list": (lambda: wj.By("view", [wj.Mount()]), "By: options is a list"),
    "links among cameras": (lambda: wj.By("view", {"a": wj.Mount(), "b": FRAME}), "links or cameras, not some of each"),
    "a link of cameras": (lambda: wj.Sensor({"a": wj.By("view", {"b": FRAME})}, FRAME), "a link is needed here, not a By of cam"),
    "a camera of links": (lambda: wj.Sensor({"a": wj.Mount()}, wj.By("view", {"b": wj.Mount()})), "Sensor: camera: a camera"),
    "no such key": (lambda: wj.By("colour", {"a": FRAME}), "one of image, swing, view, strip, not 'colour'"),
    "a word as focal length": (lambda: wj.FrameCamera("long", (0.0, 0.0)), "FrameCamera: focal_px has dtype"),
    "an array as encoder": (lambda: wj.Turn("x", np.zeros(3)), r"Turn: encoder is a ndarray.*Encoder\(time_s, angle_rad, max"),
    "a class for a basis": (lambda: wj.Correction(wj.Bias), "Correction: basis is the class Bias itself"),
    "axes as a list": (lambda: wj.Axes(["x", "-y", "-z"]), "Axes: axes is a list"),
    "an order as a number": (lambda: wj.Mount(order=123), "names each of x, y and z once"),
    "a time as shot": (lambda: wj.project(SENSOR, 1.5, POINT_M), r"project: shot is a float.*Shot\(time_s=...\)"),
    "a flight as sensor": (lambda: wj.ray(wj.Flight(**FLIGHT), SHOT, PIXELS), "ray: sensor is a Flight, but Sensor is expected"),
    "a height as surface": (
        lambda: wj.image_to_ground(SENSOR, SHOT, PIXELS, 10.0),
        r"surface is 10.0, .*give HeightSurface\(10.0\)",
    ),
    "a class as surface": (lambda: wj.image_to_ground(SENSOR, SHOT, PIXELS, wj.HeightSurface), "image_to_ground: surface is"),
    "heights as surface": (lambda: wj.locate(SENSOR, LOOKS, surface=np.zeros(3)), "locate: surface is .* which no ray can be"),
    "a first height": (lambda: wj.first_guess(SENSOR, LOOKS, 5, np.ones(3)), r"first_guess: .*HeightSurface\(5\)"),
    "one time as window": (lambda: wj.ground_to_image(LINES, wj.Shot(), POINT_M, 1.0), "window_s is 1.0; .*(start, stop)"),
    "a name as names": (lambda: wj.bake(SENSOR, SHOT, "body"), "bake: free is a list of names, not 'body'"),
    "an array as components": (
        lambda: wj.joint_derivatives(SENSOR, SHOT, POINT_M),
        "joint_derivatives: point is three components",
    ),
    "an array as pose": (lambda: wj.Pose(np.eye(3), np.zeros(3)), r"Pose: rotation is .*Pose.from_arrays\(rotation"),
    "an array as motion": (lambda: wj.Motion(np.zeros(3)), "Motion: turn is three components"),
    "flight for observations": (lambda: wj.calibrate(SENSOR, BLOCK, [UNKNOWN]), "calibrate: observations is a Block"),
    "one unknown": (lambda: wj.calibrate(SENSOR, OBSERVATIONS, UNKNOWN), r"calibrate: unknowns is one Unknown.*\[lever\]"),
    "names of unknowns": (lambda: wj.calibrate(SENSOR, OBSERVATIONS, ["lever"]), r"calibrate: unknowns\[0\] is a str"),
    "a class of loss": (lambda: wj.calibrate(SENSOR, OBSERVATIONS, [UNKNOWN], loss=wj.Huber), "loss is the class Huber itself"),
    "true for blunders": (
        lambda: wj.calibrate(SENSOR, OBSERVATIONS, [UNKNOWN], blunders=True),
        "blunders is a bool, but Blunders",
    ),
    "true for weights": (lambda: wj.calibrate(SENSOR, OBSERVATIONS, [UNKNOWN], reweigh=True), "reweigh is a bool, but Reweigh"),
    "one considered": (lambda: wj.calibrate(SENSOR, OBSERVATIONS, [UNKNOWN], consider=UNKNOWN), "consider is one Unknown"),
    "true for weights of a block": (lambda: wj.adjust(SENSOR, BLOCK, [UNKNOWN], reweigh=True), "reweigh is a bool, but Reweigh"),
    "groups in a block": (
        lambda: wj.adjust(SENSOR, BLOCK, [UNKNOWN], reweigh=wj.Reweigh(images=True)),
        "leave images and axes out of Reweigh",
    ),
    "named priors in a block": (
        lambda: wj.adjust(SENSOR, BLOCK, [UNKNOWN], reweigh=wj.Reweigh(priors={"arms": ["u"]})),
        "groups of unknowns by name are for calibrate",
    ),
    "observations for a block": (lambda: wj.adjust(SENSOR, OBSERVATIONS, [UNKNOWN]), "adjust: block is a Observations"),
    "errors as a dict": (lambda: wj.adjust(SENSOR, BLOCK, [], errors={}), "adjust: errors is a dict, but Sequence"),
    "a block for direct": (lambda: wj.direct_positioning(SENSOR, OBSERVATIONS), "direct_positioning: block is a Observations"),
    "no errors in two steps": (
        lambda: wj.two_step(SENSOR, BLOCK, [UNKNOWN], errors=None, mounts=["lever"]),
        "two_step: errors is a NoneType",
    ),
    "runs that are no pairs": (lambda: wj.calibrate_batch([SENSOR], [UNKNOWN]), "calibrate_batch: run 0 is a Sensor, but tuple"),
    "a link by its number": (lambda: wj.motion_unknowns(BIASED, "mount", shift_sigma_m=np.ones(3)), "mount is a Mount"),
    "a list of calibrations": (lambda: wj.compare([1, 2]), "compare: models is a list"),
    "calibrations that are none": (lambda: wj.compare({"a": 1, "b": 2}), r"compare: models\['a'\] is a int"),
    "looks that are none": (lambda: wj.locate(SENSOR, OBSERVATIONS), r"locate: looks is a Observations.*Looks\(shot, pixel_px"),
    "a sigma as noise": (lambda: wj.locate(SENSOR, LOOKS, errors=0.1), "locate: errors is a float"),
    "sigmas as noise": (lambda: wj.locate(SENSOR, LOOKS, errors=[0.1]), r"locate: errors\[0\] is a float, but FrameErrors"),
    "a point as guess": (lambda: wj.locate(SENSOR, LOOKS, guess=POINT_M), "locate: guess is a ndarray, but Guess"),
    "true for motion": (lambda: wj.locate(SENSOR, LOOKS, motion=True), "locate: motion is a bool, but ConstantVelocity"),
    "a time as shot of looks": (lambda: wj.Looks(np.arange(3.0), np.zeros((3, 2)), (1, 1)), "Looks: shot is a ndarray"),
    "a list of images": (lambda: wj.Flight(**(FLIGHT | {"images": ["a"]})), r"Flight: images\[0\] is a str, but Image"),
    "a flight without sensor": (lambda: wj.Flight(**(FLIGHT | {"sensor": FRAME})), "Flight: sensor is a FrameCamera"),
    "a flight by another name": (lambda: wj.write_flight(SENSOR, "/nowhere"), "write_flight: flight is a Sensor, but Flight"),
    "a number as folder": (lambda: wj.read_flight(7), "read_flight: folder is a int"),
}

# Shapes of several arguments that do not meet.
SHAPES = {
    "shots and points": (lambda: wj.project(SENSOR, EACH, POINTS), r"point_m has the batch shape \(5,\), .*\(3,\) of shot.image"),
    "shots and pixels": (
        lambda: wj.ray(SENSOR, EACH, PIXELS),
        r"ray: pixel_px has the batch shape \(5,\), .* \(3,\) of shot.image",
    ),
    "records and shots": (
        lambda: wj.project(RECORDED, EACH, POINT_M),
        r"shot.image has the batch shape \(3,\).*\(5,\) of sensor\['bod",
    ),
    "readings and pixels": (
        lambda: wj.ray(READ, SHOT, PIXELS[:4]),
        r"pixel_px has the batch shape \(4,\).*\(5,\) of sensor\['turn'\]",
    ),
    "records and looks": (
        lambda: wj.locate(RECORDED, LOOKS),
        r"locate: looks.pixel_px has the batch shape \(3,\).*\(5,\) of sensor",
    ),
    "noise and looks": (
        lambda: wj.locate(SENSOR, LOOKS, errors=[wj.FrameErrors("body", (np.ones(4), 0, 0))]),
        r"locate: errors\[0\] has the batch shape \(4,\), which does not broadcast with \(3,\) of looks.pixel_px",
    ),
    "records of observations": (lambda: wj.calibrate(RECORDED, OBSERVATIONS, [FOCAL]), "body holds a record for each"),
    "records of rays": (lambda: wj.adjust(RECORDED, BLOCK, [FOCAL]), "adjust: body holds a record for each look"),
    "readings of rays": (lambda: wj.intersect(READ, EACH5, PIXELS, np.zeros(5, int)), "intersect: turn holds a record"),
    "cameras of observations": (
        lambda: wj.calibrate(ZOOMED, OBSERVATIONS, [UNKNOWN]),
        "calibrate: camera holds a record for each",
    ),
    "heights and pixels": (
        lambda: wj.image_to_ground(SENSOR, SHOT, PIXELS, wj.HeightSurface(np.zeros(4))),
        r"surface has the batch shape \(4,\), which does not broadcast with \(5,\) of pixel_px",
    ),
    "window and points": (
        lambda: wj.ground_to_image(LINES, wj.Shot(), POINTS, (np.zeros(4), 2.0)),
        r"window_s has the batch shape \(4,\), which does not broadcast with \(5,\) of point_m",
    ),
    "keys and times": (lambda: wj.Shot(time_s=np.zeros(3), view=np.zeros(4, int)), r"Shot: view has the batch shape \(4,\)"),
    "shot of observations": (
        lambda: wj.Observations(**(SEEN | {"shot": wj.Shot(time_s=np.zeros(4))})),
        r"shot.time_s has shape \(4,\)",
    ),
    "shot of rays": (
        lambda: wj.Block(**(RAYS | {"shot": wj.Shot(image=np.zeros(4, int))})),
        r"Block: shot.image has shape \(4,\)",
    ),
    "shot of looks": (
        lambda: wj.Looks(wj.Shot(view=np.zeros(2, int)), np.zeros((3, 2)), (1, 1)),
        r"Looks: shot.view has shape \(2,\)",
    ),
    "shot of intersections": (
        lambda: wj.intersect(SENSOR, wj.Shot(image=np.zeros(4, int)), np.zeros((3, 2)), np.zeros(3, int)),
        r"intersect: shot.image has shape \(4,\), expected \(rays,\) with rays = 3",
    ),
    "batches of a camera": (lambda: wj.FrameCamera(np.ones(3), np.zeros((2, 2))), "principal_point_px has the batch shape"),
    "a measurement of no image": (
        lambda: wj.Flight(**(FLIGHT | {"images": []})),
        "measurement 0 is of image 0, but there are 0",
    ),
}

# Numbers that cannot be meant.
NUMBERS = {
    "a negative bound": (lambda: wj.Huber(-1), "Huber: bound is -1; it must be above 0"),
    "no number as bound": (lambda: wj.Huber(np.nan), "Huber: bound is not a finite number"),
    "no bound": (lambda: wj.Cauchy(0.0), "Cauchy: bound is 0; it must be above 0"),
    "an infinite bound": (lambda: wj.Cauchy(np.inf), "Cauchy: bound is not a finite number"),
    "records in degrees": (
        lambda: wj.Records(40.0, 120.0, 0.0),
        "Records: lat_rad is 40, beyond .*radians are expected, not degrees",
    ),
    "longitude before latitude": (lambda: wj.Records(2.09, 0.7, 0.0), "lat_rad is 2.09, beyond .*latitude before longitude"),
    "longitude in degrees": (lambda: wj.Records(0.7, 120.0, 0.0), "Records: lon_rad is 120, beyond"),
    "heading in degrees": (lambda: wj.Records(0.7, 2.0, 0.0, heading_rad=270.0), "heading_rad is 270, beyond .*radians"),
    "geodetic degrees": (lambda: wj.geodetic_to_ecef(40.0, 120.0, 0.0), "geodetic_to_ecef: lat_rad is 40, beyond"),
    "frames in degrees": (lambda: wj.enu_rotation(0.7, 120.0), "enu_rotation: lon_rad is 120, beyond"),
    "mounts in degrees": (lambda: wj.Mount(angles_rad=(0.0, 0.0, 90.0)), r"Mount: angles_rad is 90 at index \(2,\), beyond"),
    "an index error in degrees": (lambda: wj.Turn("x", wj.Readings(0.0), zero_rad=45.0), "Turn: zero_rad is 45, beyond"),
    "noise in degrees": (lambda: wj.FrameErrors("body", (0.0, 0.0, 8.0)), "FrameErrors: turn_sigma_rad is 8, beyond"),
    "negative noise": (lambda: wj.FrameErrors("body", (0.0, 0.0, -1e-3)), "turn_sigma_rad is -0.001; it must be 0 or more"),
    "a motion in degrees": (lambda: wj.motion_unknowns(BIASED, "bias", turn_sigma_rad=(9.0, 9.0, 9.0)), "turn_sigma_rad is 9 "),
    "a negative guess": (lambda: wj.Guess.around(POINT_M, (1.0, -1.0, 1.0)), r"Guess.around: sigma_enu_m is -1 at index \(1,\)"),
    "negative velocity": (lambda: wj.ConstantVelocity((1.0, 1.0, -1.0)), "sigma_enu_mps is -1 at"),
    "negative acceleration": (lambda: wj.ConstantVelocity((1.0, 1.0, 1.0), (0.0, -1.0, 0.0)), "acceleration_enu is -1 at"),
    "a whole as share": (lambda: wj.Blunders(level=1.0), "level and most lie between 0 and 0.5"),
    "no spread": (lambda: wj.Reweigh(spread=np.nan), "spread is a factor above 1"),
    "no runs": (lambda: wj.nees_band(3, 0), "nees_band: runs is 0, but there is at least one"),
    "half a run": (lambda: wj.nees_band(3, 1.5), "nees_band: runs has dtype float64.*whole numbers"),
    "no unknowns": (lambda: wj.nees_band(-3, 10), "nees_band: unknowns is -3"),
    "a flat covariance": (
        lambda: wj.nees(np.ones((1, 2)), np.ones((1, 2, 2))),
        "nees: covariance of run 0 is not positive definite",
    ),
    "a rotation that is none": (lambda: wj.Pose.from_arrays(2 * np.eye(3), POINT_M), "rotation is no rotation"),
    "a mirrored rotation": (lambda: wj.Pose.from_arrays(-np.eye(3), POINT_M), "rotation is no rotation"),
    "a sign of two": (lambda: wj.LineCamera(1000.0, across_sign=2.0), r"across_sign is \+1 or -1, not 2.0"),
    "samples from the end": (lambda: wj.LineCamera(1000.0, samples_px=(10, 0)), "samples_px is the first and the last sample"),
    "no width": (lambda: wj.LineCamera(1000.0, half_width_px=0.0), "half_width_px is 0; it must be above 0"),
    "no frame": (lambda: wj.FrameCamera(1000.0, (0, 0), size_px=(0, 10)), r"size_px is 0 at index \(0,\)"),
    "a surface at no height": (lambda: wj.HeightSurface(np.nan), "HeightSurface: height_m is not a finite number"),
    "a plane without direction": (lambda: wj.Plane(POINT_M, np.zeros(3)), "Plane: normal is zero"),
    "negative air": (lambda: wj.Refraction(-1.0), "Refraction: scale is -1; it must be 0 or more"),
    "a drift over no time": (lambda: wj.Drift(0.0, 0.0), "Drift: span_s is 0; it must be above 0"),
    "half a node": (lambda: wj.Spline(0.0, 1.0, 4.7), "Spline: nodes has dtype float64.*a number of nodes"),
    "nodes at once": (lambda: wj.Spline(0.0, 0.0, 4), "Spline: spacing_s is 0; it must be above 0"),
    "true as an image": (lambda: wj.Shot(image=True), "Shot: image has dtype bool"),
    "flags as numbers": (
        lambda: wj.Observations(**(SEEN | {"is_control": [1, 0, 1]})),
        "is_control has dtype int64; True or False",
    ),
    "points as fractions": (lambda: wj.Block(**(RAYS | {"point": np.zeros(3)})), "Block: point has dtype float64.*whole numbers"),
    "an observation that is not there": (lambda: OBSERVATIONS.take([5]), "keep holds the index 5, but there are 3"),
    "a mask of another length": (
        lambda: BLOCK.keep(np.ones(2, bool)),
        r"Block.keep: rays has shape \(2,\), expected \(3,\): a mask",
    ),
    "masked points": (lambda: wj.project(SENSOR, SHOT, HALF_MASKED), "point_m is a masked array"),
    "an origin in radians, or swapped": (lambda: wj.flights.flight.World("local", (120.0, 40.0, 0.0)), "World: origin"),
    "a point of no kind": (lambda: Points(["P"], POINT_M[None], np.ones((1, 3)), ["anchor"]), "Points: roles: .*anchor"),
    "a point better than exact": (lambda: Points(["P"], POINT_M[None], -np.ones((1, 3)), ["tie"]), "sigma_enu_m is -1 at"),
    "an image at no time": (lambda: Image("a", time_s=np.nan), "Image a: time_s is not a finite number"),
    "an origin of two": (lambda: World("local", (40.0, 7.0)), r"World: origin has shape \(2,\)"),
}


@pytest.mark.parametrize("case", [*KINDS, *SHAPES, *NUMBERS])
def test_what_cannot_be_meant_is_refused(case):
    call, message = (KINDS | SHAPES | NUMBERS)[case]
    with pytest.raises(wj.WhiskjaxError, match=message):
        call()


def test_what_looks_alike_is_taken():
    """Beside the refusals: what is right must not be refused with what is wrong."""
    wj.Records(0.7, 2.0, 0.0, heading_rad=7.0)  # a heading that ran on through north
    wj.Mount(angles_rad=(0.0, np.pi, -2 * np.pi))
    wj.geodetic_to_ecef(np.pi / 2, -np.pi, -1e4)
    wj.Observations(**(SEEN | {"pixel_px": np.zeros((3, 2), dtype=np.float32)}))  # as detectors of features give them
    wj.FrameErrors("body", (0.0, 0.0, 1e-3), (0.0, 0.0, 0.0))  # an axis that is kept
    wj.PosePerImage(np.zeros((3, 3), dtype=int), QUATERNION)  # whole metres
    wj.project(SENSOR, EACH, np.ma.array(np.tile(POINT_M, (3, 1))), throw=False)  # nothing is masked
    assert np.isnan(wj.nees(np.ones((2, 1)), np.array([[[1.0]], [[np.nan]]]))).tolist() == [False, True]
    assert wj.FrameCamera(jnp.ones(3), jnp.zeros((4, 1, 2))).batch_shape == (4, 3)
