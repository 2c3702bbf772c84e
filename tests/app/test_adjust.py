"""`whiskjax adjust`, from a folder to a report: its numbers are those of `wj.adjust`, and bad input is refused by name."""

import csv
import json
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import whiskjax as wj
from tests.app.said import progress
from tests.files.folder import Folder
from whiskjax.flights import songshan

TABLES = {"unknowns.csv", "adjusted_points.csv", "residuals.csv", "corrections.csv"}
FIGURES = {
    "residual_vectors.png",
    "point_errors.png",
    "detector_residuals.png",
    "trajectory_corrections.png",
    "point_sigmas.png",
}
WRITTEN = {"results.json", "report.html", "adjusted", *TABLES, *FIGURES}
SCENE = songshan.Scene("B", ties=60)


def names(folder):
    return {path.name for path in folder.iterdir()}


def json_of(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def heavier(folder, factor=1.5):
    """Sigmas of rays as large as errors are: vibration and the detector's wave come on top of the measuring noise."""
    rows = folder.rows("observations.csv")
    places = [rows[0].index(name) for name in ("sigma_line_px", "sigma_sample_px")]
    for row in rows[1:]:
        for k in places:
            row[k] = repr(factor * float(row[k]))
    return folder.store("observations.csv", rows)


@pytest.fixture(scope="module")
def strips(tmp_path_factory):
    """The folder of two strips with few tie points; not to be changed."""
    folder = wj.write_flight(songshan.simulate(SCENE, 1), tmp_path_factory.mktemp("strips") / "flight")
    return heavier(Folder(folder)).path


@pytest.fixture
def copied(strips, tmp_path):
    """A copy of it to be spoilt."""
    return Folder(shutil.copytree(strips, tmp_path / "flight"))


@pytest.fixture(scope="module")
def adjusted(whiskjax, strips, tmp_path_factory):
    """(the command's result, the folder it wrote); not to be changed."""
    out = tmp_path_factory.mktemp("adjusted") / "new" / "out"
    return whiskjax("adjust", strips, "--out", out, "--direct", "--profile", 1000, "--terrain", "hilly"), out


@pytest.fixture(scope="module")
def expected(strips):
    """The same by the public functions."""
    flight = wj.read_flight(strips)
    return wj.adjust(flight.sensor, flight.block(), flight.unknowns, errors=flight.errors)


def test_a_sound_result_ends_in_zero_and_is_all_there(adjusted):
    result, out = adjusted
    assert result.exit_code == 0
    progress(result.stderr)
    assert names(out) == WRITTEN
    assert json_of(out)["verdict"]["is_sound"] and "This adjustment is sound:" in result.stdout.splitlines()


def test_results_are_those_of_adjust(adjusted, expected):
    found = json_of(adjusted[1])
    units = [x.unit.factor for x in expected.unknowns]
    np.testing.assert_allclose([row["value"] for row in found["unknowns"]], expected.value * units, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose([row["sigma"] for row in found["unknowns"]], expected.trust.sigma * units, rtol=1e-9)
    assert {row["start"] for row in found["unknowns"]} == {0.0}
    assert found["fit"]["variance_factor"] == pytest.approx(expected.variance_factor, rel=1e-9)
    check = [row for row in found["statistics"] if row["what"] == "check"]
    for row, axis in zip(check, expected.statistics(), strict=True):
        values = [row[key] for key in ("max_m", "min_m", "mean_m", "rmse_m", "n")]
        np.testing.assert_allclose(values, axis, rtol=0, atol=1e-9)
    assert found["warnings"] == list(expected.warnings)
    assert found["counts"]["points"] == {"all": 114, "control": 40, "check": 14, "tie": 60}


def test_tables_hold_every_ray_point_and_station(adjusted, expected):
    out = adjusted[1]
    points, rays = read_csv(out / "adjusted_points.csv"), read_csv(out / "residuals.csv")
    place = [[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in points]
    np.testing.assert_allclose(place, expected.point_m, rtol=0, atol=1e-9)
    np.testing.assert_allclose([float(row["x_px"]) for row in rays], expected.residual_px[:, 0], rtol=0, atol=1e-9)
    assert {row["used"] for row in rays} == {"yes"}
    link = expected.sensor["pos_error"]
    turns = [[float(row[f"turn_{axis}_deg"]) for axis in "xyz"] for row in read_csv(out / "corrections.csv")]
    np.testing.assert_allclose(turns, np.degrees(link.turn_rad), rtol=0, atol=1e-12)


def test_direct_positioning_is_that_of_both_sensors(adjusted, strips, expected):
    flight = wj.read_flight(strips)
    rows = {(row["what"], row["axis"]): row["rmse_m"] for row in json_of(adjusted[1])["statistics"]}
    for what, sensor in (("direct, before", flight.sensor), ("direct, after", expected.sensor)):
        for axis, of in zip(("east", "north", "up"), wj.direct_positioning(sensor, flight.block()).statistics(), strict=True):
            assert rows[what, axis] == pytest.approx(of.rmse, rel=1e-6)
    assert rows["direct, after", "up"] < 0.1 * rows["direct, before", "up"]


def test_the_adjusted_flight_needs_no_further_adjustment(adjusted, strips, expected):
    """Rays of its sensor meet control points where the adjustment left them: residuals are the same."""
    back = wj.read_flight(adjusted[1] / "adjusted")
    block = expected.block  # its rays are those of the folder, at the times when the fitted points cross the line
    np.testing.assert_array_equal(back.block().point, block.point)
    seen = wj.project(back.sensor, block.shot, expected.point_m[block.point]).pixel_px
    np.testing.assert_allclose(block.pixel_px - seen, expected.residual_px, rtol=0, atol=1e-6)
    assert back.errors == wj.read_flight(strips).errors != ()


def test_limits_are_checked(adjusted):
    found = json_of(adjusted[1])["standard"]
    assert [row["limit_m"] for row in found["limits"]] == [0.5, 0.4] and found["passes"]
    assert "1:1000, hilly" in found["name"] and "GB/T 23236" in adjusted[0].stdout


def test_not_converged_is_not_sound(whiskjax, strips, tmp_path):
    (tmp_path / "limits.toml").write_text('name = "strict"\nplanimetry_m = 0.001\n')
    words = ("--max-steps", 1, "--profile", tmp_path / "limits.toml")
    result = whiskjax("adjust", strips, "--out", tmp_path / "out", *words)
    assert result.exit_code == 3 and names(tmp_path / "out") == WRITTEN - {"adjusted"}
    found = json_of(tmp_path / "out")
    assert not found["verdict"]["is_sound"] and any("did not converge" in r["text"] for r in found["verdict"]["reasons"])
    assert not found["standard"]["passes"] and "strict: not met in planimetry" in found["warnings"]


@pytest.mark.parametrize(
    ("words", "code", "part"),
    [
        (("--terrain", "flat"), 2, "need a map scale"),
        (("--profile", "file.toml", "--terrain", "flat"), 2, "without a terrain"),
        (("--profile", 500), 1, "1000, 2000, 5000"),
        (("--profile", 1000, "--terrain", "swampy"), 1, "flat, hilly, mountainous, alpine"),
        (("--profile", 1000), 1, "flat, hilly, mountainous, alpine"),
        (("--profile", 1000, "--reweigh"), 1, "--reweigh --profile 1000 --terrain hilly"),
        (("--profile", 1000), 1, "0.28, 0.4, 0.6, 1.2 m"),
        (("--profile", ""), 1, "--profile ''"),
        (("--profile", "1000.0"), 1, "give a map scale"),
        (("--profile", "nowhere.toml"), 1, "nowhere.toml"),
        (("--max-steps", 0), 2, "max-steps"),
    ],
)
def test_wrong_words(whiskjax, strips, tmp_path, words, code, part):
    result = whiskjax("adjust", strips, "--out", tmp_path / "out", *words)
    assert result.exit_code == code and part in result.stderr and not list(tmp_path.iterdir())
    assert "None" not in result.stderr


def refused(whiskjax, folder, *parts):
    """The command ends in 1 with a message that holds all parts, and writes nothing."""
    out = folder.path.parent / "out"
    result = whiskjax("adjust", folder.path, "--out", out)
    assert result.exit_code == 1 and not out.exists()
    missing = [part for part in parts if part not in result.stderr]
    assert not missing, f"{missing} not in: {result.stderr}"


def lines_of(folder, point):
    """The lines of observations.csv that measure a point."""
    return [line for line, row in enumerate(folder.rows("observations.csv"), 1) if row[1] == point]


def test_a_tie_seen_once_is_left_out_and_listed(whiskjax, copied):
    _, *others = lines_of(copied, "T7")
    copied.keep_lines("observations.csv", lambda line: line not in others)
    out = copied.path.parent / "out"
    result = whiskjax("adjust", copied.path, "--out", out)
    found = json_of(out)
    assert result.exit_code == 0 and found["seen_once"] == ["T7"] and found["left_out"] == []
    assert found["counts"]["points_seen_once"] == 1 and found["counts"]["rays_left_out"] == 0
    assert (
        "warning: 1 check or tie point is seen by one ray only, which determines no point, and left out: T7"
        in result.stdout.splitlines()
    )
    assert any("1 check or tie point is seen by one ray only" in said for said in found["warnings"])
    (ray,) = [row for row in read_csv(out / "residuals.csv") if row["point"] == "T7"]
    (point,) = [row for row in read_csv(out / "adjusted_points.csv") if row["point"] == "T7"]
    assert (ray["used"], ray["x_px"], point["x_m"], point["rays"]) == ("no", "", "", "0")
    assert "T7" in (out / "report.html").read_text(encoding="utf-8")


def test_parallel_rays(whiskjax, copied):
    """All rays of a tie come from one place of one line of one image."""
    first, *others = lines_of(copied, "T7")
    rows = copied.rows("observations.csv")
    sample = rows[0].index("sample")
    for k, line in enumerate(others, 1):
        rows[line - 1] = [*rows[first - 1]]
        rows[line - 1][sample] = repr(float(rows[first - 1][sample]) + 1e-6 * k)
    refused(whiskjax, copied.store("observations.csv", rows), "point T7", "its rays do not meet", "parallel")


def test_a_strip_tied_to_nothing_and_no_control(whiskjax, copied):
    """Points of both strips become two ties each, one a strip, and control points check points: POS holds all."""
    rows, points, images = (copied.rows(f"{name}.csv") for name in ("observations", "points", "images"))
    strip_of = {row[0]: row[images[0].index("strip")] for row in images[1:]}
    both = set.intersection(*({row[1] for row in rows[1:] if strip_of[row[0]] == strip} for strip in ("east", "west")))
    assert both
    for row in rows[1:]:
        row[1] += "w" * (row[1] in both and strip_of[row[0]] == "west")
    role = points[0].index("role")
    more = [[f"{row[0]}w", *row[1:]] for row in points[1:] if row[0] in both]
    for row in [*points[1:], *more]:
        row[role] = "tie" if row[0].rstrip("w") in both or row[role] == "tie" else "check"
    copied.store("observations.csv", rows).store("points.csv", [*points, *more])
    out = copied.path.parent / "out"
    result = whiskjax("adjust", copied.path, "--out", out)
    found = json_of(out)
    assert found["solver"]["converged"] and found["counts"]["points"]["control"] == 0
    assert any("no point ties strip " in w and ("strip east" in w or "strip west" in w) for w in found["warnings"])
    assert any("the datum of the block rests on POS" in w for w in found["warnings"])
    assert "rests on POS" in result.stdout and "there is no control point" in result.stdout


def test_strips_in_the_wrong_order_of_time(whiskjax, copied):
    text = next(line for line in (copied.path / "flight.toml").read_text().splitlines() if "start_s = [" in line)
    start = text.split("start_s = [")[1].split("]")[0]
    copied.toml(f"start_s = [{start}]", f"start_s = [{', '.join(start.split(', ')[::-1])}]")
    refused(whiskjax, copied, "flight.toml", "pos_error", "segment 1 starts at 0 s, before segment 0 ends", "order")


@pytest.mark.parametrize(("column", "wrong", "known"), [("view", "nadyr", "forward, nadir, backward")])
def test_a_view_that_the_camera_lacks(whiskjax, copied, column, wrong, known):
    copied.cell("images.csv", 3, column, wrong)
    refused(whiskjax, copied, "images.csv, line 3", f"no view named '{wrong}'", "did you mean 'nadir'?", known)


def turned(folder, angle_deg):
    """The whole flight turned clockwise about the vertical, its attitudes as roll, pitch and heading from -180 to 180."""
    turn = Rotation.from_euler("Z", -angle_deg, degrees=True)
    level = Rotation.from_matrix([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # the world from north, east, down
    pos, points = (folder.rows(file) for file in ("pos.csv", "points.csv"))
    values = np.array(pos[1:], dtype=float)
    column = {name: k for k, name in enumerate(pos[0])}
    place = turn.apply(values[:, [column[name] for name in ("x_m", "y_m", "z_m")]])
    attitude = turn * Rotation.from_quat(values[:, [column[name] for name in ("qx", "qy", "qz", "qw")]])
    heading, pitch, roll = (level.inv() * attitude).as_euler("ZYX", degrees=True).T
    header = ["time_s", "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "heading_deg"]
    folder.store("pos.csv", [header, *np.column_stack([values[:, 0], place, roll, pitch, heading]).tolist()])
    where = [points[0].index(name) for name in ("x_m", "y_m", "z_m")]
    for row in points[1:]:
        if row[where[0]]:
            moved = turn.apply([float(row[k]) for k in where])
            for k, value in zip(where, moved.tolist(), strict=True):
                row[k] = repr(value)
    folder.store("points.csv", points).toml('angles = "quaternion"', 'angles = "roll_pitch_heading"')
    return heading, turn


def test_headings_at_180_degrees(copied, expected):
    """Strips that fly south, with headings on both sides of 180 deg, are the strips that fly west, turned."""
    heading, turn = turned(copied, -90.0)
    assert np.abs(np.diff(heading)).max() > 350
    flight = wj.read_flight(copied.path)
    found = wj.adjust(flight.sensor, flight.block(), flight.unknowns, errors=flight.errors)
    np.testing.assert_allclose((found.value - expected.value) / expected.trust.sigma, 0.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.point_m, turn.apply(expected.point_m), rtol=0, atol=1e-6)
    assert found.variance_factor == pytest.approx(expected.variance_factor, rel=1e-8)


def test_a_wrong_tie_is_left_out_and_named(whiskjax, copied):
    line = lines_of(copied, "T7")[1]
    sample = float(copied.cell("observations.csv", line, "sample"))
    image = copied.cell("observations.csv", line, "image")
    copied.cell("observations.csv", line, "sample", repr(sample + 60))
    out = copied.path.parent / "out"
    plain = whiskjax("adjust", copied.path, "--out", out)
    assert plain.exit_code == 3 and "T7" in {row["point"] for row in json_of(out)["largest_residuals"]}
    result = whiskjax("adjust", copied.path, "--out", out, "--blunders", "--reweigh")
    found = json_of(out)
    assert "T7" in {row["point"] for row in found["left_out"]} and found["counts"]["rays_left_out"] <= 6
    assert result.exit_code == 0 and "Rays left out as wrong" in result.stdout and image
    assert next(row["group"] for row in found["weights"]) == "tie rays"
    assert any(row["used"] == "no" and row["point"] == "T7" for row in read_csv(out / "residuals.csv"))


def test_errors_along_level_axes_of_a_local_world(whiskjax, copied):
    """GNSS heights err along the z of the world that the flight is in, as by the public function with that surface."""
    flight = wj.read_flight(copied.path)
    (frame,) = {one.frame for one in flight.errors}
    told = f'\n[[error]]\nframe = "{frame}"\nshift_sigma_m = [0.02, 0.02, 0.08]\naxes = "level"\n'
    file = copied.path / "flight.toml"
    file.write_text(file.read_text(encoding="utf-8") + told, encoding="utf-8")
    out = copied.path.parent / "out"
    assert whiskjax("adjust", copied.path, "--out", out).exit_code == 0
    flight = wj.read_flight(copied.path)
    assert [one.axes for one in flight.errors].count("level") == 1
    up = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    found = wj.adjust(flight.sensor, flight.block(), flight.unknowns, errors=flight.errors, surface=up)
    assert json_of(out)["fit"]["variance_factor"] == pytest.approx(found.variance_factor, rel=1e-9)
