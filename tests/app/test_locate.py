"""`whiskjax locate`, from a folder to a report: its numbers are those of `wj.locate`, and its exit code means what it says."""

import csv
import json
import shutil

import numpy as np
import pytest

import whiskjax as wj
from tests.app.said import progress
from tests.files.folder import Folder
from whiskjax.flights import tianshan
from whiskjax.flights.flight import Image, Measurements, Points, World

FIGURES = {"error_ellipse.png", "convergence.png", "innovations.png"}
MAPS = {"target.geojson", "target.kml"}
WRITTEN = {"results.json", "report.html", "looks.csv", *FIGURES, *MAPS}
LOOKS, HEIGHT = 12, 1000.0
SIGMA = (2000.0, 2100.0, 1500.0)
ASKED = ("--target", "target", "--height", HEIGHT, "--sigma-enu", *SIGMA)


def names(folder):
    return {path.name for path in folder.iterdir()}


def json_of(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def looks(tmp_path_factory):
    """The folder of twelve looks; not to be changed."""
    flight = tianshan.simulate(3, tianshan.Scene(path="race", looks=LOOKS))
    return wj.write_flight(flight, tmp_path_factory.mktemp("looks") / "flight")


@pytest.fixture
def copied(looks, tmp_path):
    """A copy of it to be spoilt."""
    return Folder(shutil.copytree(looks, tmp_path / "flight"))


@pytest.fixture(scope="module")
def located(whiskjax, looks, tmp_path_factory):
    """(the command's result, the folder it wrote); not to be changed."""
    out = tmp_path_factory.mktemp("located") / "new" / "out"
    return whiskjax("locate", looks, "--out", out, *ASKED), out


def directly(folder, points=(0,), **more):
    """The same by the public function, and its looks."""
    flight = wj.read_flight(folder)
    seen, _ = flight.looks(points)
    given = {"surface": wj.HeightSurface(HEIGHT), "sigma_enu_m": np.array(SIGMA), "errors": flight.errors} | more
    return wj.locate(flight.sensor, seen, **given), seen


def agree(found, expected):
    """Position and covariance of results.json are those of a `Location`."""
    place = [found["position"][key] for key in ("lat_deg", "lon_deg", "height_m")]
    np.testing.assert_allclose(place, expected.geodetic, rtol=1e-13, atol=0)
    np.testing.assert_allclose(found["covariance_enu_m2"], expected.covariance_enu_m2, rtol=1e-9)


def test_a_sound_result_ends_in_zero_and_is_all_there(located):
    result, out = located
    assert result.exit_code == 0
    progress(result.stderr)
    assert names(out) == WRITTEN
    assert json_of(out)["verdict"]["is_sound"] and "This location is sound:" in result.stdout.splitlines()


def test_results_are_those_of_locate(located, looks):
    expected, _ = directly(looks)
    found = json_of(located[1])
    agree(found, expected)
    accuracy = expected.accuracy()
    for name in ("cep50_m", "ce90_m", "le90_m", "se90_m"):
        assert found["accuracy"][name] == pytest.approx(float(getattr(accuracy, name)), rel=1e-12)
    assert found["looks"]["used"] == LOOKS and found["looks"]["gated"] == found["looks"]["missed"] == 0
    assert found["looks"]["convergence_deg"] == pytest.approx(np.degrees(float(expected.convergence_rad)), rel=1e-12)
    assert found["consistency"]["chi_square"] == pytest.approx(float(expected.chi_square), rel=1e-9)
    assert found["consistency"]["freedom"] == 2 * LOOKS
    assert found["warnings"] == list(expected.warnings)


def test_looks_one_by_one(located, looks):
    expected, seen = directly(looks)
    rows = read_csv(located[1] / "looks.csv")
    assert [row["image"] for row in rows] == [f"look-{i + 1}" for i in range(LOOKS)]
    assert {row["state"] for row in rows} == {"used"}
    columns = {
        "time_s": seen.shot.time_s,
        "innovation_x_px": expected.looks.innovation_px[:, 0],
        "innovation_y_px": expected.looks.innovation_px[:, 1],
        "sigma_x_px": np.sqrt(np.asarray(expected.looks.innovation_covariance_px2)[:, 0, 0]),
        "nis": expected.looks.nis,
        "sigma_u_m": np.sqrt(np.asarray(expected.looks.covariance_enu_m2)[:, 2, 2]),
    }
    for name, column in columns.items():
        # 1e-6 px: the first innovation is zero but for rounding.
        np.testing.assert_allclose([float(row[name]) for row in rows], column, rtol=1e-9, atol=1e-6)
    last = [float(rows[-1][key]) for key in ("lat_deg", "lon_deg", "height_m")]
    np.testing.assert_allclose(last, expected.geodetic, rtol=1e-13, atol=0)


def test_error_is_that_of_the_given_position(located, looks):
    """By the textbook's axes east, north, up, between the printed position and the simulation's target."""
    found = json_of(located[1])
    lat, lon = np.radians(found["position"]["lat_deg"]), np.radians(found["position"]["lon_deg"])
    s, c, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    axes = np.array([[-sl, cl, 0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    place = np.asarray(wj.geodetic_to_ecef(lat, lon, found["position"]["height_m"]))
    lat_deg, lon_deg, height_m = tianshan.TARGET
    truth = np.asarray(wj.geodetic_to_ecef(np.radians(lat_deg), np.radians(lon_deg), height_m))
    error = axes @ (place - truth)
    np.testing.assert_allclose(found["truth"]["error_enu_m"], error, rtol=0, atol=1e-6)
    nees = error @ np.linalg.solve(np.array(found["covariance_enu_m2"]), error)
    assert found["truth"]["nees"] == pytest.approx(nees, rel=1e-6) and found["truth"]["nees"] < 16.3  # 0.1 % of chi-square 3


def test_maps_show_the_target(located):
    out, found = located[1], json_of(located[1])
    collection = json.loads((out / "target.geojson").read_text(encoding="utf-8"))
    target, ellipse, track = collection["features"]
    assert target["geometry"]["coordinates"] == pytest.approx([found["position"][k] for k in ("lon_deg", "lat_deg", "height_m")])
    assert target["properties"]["is_sound"] and target["properties"]["looks_used"] == LOOKS
    assert ellipse["properties"]["semi_major_m"] == pytest.approx(found["accuracy"]["ellipse_90"]["semi_major_m"], rel=1e-9)
    assert ellipse["properties"]["azimuth_deg"] == pytest.approx(found["accuracy"]["ellipse_90"]["azimuth_deg"], rel=1e-9)
    # 10 m of noise in the recorded positions are 1e-4 deg.
    true = tianshan.true_records(tianshan.Scene(path="race", looks=LOOKS))
    np.testing.assert_allclose(np.array(track["geometry"]["coordinates"])[:, 1], np.degrees(true.lat_rad), rtol=0, atol=5e-4)
    assert "<kml" in (out / "target.kml").read_text(encoding="utf-8")


def test_prints_the_numbers_of_results_json(located):
    result, out = located
    found, lines = json_of(out), result.stdout.splitlines()
    rows = {"latitude": ("lat_deg", 1), "longitude": ("lon_deg", 0), "height": ("height_m", 2)}
    for name, (key, k) in rows.items():
        words = next(line for line in lines if line.startswith(name + " ")).replace("−", "-").split()
        sigma = found["sigma_enu_m"][k]
        assert words[3] == ("east", "north", "up")[k]
        assert float(words[4]) == pytest.approx(sigma, rel=0.06)
        assert float(words[2]) == pytest.approx(found["position"][key], abs=0.06 * sigma / (1 if name == "height" else 8e4))
        assert float(words[6]) == pytest.approx(found["truth"]["error_enu_m"][k], abs=0.06 * sigma)
    assert all(f"warning: {warning}" in lines for warning in found["warnings"])


def test_a_default_guess_is_said_and_follows_from_the_first_look(whiskjax, looks, tmp_path):
    """57 deg off the vertical: 1500 m of height are 2300 m along the ground; the answer hardly changes."""
    result = whiskjax("locate", looks, "--out", tmp_path / "out", "--target", "target", "--height", HEIGHT)
    assert result.exit_code == 0 and "1-sigmas of 2300 m east and north and 1500 m up" in result.stdout
    found = json_of(tmp_path / "out")
    assert found["guess"]["sigma_enu_m"] == pytest.approx([2300, 2300, 1500])
    agree(found, directly(looks, sigma_enu_m=np.array([2300.0, 2300, 1500]))[0])


def test_looks_out_of_order_are_sorted_and_said_to_be(whiskjax, copied, located, tmp_path):
    header, *rows = copied.rows("observations.csv")
    copied.store("observations.csv", [header, *rows[5:], *rows[:5]])
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", *ASKED)
    assert result.exit_code == 0 and "not in the order of time in observations.csv; they were sorted" in result.stdout
    assert json_of(tmp_path / "out")["position"] == json_of(located[1])["position"]


@pytest.mark.parametrize("target", ["centre-*", "centre-1,centre-[2-9],centre-1?"])
def test_many_points_for_one_target(whiskjax, copied, located, target, tmp_path):
    """Each look with a point of its own, 2 m apart in height: the same answer, against their mean."""
    header, row = copied.rows("points.csv")
    height = header.index("height_m")
    points = [[f"centre-{i + 1}", *row[1:]] for i in range(LOOKS)]
    for i, point in enumerate(points):
        point[height] = repr(float(row[height]) + (1 if i % 2 else -1))
    header_o, *rows = copied.rows("observations.csv")
    k = header_o.index("point")
    copied.store("points.csv", [header, *points])
    copied.store("observations.csv", [header_o, *([*r[:k], f"centre-{i + 1}", *r[k + 1 :]] for i, r in enumerate(rows))])
    words = ("--target", target, *ASKED[2:])
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", *words)
    assert result.exit_code == 0 and f"Position of centre-1 … centre-12 ({LOOKS} points)" in result.stdout
    found, single = json_of(tmp_path / "out"), json_of(located[1])
    assert found["position"] == single["position"] and found["points"] == [f"centre-{i + 1}" for i in range(LOOKS)]
    np.testing.assert_allclose(found["truth"]["error_enu_m"], single["truth"]["error_enu_m"], rtol=0, atol=1e-6)
    assert found["truth"]["spread_m"] == pytest.approx(1.0, abs=1e-6)


def test_a_gross_error_is_gated_and_listed(whiskjax, copied, looks, tmp_path):
    line = 9
    copied.cell("observations.csv", line, "sample", "4000")
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", *ASKED, "--gate", 0.001)
    assert result.exit_code == 0 and "1 of 12 looks did not pass the gate" in result.stdout
    found = json_of(tmp_path / "out")
    assert found["looks"]["gated_images"] == ["look-8"] and found["looks"]["used"] == LOOKS - 1
    assert [row["state"] for row in read_csv(tmp_path / "out" / "looks.csv")].index("gated") == 7
    agree(found, directly(copied.path, gate=1e-3)[0])


def test_a_batch_has_no_estimate_after_each_look(whiskjax, looks, tmp_path):
    result = whiskjax("locate", looks, "--out", tmp_path / "out", *ASKED, "--method", "batch")
    assert result.exit_code == 0
    assert names(tmp_path / "out") == WRITTEN - {"convergence.png"}
    agree(json_of(tmp_path / "out"), directly(looks, method="batch")[0])


UNKNOWN = """
[[unknown]]
name = "gimbal roll"
where = "gimbal_roll.zero_deg"
prior_mean = 0.0
prior_sigma = 0.05

[[unknown]]
name = "gimbal pitch"
where = "gimbal_pitch.zero_deg"
scale = 0.05
"""


def test_unknowns_of_the_flight(whiskjax, copied, tmp_path):
    copied.toml("[[error]]", UNKNOWN + "\n[[error]]")
    out = tmp_path / "out"
    assert whiskjax("locate", copied.path, "--out", out, *ASKED, "--estimate", "gimbal r*").exit_code == 0
    found, unknowns = json_of(out), wj.read_flight(copied.path).unknowns
    expected, _ = directly(copied.path, estimate=unknowns[:1])
    agree(found, expected)
    (row,) = found["parameters"]
    assert (row["role"], row["unit"], row["prior_sigma"]) == ("estimated", "deg", pytest.approx(0.05))
    assert row["value"] == pytest.approx(np.degrees(float(expected.value[0])), rel=1e-9)
    assert row["sigma"] == pytest.approx(np.degrees(np.sqrt(float(expected.estimate.covariance[0, 0]))), rel=1e-9)
    for words, parts in (
        (["--estimate", "all"], ["gimbal pitch has no prior sigma"]),
        (["--consider", "gimbal rol"], ["--consider: no unknown 'gimbal rol'", "did you mean 'gimbal roll'?"]),
        (["--consider", "gimbal roll", "--estimate", "gimbal roll"], ["gimbal roll: an unknown is estimated or considered"]),
    ):
        refused = whiskjax("locate", copied.path, "--out", out, *ASKED, *words)
        assert refused.exit_code == 1 and all(part in refused.stderr for part in parts)


def test_an_inconsistent_result_is_written_and_ends_in_three(whiskjax, copied, tmp_path):
    """Navigation said to be ten times better than it is."""
    copied.toml("[0.03, 0.03, 0.08]", "[0.003, 0.003, 0.008]").toml("[10.0, 10.0, 20.0]", "[1.0, 1.0, 2.0]")
    out = tmp_path / "out"
    result = whiskjax("locate", copied.path, "--out", out, *ASKED)
    assert result.exit_code == 3 and "This location is not sound:" in result.stdout and "more than chance" in result.stdout
    assert names(out) == WRITTEN
    assert not json_of(out)["verdict"]["is_sound"]
    assert not json.loads((out / "target.geojson").read_text(encoding="utf-8"))["features"][0]["properties"]["is_sound"]
    assert "not sound" in (out / "report.html").read_text(encoding="utf-8")


def test_a_given_position_that_contradicts_ends_in_three(whiskjax, copied, located, tmp_path):
    """The target is a check point: 0.02 deg of latitude are two kilometres."""
    assert json_of(located[1])["verdict"]["is_sound"]
    rows = copied.rows("points.csv")
    k = rows[0].index("lat_deg")
    rows[1][k] = repr(float(rows[1][k]) + 0.02)
    copied.store("points.csv", rows)
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", *ASKED)
    found = json_of(tmp_path / "out")
    assert result.exit_code == 3 and not found["verdict"]["is_sound"]
    assert any("the given position lies" in reason["text"] for reason in found["verdict"]["reasons"])


def test_the_height_of_a_target_may_be_known(whiskjax, copied, tmp_path):
    """Looks in one moment give a line; with the target's height they give the point, and the verdict says what decides."""
    copied.keep_lines("observations.csv", lambda line: line == 2)
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", *ASKED, "--height-sigma", 10)
    found = json_of(tmp_path / "out")
    agree(found, directly(copied.path, surface_sigma_m=10.0)[0])
    assert found["position"]["height_m"] == pytest.approx(HEIGHT, abs=30)
    assert "height" in {reason["kind"] for reason in found["verdict"]["reasons"]}
    assert "--height-sigma 10" in found["command"] and result.exit_code == (0 if found["verdict"]["is_sound"] else 3)


def test_one_look_gives_a_line_and_no_answer(whiskjax, copied, located, tmp_path):
    copied.keep_lines("observations.csv", lambda line: line == 2)
    out = shutil.copytree(located[1], tmp_path / "out")  # results of an earlier run, which must go
    result = whiskjax("locate", copied.path, "--out", out, *ASKED)
    assert result.exit_code == 3 and "do not determine the distance" in result.stdout and "the line: through" in result.stdout
    assert names(out) == WRITTEN - MAPS - FIGURES
    found = json_of(out)
    assert found["position"] is found["accuracy"] is found["truth"] is None and found["maps"]["written"] == []
    # The platform is up that line: 15.6 km away at 33 deg above the horizon, seen from the target.
    assert found["line"]["elevation_deg"] == pytest.approx(33, abs=1)
    assert [row["lat_deg"] for row in read_csv(out / "looks.csv")] == [""]


BAD = {
    "target": (["--target", "targte"], ["--target: no point 'targte' (did you mean 'target'?)", "points.csv has target"]),
    "part of a list": (["--target", "target,other"], ["no point 'other'"]),
    "gate": ([*ASKED, "--gate", 2], ["gate is a probability between 0 and 1"]),
    "degrees": ([*ASKED[:4], "--sigma-enu", 0.015, 0.015, 1500], ["look like degrees"]),
    "negative sigma": ([*ASKED[:4], "--sigma-enu", 0, 10, 1500], ["positive definite"]),
    "gate that is no number": ([*ASKED, "--gate", "nan"], ["--gate nan"]),
    "sigma below zero": ([*ASKED[:4], "--sigma-enu", -10, 10, 1500], ["--sigma-enu -10 10 1500", "positive"]),
    "sigma of no height": ([*ASKED[:2], "--height-sigma", 5], ["--height-sigma", "--height is known"]),
    "sigma of the height below zero": ([*ASKED, "--height-sigma", -5], ["--height-sigma -5", "positive"]),
    "height that is no number": ([*ASKED[:2], "--height", "inf"], ["--height inf"]),
    "above the platform": (
        [*ASKED[:2], "--height", 20000],
        ["the first look gives no first guess", "misses the ground", "20000 m, and --height"],
    ),
    "no height": (["--target", "target"], ["--height is needed", "no control points", "--height 500"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_ends_in_one_and_leaves_nothing(whiskjax, looks, tmp_path, case):
    words, parts = BAD[case]
    result = whiskjax("locate", looks, "--out", tmp_path / "out", *words)
    assert result.exit_code == 1 and result.stdout == "" and result.stderr.startswith("whiskjax: error: ")
    assert not [part for part in parts if part not in result.stderr], result.stderr
    assert names(tmp_path) == set()


def test_a_point_that_nobody_looked_at(whiskjax, copied, tmp_path):
    header, row = copied.rows("points.csv")
    copied.store("points.csv", [header, row, ["other", *row[1:]]])
    result = whiskjax("locate", copied.path, "--out", tmp_path / "out", "--target", "other", "--height", HEIGHT)
    assert result.exit_code == 1 and "nobody looked at it" in result.stderr


@pytest.mark.parametrize(
    "words", [[], ["--target", "target", "--method", "best"], ["--target", "target", "--sigma-enu", "1", "2"]]
)
def test_wrong_usage_ends_in_two(whiskjax, looks, tmp_path, words):
    out = ["--out", tmp_path / "out"] if words else []
    assert whiskjax("locate", looks, *out, *words).exit_code == 2
    assert names(tmp_path) == set()


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """A tie point without coordinates and a control point in a local world, seen by six frames without times."""
    rng = np.random.default_rng(2)
    n, target, control = 6, np.array([12.0, -7.0, 103.0]), np.array([60.0, 40.0, 98.0])
    position = np.stack([np.linspace(-200, 200, n), 50.0 * (-1.0) ** np.arange(n), np.full(n, 600.0)], axis=-1)
    sensor = wj.Sensor(
        {"body": wj.PosePerImage(position, np.tile([0.0, 0, 0, 1], (n, 1)))}, wj.FrameCamera(4000.0, (2000.0, 1500.0))
    )
    shot = wj.Shot(image=np.arange(n))
    seen = [np.asarray(wj.project(sensor, shot, np.tile(p, (n, 1))).pixel_px) for p in (target, control)]
    pixel = np.concatenate(seen) + rng.normal(0, 0.5, (2 * n, 2))
    half = np.full(2 * n, 0.5)
    flight = wj.Flight(
        name="a local block",
        sensor=sensor,
        images=[Image(f"frame {i}", columns=4001, rows=3001) for i in range(n)],
        points=Points(["house", "mark"], np.array([[np.nan] * 3, control]), np.zeros((2, 3)), ["tie", "control"]),
        measurements=Measurements(np.tile(np.arange(n), 2), np.repeat([0, 1], n), pixel[:, 1], pixel[:, 0], half, half),
        world=World("local"),
    )
    return wj.write_flight(flight, tmp_path_factory.mktemp("block") / "flight"), target


def test_a_local_world_has_a_plane_and_no_maps(whiskjax, block, tmp_path):
    folder, target = block
    out = tmp_path / "out"
    result = whiskjax("locate", folder, "--target", "house", "--out", out)
    assert result.exit_code == 0 and "mean height of the control points, 98.0 m" in result.stdout
    assert "no map: maps need latitude and longitude" in result.stdout
    assert names(out) == WRITTEN - MAPS
    found, flight = json_of(out), wj.read_flight(folder)
    expected = wj.locate(
        flight.sensor,
        flight.looks([0])[0],
        surface=wj.Plane((0.0, 0.0, 98.0), (0.0, 0.0, 1.0)),
        sigma_enu_m=np.array(found["guess"]["sigma_enu_m"]),
    )
    np.testing.assert_allclose([found["position"][key] for key in ("x_m", "y_m", "z_m")], expected.point_m, rtol=0, atol=1e-9)
    assert np.abs(np.asarray(expected.point_m) - target).max() < 0.5 and found["truth"] is None
    assert found["looks"]["first_time_s"] is None
    assert any("no errors of its recorded poses" in warning for warning in found["warnings"])


def test_the_command_can_be_repeated(located, looks):
    """The command in results.json holds every option that was given."""
    words = json_of(located[1])["command"].split()
    assert words[:3] == ["whiskjax", "locate", str(looks)]
    for option, value in (("--target", "target"), ("--height", "1000"), ("--sigma-enu", "2000")):
        assert words[words.index(option) + 1] == value


def test_a_flight_is_not_written_over(whiskjax, looks):
    before = names(looks)
    assert whiskjax("locate", looks, "--out", looks, *ASKED).exit_code == 1
    assert names(looks) == before


def test_the_extended_filter_is_the_papers(whiskjax, looks, tmp_path):
    result = whiskjax("locate", looks, "--out", tmp_path / "out", *ASKED, "--method", "extended")
    expected, _ = directly(looks, method="extended", throw=False)
    assert result.exit_code == (0 if expected.is_sound else 3)
    agree(json_of(tmp_path / "out"), expected)
