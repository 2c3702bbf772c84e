"""Every array argument of every public class and function: another shape, float32, a word are refused by owner and argument.

The list follows `whiskjax.__all__` and the signatures: a new name, or a new argument of an old one, fails until it stands here.
"""

import inspect
import re
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import whiskjax as wj
from whiskjax.flights.flight import Image, Measurements, Points, World

TIME_S = np.array([0.0, 1.0, 2.0])
POINT_M = np.array([6378137.0, 10.0, 20.0])
QUATERNION = np.array([[0.0, 0.0, 0.0, 1.0]] * 3)
FRAME = wj.FrameCamera(1000.0, (0.0, 0.0))
LINE = wj.LineCamera(1000.0)
POSES = wj.PosePerImage(np.tile(POINT_M, (3, 1)), QUATERNION)
SENSOR = wj.Sensor({"body": POSES, "mount": wj.Mount(np.zeros(3))}, FRAME)
LINES = wj.Sensor({"body": wj.Trajectory(TIME_S, np.tile(POINT_M, (3, 1)), QUATERNION, max_gap_s=2.0)}, LINE)
BIASED = SENSOR.after("body", "bias", wj.Correction(wj.Bias()))
SHOT = wj.Shot(image=0)
EACH = wj.Shot(image=np.arange(3))
SEEN = {
    "shot": EACH,
    "point_m": np.tile(POINT_M, (3, 1)),
    "pixel_px": np.zeros((3, 2)),
    "sigma_px": np.ones((3, 2)),
    "is_control": np.ones(3, dtype=bool),
    "point_covariance_m2": np.tile(np.eye(3), (3, 1, 1)),
    "point": np.arange(3),
}
OBSERVATIONS = wj.Observations(**SEEN)
RAYS = {
    "shot": EACH,
    "pixel_px": np.zeros((3, 2)),
    "sigma_px": np.ones((3, 2)),
    "point": np.zeros(3, dtype=int),
    "position_m": POINT_M[None],
    "covariance_m2": np.eye(3)[None],
    "role": np.array(["control"]),
}
BLOCK = wj.Block(**RAYS)
UNKNOWN = wj.Unknown("lever", "mount.lever_arm_m[0]", 0.0, 1.0)
LOOKS = wj.Looks(EACH, np.zeros((3, 2)), (1.0, 1.0))
POINTS = {"names": ["P"], "position_m": POINT_M[None], "sigma_enu_m": np.ones((1, 3)), "roles": ["control"]}
MEASURED = Measurements(*np.zeros((2, 1), dtype=int), *np.ones((4, 1)))


class Takes(NamedTuple):
    """One public callable: what it takes, and of each array argument a shape that does not fit.

    `arrays`: a value of a wrong shape (None where every shape fits); `absolute`: those that float32 would spoil;
    `others`: arguments that hold no numbers.
    """

    good: dict[str, Any]
    arrays: dict[str, Any]
    absolute: str = ""
    others: str = ""
    owner: str = ""


TWO, THREE, FOUR = np.ones(2), np.ones(3), np.ones(4)
FAN = np.stack([TIME_S, 0 * TIME_S, -1 + 0 * TIME_S], axis=-1)
NED = dict.fromkeys(("lat_rad", "lon_rad"), 0.1)
RECORDS = {"height_m": THREE} | {name: 0.1 * THREE for name in ("lat_rad", "lon_rad", "roll_rad", "pitch_rad", "heading_rad")}
SWEPT = tuple(jnp.asarray(c) for c in POINT_M)

TAKES = {
    "ecef_to_geodetic": Takes({"point_ecef_m": POINT_M}, {"point_ecef_m": np.zeros(2)}, "point_ecef_m"),
    "geodetic_to_ecef": Takes(
        NED | {"lat_rad": 0.1 * TWO, "height_m": TWO},
        {"lat_rad": THREE, "lon_rad": THREE, "height_m": THREE},
        "lat_rad lon_rad height_m",
    ),
    "enu_rotation": Takes(NED | {"lat_rad": 0.1 * TWO}, {"lat_rad": None, "lon_rad": THREE}, "lat_rad lon_rad"),
    "ned_rotation": Takes(NED | {"lat_rad": 0.1 * TWO}, {"lat_rad": None, "lon_rad": THREE}, "lat_rad lon_rad"),
    "Refraction": Takes({"scale": 1.0, "wavelength_um": 0.55}, {"scale": TWO, "wavelength_um": TWO}),
    "HeightSurface": Takes({"height_m": 10.0}, {"height_m": None}, "height_m"),
    "Plane": Takes({"point_m": POINT_M, "normal": POINT_M}, {"point_m": FOUR, "normal": FOUR}, "point_m"),
    "bake": Takes({"sensor": SENSOR, "shots": SHOT, "free": ()}, {}, others="sensor shots free joints"),
    "By": Takes({"key": "view", "options": {"nadir": LINE}}, {}, others="key options"),
    "FrameCamera": Takes(
        {"focal_px": TWO, "principal_point_px": TWO, "distortion": np.zeros(5), "size_px": TWO},
        {"focal_px": None, "principal_point_px": 1.0, "distortion": np.zeros(4), "size_px": THREE},
        others="per_image",
    ),
    "LineCamera": Takes(
        {"focal_px": TWO},
        {
            "focal_px": None,
            "principal_sample_px": THREE,
            "offset_px": THREE,
            "along_sign": THREE,
            "across_sign": THREE,
            "deformation_px": np.zeros((2, 3)),
            "half_width_px": THREE,
            "samples_px": THREE,
            "wave_px": np.zeros((2, 3)),
            "wavelength_px": THREE,
        },
        others="along",
    ),
    "LookTable": Takes({"sample_px": TIME_S, "direction": FAN}, {"sample_px": 1.0, "direction": -np.ones((3, 2))}),
    "LineTimes": Takes({"line": TIME_S, "time_s": TIME_S}, {"line": np.eye(3), "time_s": FOUR}, "line time_s", "image"),
    "LineTimes.time_at": Takes({"self": wj.LineTimes(TIME_S, TIME_S), "line": 1.0}, {"line": None}),
    "LineTimes.line_at": Takes({"self": wj.LineTimes(TIME_S, TIME_S), "time_s": 1.0}, {"time_s": None}, "time_s"),
    "Axes": Takes({"axes": "x -y -z"}, {}, others="axes"),
    "Mount": Takes({}, {"lever_arm_m": TWO, "angles_rad": FOUR}, others="order lever_sign"),
    "Motion": Takes({}, {}, others="turn shift"),
    "Motion.from_derivative": Takes({}, {}, others="pose derivative"),
    "Pose": Takes({}, {}, others="rotation translation"),
    "Pose.from_arrays": Takes(
        {"rotation": np.eye(3), "translation_m": POINT_M},
        {"rotation": np.eye(4), "translation_m": TWO},
        "rotation translation_m",
    ),
    "Bias": Takes({}, {}),
    "Drift": Takes({"start_s": 0.0, "span_s": 1.0}, {"start_s": TWO, "span_s": TWO}, "start_s span_s"),
    "OrientationImages": Takes(
        {"start_s": 0.0, "spacing_s": 1.0, "nodes": 4},
        {"start_s": np.eye(2), "spacing_s": TWO, "nodes": np.full((2, 2), 4)},
        "start_s spacing_s",
    ),
    "Spline": Takes(
        {"start_s": [0.0, 9.0], "spacing_s": 1.0, "nodes": [4, 4]},
        {"start_s": np.eye(2), "spacing_s": TWO, "nodes": [4, 4, 4]},
        "start_s spacing_s",
    ),
    "Correction": Takes(
        {"basis": wj.Drift(0.0, 1.0)}, {"turn_rad": np.zeros((1, 3)), "shift_m": np.zeros((2, 2))}, others="basis"
    ),
    "Process": Takes(
        {"time_s": TIME_S, "root": np.eye(3), "kind": "smooth", "parameter": 1.0},
        {"time_s": np.eye(3), "root": np.eye(2)},
        "time_s",
        "kind parameter",
    ),
    "Process.random_walk": Takes({"time_s": TIME_S}, {"time_s": np.eye(3), "start_sigma": TWO}, "time_s", owner="Process"),
    "Process.ornstein_uhlenbeck": Takes(
        {"time_s": TIME_S, "correlation_s": 1.0}, {"time_s": np.eye(3), "correlation_s": TWO}, "time_s", owner="Process"
    ),
    "Process.smooth": Takes(
        {"time_s": TIME_S, "correlation_s": 1.0}, {"time_s": np.eye(3), "correlation_s": TWO}, "time_s", owner="Process"
    ),
    "Records": Takes(RECORDS, dict.fromkeys(RECORDS, FOUR), " ".join(RECORDS)),
    "Shot": Takes(
        {"time_s": TIME_S, "image": np.arange(3)},
        {"time_s": FOUR, **dict.fromkeys(("image", "swing", "view", "strip"), np.arange(4))},
        "time_s",
        "poses",
    ),
    "Sensor": Takes({"links": {"body": POSES}, "camera": FRAME}, {}, others="links camera refraction"),
    "joint_derivatives": Takes(
        {"sensor": SENSOR, "shot": SHOT, "point": SWEPT}, {"point": np.zeros((3, 3))}, others="sensor shot"
    ),
    "ray": Takes(
        {"sensor": SENSOR, "shot": EACH, "pixel_px": np.zeros(2)}, {"pixel_px": np.zeros((4, 2))}, others="sensor shot throw"
    ),
    "project": Takes(
        {"sensor": SENSOR, "shot": EACH, "point_m": POINT_M}, {"point_m": np.zeros((4, 3))}, "point_m", "sensor shot throw"
    ),
    "image_to_ground": Takes(
        {"sensor": SENSOR, "shot": EACH, "pixel_px": np.zeros(2), "surface": wj.HeightSurface(0.0)},
        {"pixel_px": np.zeros((4, 2)), "surface": wj.HeightSurface(np.zeros(4))},
        others="sensor shot throw",
    ),
    "ground_to_image": Takes(
        {"sensor": LINES, "shot": wj.Shot(), "point_m": POINT_M, "window_s": (TIME_S, 2.0)},
        {"point_m": np.zeros(2), "window_s": (TIME_S, TIME_S[:2])},
        "point_m",
        "sensor shot clip throw",
    ),
    "Trajectory": Takes(
        {"time_s": TIME_S, "position_m": np.eye(3), "quaternion_xyzw": QUATERNION, "max_gap_s": 2.0},
        {
            "time_s": np.eye(3),
            "position_m": np.ones((4, 3)),
            "quaternion_xyzw": np.ones((3, 3)),
            "max_gap_s": TWO,
            "velocity_mps": np.ones((3, 2)),
            "delay_s": None,
            "attitude_delay_s": None,
        },
        "time_s position_m quaternion_xyzw velocity_mps",
        "interpolation",
    ),
    "Trajectory.from_geodetic": Takes(
        {"time_s": TIME_S, "max_gap_s": 2.0, **RECORDS},
        {"time_s": np.eye(3), "max_gap_s": TWO, "velocity_ned_mps": np.ones((3, 2)), "delay_s": None, "attitude_delay_s": None}
        | dict.fromkeys(RECORDS, np.ones((3, 1))),
        " ".join(("time_s", *RECORDS)),
        "interpolation",
        owner="Trajectory",
    ),
    "PosePerImage": Takes(
        {"position_m": np.eye(3), "quaternion_xyzw": QUATERNION},
        {"position_m": np.ones(3), "quaternion_xyzw": np.ones((3, 3)), "turn_rad": np.zeros((2, 3)), "shift_m": np.zeros((3, 2))},
        "position_m quaternion_xyzw",
    ),
    "Encoder": Takes(
        {"time_s": TIME_S, "angle_rad": TIME_S, "max_gap_s": 2.0},
        {"time_s": np.eye(3), "angle_rad": FOUR, "max_gap_s": TWO},
        "time_s angle_rad",
        "name interpolation wraps",
    ),
    "Readings": Takes({"angle_rad": TIME_S}, {"angle_rad": None}, "angle_rad"),
    "Turn": Takes(
        {"axis": "x", "encoder": wj.Readings(0.1), "delay_s": TWO},
        {"delay_s": None, "zero_rad": THREE, "gain": None, "polynomial_rad": 0.1},
        "delay_s",
        "axis encoder sign",
    ),
    "Accuracy": Takes(
        dict.fromkeys(("cep50_m", "ce90_m", "le90_m", "se90_m"), TWO),
        dict.fromkeys(("cep50_m", "ce90_m", "le90_m", "se90_m"), THREE),
    ),
    "accuracy": Takes({"covariance_enu_m2": np.eye(3)}, {"covariance_enu_m2": np.eye(2), "bias_enu_m": TWO}),
    "error_radius": Takes(
        {"covariance": np.eye(3), "probability": 0.5}, {"covariance": np.eye(4), "probability": TWO, "bias": TWO}
    ),
    "calibrate_batch": Takes(
        {"runs": [(SENSOR, OBSERVATIONS)], "unknowns": [UNKNOWN]}, {"steps": [1, 2], "chunk": [1, 2]}, others="runs unknowns"
    ),
    "calibrate_redrawn": Takes(
        {"sensor": SENSOR, "observations": OBSERVATIONS, "unknowns": [UNKNOWN], "pixel_px": np.zeros((2, 3, 2))},
        {"pixel_px": np.zeros((3, 2)), "steps": [1, 2], "chunk": [1, 2]},
        others="sensor observations unknowns",
    ),
    "images_of": Takes(
        {"sensor": SENSOR, "observations": OBSERVATIONS, "unknowns": [UNKNOWN], "values": np.zeros((2, 1))},
        {"values": np.zeros((2, 2))},
        others="sensor observations unknowns",
    ),
    "adjust": Takes(
        {"sensor": SENSOR, "block": BLOCK, "unknowns": [UNKNOWN], "start_m": POINT_M[None]},
        {"start_m": POINT_M},
        "start_m",
        "sensor block unknowns errors blunders reweigh retime surface max_steps throw",
    ),
    "Block": Takes(
        RAYS,
        {
            "pixel_px": np.zeros((4, 2)),
            "sigma_px": np.ones((3, 1)),
            "point": np.zeros((3, 1), dtype=int),
            "position_m": POINT_M,
            "covariance_m2": np.eye(3),
            "role": np.array("control"),
        },
        "position_m",
        "shot points images strips time_s fixed labels",
    ),
    "Block.keep": Takes({"self": BLOCK, "rays": [0]}, {"rays": np.ones(4, dtype=bool)}),
    "direct_positioning": Takes({"sensor": SENSOR, "block": BLOCK}, {}, others="sensor block ties"),
    "two_step": Takes({}, {}, others="sensor block unknowns errors mounts tolerance retime surface max_rounds"),
    "Blunders": Takes({}, {"level": TWO, "most": TWO}),
    "calibrate": Takes(
        {}, {}, others="sensor observations unknowns consider errors surface loss blunders reweigh max_steps throw"
    ),
    "nees": Takes(
        {"error": np.ones((2, 3)), "covariance": np.tile(np.eye(3), (2, 1, 1))}, {"error": THREE, "covariance": np.eye(3)}
    ),
    "nees_band": Takes({"unknowns": 3, "runs": 100}, {"unknowns": [3, 3], "runs": [1, 2]}),
    "intersect": Takes(
        {"sensor": SENSOR, "shot": EACH, "pixel_px": np.zeros((3, 2)), "point_index": np.zeros(3, dtype=int)},
        {"pixel_px": np.zeros((3, 3)), "point_index": np.zeros(4, dtype=int), "sigma_px": np.ones((4, 2))},
        others="sensor shot throw",
    ),
    "Huber": Takes({}, {"bound": TWO}),
    "Cauchy": Takes({}, {"bound": TWO}),
    "motion_unknowns": Takes(
        {"sensor": BIASED, "link": "bias", "shift_sigma_m": THREE},
        {"turn_sigma_rad": TWO, "shift_sigma_m": FOUR, "coefficients": [[0]]},
        others="sensor link",
    ),
    "Observations": Takes(
        SEEN,
        {
            "point_m": POINT_M,
            "pixel_px": np.zeros((3, 3)),
            "sigma_px": np.ones((4, 2)),
            "is_control": np.ones(4, dtype=bool),
            "point_covariance_m2": np.eye(3),
            "point": np.arange(4),
        },
        "point_m",
        "shot images points labels",
    ),
    "Observations.take": Takes({"self": OBSERVATIONS, "keep": [0]}, {"keep": np.ones(4, dtype=bool)}),
    "compare": Takes({"models": {}}, {}, others="models"),
    "Unknown": Takes(
        {"name": "x", "where": "mount.lever_arm_m[0]", "mean": 0.0, "sigma": 1.0},
        {"mean": TWO, "sigma": TWO, "scale": TWO},
        others="name where",
    ),
    "assign": Takes({"sensor": SENSOR, "unknowns": [UNKNOWN], "values": [0.0]}, {"values": TWO}, others="sensor unknowns"),
    "Reweigh": Takes({}, {"spread": TWO}, others="images axes priors"),
    "Guess": Takes(
        {"point_m": POINT_M, "covariance_enu_m2": np.eye(3)}, {"point_m": FOUR, "covariance_enu_m2": np.eye(2)}, "point_m"
    ),
    "Guess.around": Takes(
        {"point_m": POINT_M, "sigma_enu_m": THREE}, {"point_m": FOUR, "sigma_enu_m": TWO}, "point_m", owner="Guess"
    ),
    "first_guess": Takes(
        {"sensor": SENSOR, "looks": LOOKS, "surface": wj.HeightSurface(0.0), "sigma_enu_m": THREE},
        {"sigma_enu_m": TWO},
        others="sensor looks surface throw",
    ),
    "locate": Takes(
        {"sensor": SENSOR, "looks": LOOKS, "sigma_enu_m": THREE},
        {"sigma_enu_m": TWO, "surface_sigma_m": TWO, "gate": TWO},
        others="sensor looks guess surface errors method estimate consider motion throw",
    ),
    "Looks": Takes(
        {"shot": EACH, "pixel_px": np.zeros((3, 2)), "sigma_px": TWO},
        {"pixel_px": np.zeros((4, 2)), "sigma_px": np.ones((4, 2))},
        others="shot",
    ),
    "ConstantVelocity": Takes({"sigma_enu_mps": THREE}, {"sigma_enu_mps": TWO, "acceleration_enu": FOUR}),
    "FrameErrors": Takes(
        {"frame": "body"},
        {"turn_sigma_rad": 0.1 * TWO, "shift_sigma_m": 1.0, "correlation_s": TWO},
        others="frame anew axes",
    ),
    "draw_errors": Takes({}, {}, others="errors key shot sensor surface"),
    "Flight": Takes(
        {"name": "f", "sensor": SENSOR, "images": [Image("a")], "points": Points(**POINTS), "measurements": MEASURED},
        {},
        others="name sensor images points measurements unknowns errors world epoch reference_point notes",
    ),
    "read_flight": Takes({}, {}, others="folder"),
    "write_flight": Takes({}, {}, others="flight folder overwrite"),
    "examine": Takes({}, {}, others="flight told"),
}
# Not of `whiskjax` itself, but what a flight is made of.
PARTS = {
    "Points": (Points, Takes(POINTS, {"position_m": POINT_M, "sigma_enu_m": np.ones((2, 3))}, "position_m", "names roles")),
    "Image": (Image, Takes({"name": "a"}, {"time_s": TWO}, "time_s", "name lines swing view strip columns rows")),
    "World": (World, Takes({"kind": "local"}, {"origin": TWO}, others="kind height_datum")),
}
# Answers, which only whiskjax makes; what is to be inherited from; and helpers that take results, not numbers.
NOT_CALLED = {
    *("Batch", "Adjustment", "TwoStep", "Calibration", "Comparison", "Location", "Estimate", "Reason", "Diagnosis", "Finding"),
    *(name for name in wj.__all__ if name.startswith("Abstract")),
    *("RESULTS", "FlightError", "SensorError", "WhiskjaxError", "first_failure", "failure_if", "telling"),
}


def found(name: str) -> Any:
    """A public callable by its name, dots included."""
    if name in PARTS:
        return PARTS[name][0]
    thing = wj
    for part in name.split("."):
        thing = getattr(thing, part)
    return thing


def takes(name: str) -> Takes:
    return PARTS[name][1] if name in PARTS else TAKES[name]


EVERY = [(name, argument) for name in (*TAKES, *PARTS) for argument in takes(name).arrays]


def refuses(name: str, argument: str, value: Any, more: str = "", **others: Any) -> None:
    """The owner and the argument, as a user would look for them."""
    case = takes(name)
    owner = case.owner or name
    with pytest.raises(wj.WhiskjaxError, match=rf"(?i)\b{re.escape(owner)}\b.*{re.escape(argument)}.*{more}"):
        found(name)(**(case.good | others | {argument: value}))


def test_every_public_name_is_here():
    callables = {name for name in wj.__all__ if callable(getattr(wj, name))}
    assert callables - NOT_CALLED == {name for name in TAKES if "." not in name}
    for name in callables - NOT_CALLED:
        thing = getattr(wj, name)
        if inspect.isclass(thing):
            made = [key for key, value in vars(thing).items() if isinstance(value, classmethod)]
            assert {f"{name}.{key}" for key in made} <= set(TAKES), name


@pytest.mark.parametrize("name", [*TAKES, *PARTS])
def test_every_argument_is_here(name):
    case = takes(name)
    arguments = set(inspect.signature(found(name)).parameters) - {"self"}
    assert set(case.arrays) | set(case.others.split()) == arguments
    assert not set(case.arrays) & set(case.others.split())
    assert set(case.absolute.split()) <= set(case.arrays)


@pytest.mark.parametrize("name", [name for name in (*TAKES, *PARTS) if inspect.isclass(found(name)) and takes(name).arrays])
def test_what_is_good_is_taken(name):
    """Else the refusals below could have another reason."""
    found(name)(**takes(name).good)


@pytest.mark.parametrize("name, argument", EVERY)
def test_another_shape_is_refused(name, argument):
    wrong = takes(name).arrays[argument]
    if wrong is not None:
        refuses(name, argument, wrong)


@pytest.mark.parametrize("name, argument", EVERY)
def test_words_are_no_numbers(name, argument):
    wrong = takes(name).arrays[argument]
    refuses(name, argument, "twelve")
    if wrong is not None and argument not in ("surface", "window_s"):
        refuses(name, argument, np.full(np.shape(takes(name).good.get(argument, wrong)), "twelve"))


@pytest.mark.parametrize("name, argument", EVERY)
def test_durations_are_no_numbers(name, argument):
    """numpy counts them among the integers, in whatever unit they have."""
    wrong = takes(name).arrays[argument]
    good = takes(name).good.get(argument, np.zeros(3) if wrong is None else wrong)
    if argument not in ("surface", "window_s", "role") and (name, argument) != ("joint_derivatives", "point"):
        refuses(name, argument, np.full(np.shape(good), 1000, dtype="timedelta64[ms]"), "timedelta64")


# What is needed beside the option, of those whose arrays are all inside other arguments.
OTHERS: dict[str, dict[str, Any]] = {
    "calibrate": {"sensor": SENSOR, "observations": OBSERVATIONS, "unknowns": [UNKNOWN]},
    "two_step": {
        "sensor": SENSOR,
        "block": BLOCK,
        "unknowns": [UNKNOWN],
        "errors": [wj.FrameErrors("body", THREE, THREE)],
        "mounts": [],
    },
    "write_flight": {"flight": None, "folder": "nowhere"},
}
FLAGS = [
    (name, argument)
    for name in (*TAKES, *PARTS)
    for argument, parameter in inspect.signature(found(name)).parameters.items()
    if parameter.annotation in (bool, "bool")
]


@pytest.mark.parametrize("name, argument", FLAGS)
@pytest.mark.parametrize("value", ["no", 0, None])
def test_options_are_on_or_off(name, argument, value):
    """Words, numbers and None would each be taken as one of the two."""
    refuses(name, argument, value, "(True|bool)", **OTHERS.get(name, {}))


@pytest.mark.parametrize("name, argument", [pair for pair in EVERY if pair[1] in takes(pair[0]).absolute.split()])
def test_float32_is_refused_where_it_would_be_wrong(name, argument):
    good = takes(name).good.get(argument, np.zeros((3, 3)))
    refuses(name, argument, np.asarray(good, dtype=np.float32), "float32")
    refuses(name, argument, jnp.asarray(good, dtype=jnp.float32), "float32")


TRACED = {
    "project": lambda x: wj.project(SENSOR, SHOT, x * jnp.ones(3, x.dtype)),
    "Shot": lambda x: wj.Shot(time_s=x),
    "Records": lambda x: wj.Records(x, 0.0, 0.0),
    "Guess": lambda x: wj.Guess.around(x * jnp.ones(3, x.dtype), THREE),
    "geodetic_to_ecef": lambda x: wj.geodetic_to_ecef(x, 0.0, 0.0),
}


@pytest.mark.parametrize("name", TRACED)
def test_float32_is_refused_while_tracing(name):
    with pytest.raises(wj.WhiskjaxError, match=f"{name}.*float32"):
        jax.eval_shape(TRACED[name], jax.ShapeDtypeStruct((), jnp.float32))
    jax.eval_shape(TRACED[name], jax.ShapeDtypeStruct((), jnp.float64))


def test_a_sensor_that_is_batched_by_vmap_is_taken():
    """Inside, every lane has the shapes of one sensor."""

    def focal(f, k, angles):
        sensor = wj.Sensor({"m": wj.Mount(angles_rad=angles)}, wj.FrameCamera(f, (0.0, 0.0), k))
        return sensor.camera.focal_px

    lanes = jax.eval_shape(jax.vmap(focal), *(jax.ShapeDtypeStruct((7, *shape), jnp.float64) for shape in ((), (5,), (3,))))
    assert lanes.shape == (7,)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: wj.Shot(swing=np.array([2**32])), "Shot: swing holds 4294967296"),
        (
            lambda: wj.nees([[1.0, 1.0]], [[[1.0, 0.9], [0.0, 1.0]]]),
            "nees: the covariance of run 0 is no covariance: it is not sym",
        ),
        (lambda: wj.LineTimes([0, 100], [0.0, 1.0]).s_per_line("a"), "LineTimes.s_per_line: line"),
        (lambda: wj.calibrate_batch([(SENSOR, OBSERVATIONS, 1)], [UNKNOWN]), "run 0 has 3 parts"),
        (lambda: wj.Unknown(" ", "mount.lever_arm_m[0]", 0.0, 1.0), "named ' '"),
        (lambda: wj.Unknown("a", "mount.lever_arm_m[\uff12]", 0.0, 1.0), "is no place in a sensor"),
        (lambda: wj.Unknown("a", "mount.lever_arm_m[00]", 0.0, 1.0), "is no place in a sensor"),
        (lambda: wj.Records([0.5, 0.5], [2.0, 2.0], [3000.0, -9999.0]), "Records: height_m holds -9999, where nothing flies"),
        (
            lambda: wj.Records([0.5, 0.0], [2.0, 0.0], [3000.0, 3000.0]),
            r"Records: lat_rad and lon_rad are exactly 0 at index \(1,\)",
        ),
        (
            lambda: wj.PosePerImage([POINT_M, [0.0, 0.0, 0.0], POINT_M], QUATERNION),
            r"PosePerImage: position_m of image 1 is \(0, 0, 0\), 6,378 km from the others",
        ),
        (
            lambda: wj.locate(SENSOR, LOOKS, guess=wj.Guess(POINT_M, np.eye(3)), sigma_enu_m=THREE),
            "locate: guess says where the target may be, and so does sigma_enu_m",
        ),
        (
            lambda: wj.locate(SENSOR, LOOKS, sigma_enu_m=THREE, errors=[wj.FrameErrors("body", 0.1 * THREE)] * 2),
            r"locate: errors\[1\] of 'body' says exactly what one before it says",
        ),
    ],
)
def test_what_would_be_taken_for_something_else_is_refused(make, message):
    with pytest.raises(wj.WhiskjaxError, match=message):
        make()


def test_s_per_line_takes_lists():
    np.testing.assert_array_equal(wj.LineTimes([0, 100], [0.0, 1.0]).s_per_line([1, 2]), [0.01, 0.01])
