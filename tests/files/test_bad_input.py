"""One thing is wrong in a flight folder: the message names the file, the line and the column, and the remedy."""

import math

import pytest

import whiskjax as wj
from tests.files.folder import Folder

# What is done to the haian folder, and what the message must hold. Lines count from 1, the header included.
CELLS = {
    "latitude 120": (("pos.csv", 7, "lat_deg", "120.5"), ("pos.csv, line 7, column lat_deg", "120.5", "-90 to 90", "swapped?")),
    "longitude 400": (("pos.csv", 3, "lon_deg", "400"), ("pos.csv, line 3, column lon_deg", "degrees")),
    "height in mm": (("pos.csv", 3, "height_m", "3.0e9"), ("pos.csv, line 3, column height_m", "metres")),
    "roll 2000": (("pos.csv", 4, "roll_deg", "2000"), ("pos.csv, line 4, column roll_deg", "'2000'", "-360 to 360", "degrees")),
    "pitch 400": (("pos.csv", 4, "pitch_deg", "400"), ("pos.csv, line 4, column pitch_deg", "-360 to 360")),
    "text": (("pos.csv", 9, "heading_deg", "3O"), ("pos.csv, line 9, column heading_deg", "'3O' is not a number")),
    "NaN": (("pos.csv", 9, "height_m", "nan"), ("pos.csv, line 9, column height_m", "not a finite number")),
    "infinite": (("pos.csv", 9, "time_s", "inf"), ("pos.csv, line 9, column time_s", "not a finite number")),
    "blank": (("pos.csv", 9, "roll_deg", ""), ("pos.csv, line 9, column roll_deg", "is blank")),
    "time repeats": (
        ("pos.csv", 3, "time_s", "-0.1"),
        ("pos.csv, line 3, column time_s", "repeats that of line 2", "duplicates"),
    ),
    "time goes back": (("pos.csv", 4, "time_s", "-3"), ("pos.csv, line 4, column time_s", "less than that of line 3", "sort")),
    "encoder NaN": (("encoders.csv", 5, "scan_deg", "NaN"), ("encoders.csv, line 5, column scan_deg", "not a finite number")),
    "encoder time": (("encoders.csv", 5, "time_s", "-0.1"), ("encoders.csv, line 5, column time_s", "less than that of line 4")),
    "unknown image": (("observations.csv", 6, "image", "L9"), ("observations.csv, line 6, column image", "'L9'", "L1, R1, L2")),
    "unknown point": (
        ("observations.csv", 6, "point", "L1-5"),
        ("observations.csv, line 6, column point", "'L1-5'", "did you mean 'L1-", "points.csv has L1-01", "(231 in all)"),
    ),
    "unknown swing": (
        ("images.csv", 3, "swing", "wright"),
        ("images.csv, line 3, column swing", "did you mean 'right'", "left, right"),
    ),
    "no swing": (("images.csv", 3, "swing", ""), ("images.csv, line 3, column swing", "is blank", "left, right")),
    "image twice": (("images.csv", 4, "image", "L1"), ("images.csv, line 4, column image", "'L1' is there twice", "line 2")),
    "half a row": (("images.csv", 4, "image", ""), ("images.csv, line 4, column image", "is blank")),
    "lines of nothing": (("lines.csv", 2, "image", "X"), ("lines.csv, line 2, column image", "'X'", "L1, R1")),
    "lines go back": (("lines.csv", 3, "line", "-5"), ("lines.csv, line 3, column line", "image L1", "less than that of line 2")),
    "line times repeat": (("lines.csv", 3, "time_s", "0"), ("lines.csv, line 3, column time_s", "repeats that of line 2")),
    "line outside": (
        ("observations.csv", 2, "line", "20000"),
        ("observations.csv, line 2, column line", "20000", "image L1", "lines.csv", "0 to 18762"),
    ),
    "sigma zero": (("observations.csv", 2, "sigma_line_px", "0"), ("observations.csv, line 2, column sigma_line_px", "positive")),
    "measurement NaN": (
        ("observations.csv", 2, "sample", "nan"),
        ("observations.csv, line 2, column sample", "not a finite number"),
    ),
    "measurement blank": (("observations.csv", 2, "sample", ""), ("observations.csv, line 2, column sample", "is blank")),
    "role": (("points.csv", 8, "role", "contol"), ("points.csv, line 8, column role", "'contol'", "control, check, tie")),
    "point sigma": (("points.csv", 8, "sigma_u_m", "-1"), ("points.csv, line 8, column sigma_u_m", "not negative")),
    "point latitude": (("points.csv", 8, "lat_deg", "120.5"), ("points.csv, line 8, column lat_deg", "swapped?")),
    "point half blank": (("points.csv", 8, "height_m", ""), ("points.csv, line 8, column height_m", "is blank")),
    "far point": (
        ("points.csv", 2, "lat_deg", "3.249"),
        ("observations.csv, line 2", "image L1, point L1-01", "km from the platform", "swapped"),
    ),
}


@pytest.mark.parametrize("case", CELLS)
def test_one_wrong_cell(folder: Folder, case):
    edit, parts = CELLS[case]
    folder.cell(*edit).refused(*parts)


TOML = {
    "syntax": (("format = 1", "format 1"), ("flight.toml: not valid TOML", "line 1")),
    "format": (("format = 1", "format = 2"), ("flight.toml: format", "should be 1", "2")),
    "missing key": (
        ('name = "haian', 'nome = "haian'),
        ("flight.toml: name: this key is missing", "flight.toml: nome: no such key", "'name'"),
    ),
    "key of a link": (
        ("lever_arm_m", "lever_arm"),
        ("chain[2] (frame 'gps_arm').lever_arm", "did you mean 'lever_arm_m'", "angles_deg"),
    ),
    "key of a camera": (("focal_px", "focal"), ("camera.options.left.focal", "no such key", "principal_sample_px")),
    "key of [pos]": (("max_gap_s", "max_gap"), ("flight.toml: pos.max_gap", "'max_gap_s'")),
    "text for a number": (("max_gap_s = 0.02", 'max_gap_s = "0.02"'), ("flight.toml: pos.max_gap_s", "valid number", "'0.02'")),
    "no max_gap_s": (("max_gap_s = 0.02\n", ""), ("chain[0] (frame 'body')", "max_gap_s is missing", "[pos]")),
    "negative gap": (("max_gap_s = 0.02", "max_gap_s = -1"), ("flight.toml: pos.max_gap_s", "greater than 0")),
    "two angles": (
        ("angles_deg = [0.0, 0.0, 0.0]", "angles_deg = [0.0, 0.0]"),
        ("chain[3] (frame 'platform').options.left.angles_deg", "a list of 3 is expected"),
    ),
    "no such link": (
        ('link = "axes"', 'link = "axis"'),
        ("chain[1] (frame 'flu')", "link = 'axis' is unknown", "'axes'", "'mount'"),
    ),
    "no link": (('link = "axes"\n', ""), ("chain[1] (frame 'flu')", "the key link is missing")),
    "no frame": (('frame = "flu"\n', ""), ("chain[1]", "frame is missing")),
    "frame twice": (('frame = "flu"', 'frame = "body"'), ("chain[1]", "'body' is there twice")),
    "frame name": (('frame = "flu"', 'frame = "earth"'), ("flight.toml: chain[1]", "'earth' cannot name a frame")),
    "left-handed": (("x -y -z", "x -y z"), ("chain[1] (frame 'flu')", "left-handed")),
    "camera kind": (('kind = "line"', 'kind = "lines"'), ("camera.options.left", "kind = 'lines' is unknown", "'line'")),
    "focal length": (("focal_px = 10750.0", "focal_px = 0.0"), ("camera.options.left.focal_px", "greater than 0")),
    "unknown encoder": (
        ('encoder = "scan"', 'encoder = "skan"'),
        ("chain[4] (frame 'scan')", "no encoder 'skan'", "did you mean 'scan'", "encoders.csv, line 1", "scan, pitch"),
    ),
    "encoder file": (
        ('encoder = "scan"', 'encoder = {file = "e.csv", column = "scan"}'),
        ("e.csv does not exist", "chain[4]", "pos.csv"),
    ),
    "options in two orders": (("[camera.options.left]", "[camera.options.port]"), ("flight.toml", "use one order")),
    "another convention": (('"roll_pitch_heading"', '"opk"'), ("pos.csv, line 1", "roll_deg", 'angles = "roll_pitch_heading"')),
    "geoid": (('"ellipsoidal"', '"EGM96"'), ("EGM96", "heights are ellipsoidal")),
    "local world": (('kind = "wgs84"', 'kind = "local"'), ("pos.csv, line 1", "lat_deg in a local world", "x_m, y_m, z_m")),
    "pixel centre": (("first_pixel_centre = 0.0", "first_pixel_centre = 0.3"), ("pixel.first_pixel_centre", "0, 0.5 or 1")),
    "place": (("gps_arm.lever_arm_m[0]", "gps_arm.arm_m[0]"), ("unknown[0] (u_gps)", "no 'arm_m'", "lever_arm_m, angles_deg")),
    "place's link": (("gps_arm.lever_arm_m[0]", "gps.lever_arm_m[0]"), ("unknown[0] (u_gps)", "no link named 'gps'", "gps_arm")),
    "place's index": (("gps_arm.lever_arm_m[0]", "gps_arm.lever_arm_m[3]"), ("unknown[0] (u_gps)", "shape (3,)")),
    "place's unit": (
        ("left.angles_deg[0]", "left.angles_rad[0]"),
        ("unknown[3]", "degrees", "write platform.left.angles_deg[0]"),
    ),
    "place twice": (("gps_arm.lever_arm_m[0]", "gps_arm.lever_arm_m[1]"), ("unknown", "already estimated")),
    "no prior, no scale": (("prior_sigma = 0.2\n", ""), ("unknown[0]", "prior_mean and prior_sigma, or scale")),
    "wavelength": (
        ("[pos]", "[refraction]\nwavelength_um = 10.0\n\n[pos]"),
        ("flight.toml: refraction", "known from 0.23 to 1.69 um, not at 10.0 um"),
    ),
    "key of [refraction]": (
        ("[pos]", "[refraction]\npressure = 1.0\n\n[pos]"),
        ("flight.toml: refraction.pressure", "expected here: scale, wavelength_um"),
    ),
    "errors of no frame": (
        ("[pos]", '[[error]]\nframe = "bdoy"\nshift_sigma_m = [1.0, 1.0, 1.0]\n\n[pos]'),
        ("flight.toml: error[0].frame", "no frame 'bdoy'", "did you mean 'body'", "the chain has body, flu"),
    ),
    "negative errors": (
        ("[pos]", '[[error]]\nframe = "body"\nturn_sigma_deg = [0.1, -0.1, 0.1]\n\n[pos]'),
        ("flight.toml: error[0] (frame 'body').turn_sigma_deg[1]", "greater than or equal to 0", "-0.1"),
    ),
    "errors of two axes": (
        ("[pos]", '[[error]]\nframe = "body"\nturn_sigma_deg = [0.1, 0.1]\n\n[pos]'),
        ("error[0] (frame 'body').turn_sigma_deg", "a list of 3 is expected"),
    ),
    "errors without a sigma": (
        ("[pos]", '[[error]]\nframe = "body"\n\n[pos]'),
        ("error[0] (frame 'body')", "turn_sigma_deg, shift_sigma_m or both"),
    ),
    "key of [[error]]": (
        ("[pos]", '[[error]]\nframe = "body"\nsigma_m = 1.0\n\n[pos]'),
        ("error[0] (frame 'body').sigma_m", "expected here: frame, turn_sigma_deg, shift_sigma_m, correlation_s, anew, axes"),
    ),
    "the old table of noise": (
        ("[pos]", '[[noise]]\nframe = "body"\nshift_sigma_m = [1.0, 1.0, 1.0]\n\n[pos]'),
        ("flight.toml: noise: [[noise]] and [pos_errors] are one table now, [[error]]",),
    ),
    "the old table of POS errors": (
        ("[pos]", '[pos_errors]\nlink = "body"\n\n[pos]'),
        ("flight.toml: pos_errors: [[noise]] and [pos_errors] are one table now, [[error]]",),
    ),
    "the same errors twice": (
        ("[pos]", 2 * '[[error]]\nframe = "body"\nshift_sigma_m = [1.0, 1.0, 1.0]\n\n' + "[pos]"),
        ("error[1] (frame 'body')", "says exactly what one before it says"),
    ),
    "errors anew for what nobody knows": (
        ("[pos]", '[[error]]\nframe = "body"\nshift_sigma_m = [1.0, 1.0, 1.0]\nanew = "day"\n\n[pos]'),
        ("error[0] (frame 'body').anew", "'flight', 'strip', 'image', 'swing' or 'view'"),
    ),
    "upside down": (("x -y -z", "x y z"), ("observations.csv, line 2 (image L1, point L1-01)", "behind the camera", "signs")),
}


@pytest.mark.parametrize("case", TOML)
def test_one_wrong_entry(folder: Folder, case):
    edit, parts = TOML[case]
    message = folder.toml(*edit).refused(*parts)
    assert "flight.toml" in message or ".csv" in message


SHEETS = {
    "column missing": (lambda f: f.drop_column("pos.csv", "roll_deg"), ("pos.csv, line 1", "roll_deg is missing", "pitch_deg")),
    "column renamed": (
        lambda f: f.rename("pos.csv", "roll_deg", "rol_deg"),
        ("pos.csv, line 1", "roll_deg is missing", "did you mean 'rol_deg'"),
    ),
    "column unknown": (
        lambda f: f.add_column("points.csv", "color", "red"),
        ("points.csv, line 1", "'color'", "expected are point, lat_deg"),
    ),
    "column twice": (lambda f: f.add_column("pos.csv", "roll_deg", "0"), ("pos.csv, line 1", "'roll_deg' is there twice")),
    "two positions": (lambda f: f.add_column("pos.csv", "x_m", "0"), ("pos.csv, line 1", "given twice", "lat_deg", "x_m")),
    "no position": (lambda f: f.drop_column("points.csv", "lat_deg"), ("points.csv, line 1", "lat_deg is missing")),
    "half a velocity": (lambda f: f.add_column("pos.csv", "vn_mps", "1"), ("pos.csv, line 1", "ve_mps is missing")),
    "swapped headers": (
        lambda f: f.rename("pos.csv", "lat_deg", "t").rename("pos.csv", "lon_deg", "lat_deg").rename("pos.csv", "t", "lon_deg"),
        ("pos.csv, line 2, column lat_deg", "swapped?"),
    ),
    "cell too many": (lambda f: f.text("lines.csv", "L1,0,0", "L1,0,0,5"), ("lines.csv, line 2", "4 cells", "3 columns")),
    "semicolons": (
        lambda f: [(f.path / "lines.csv").write_text((f.path / "lines.csv").read_text().replace(",", ";")), f][1],
        ("lines.csv, line 1", "commas"),
    ),
    "not text": (lambda f: [(f.path / "lines.csv").write_bytes(b"\xff\xfe\x00"), f][1], ("lines.csv", "UTF-8")),
    "empty file": (lambda f: [(f.path / "lines.csv").write_text(""), f][1], ("lines.csv, line 1", "header")),
    "file missing": (
        lambda f: [(f.path / "lines.csv").unlink(), f][1],
        ("lines.csv does not exist", "line camera", "points.csv"),
    ),
    "no observations": (lambda f: f.keep_lines("observations.csv", lambda i: False), ("observations.csv", "no observations")),
    "no images": (lambda f: f.keep_lines("images.csv", lambda i: False), ("images.csv", "no images")),
    "one POS sample": (lambda f: f.keep_lines("pos.csv", lambda i: i == 2), ("pos.csv", "1 samples", "at least two")),
    "one line": (lambda f: f.keep_lines("lines.csv", lambda i: i != 3), ("lines.csv, line 2, column line", "single line")),
    "image without lines": (lambda f: f.keep_lines("lines.csv", lambda i: i > 3), ("images.csv, line 2", "'L1' has no lines")),
    "before the POS": (
        lambda f: f.keep_lines("pos.csv", lambda i: i > 400),
        (
            "observations.csv, line 2 (image L1, point L1-01)",
            "outside the recorded samples",
            "'body' was recorded from 1.89",
            "47 of 231",
        ),
    ),
    "in a gap": (
        lambda f: f.keep_lines("pos.csv", lambda i: i == 2 or i > 600),
        ("observations.csv, line", "image L1", "in a gap", "'body' has samples at -0.100000 and 2.8", "max_gap_s is 0.02"),
    ),
    "encoder in a gap": (
        lambda f: f.keep_lines("encoders.csv", lambda i: i == 2 or i > 600),
        ("observations.csv, line", "in a gap", "'scan' has samples at"),
    ),
    "contradictory role": (
        lambda f: f.repeat_line("points.csv", 2, role="check"),
        ("points.csv, line 3, column role", "contradictory role", "control in line 2", "check here"),
    ),
    "point twice": (lambda f: f.repeat_line("points.csv", 2), ("points.csv, line 3, column point", "twice", "line 2")),
    "measured twice": (
        lambda f: f.repeat_line("observations.csv", 5),
        ("observations.csv, line 6", "same measurement", "line 5"),
    ),
    "control without place": (
        lambda f: (
            f.cell("points.csv", 2, "lat_deg", "").cell("points.csv", 2, "lon_deg", "").cell("points.csv", 2, "height_m", "")
        ),
        ("points.csv, line 2, column lat_deg", "control point", "only ties"),
    ),
}


@pytest.mark.parametrize("case", SHEETS)
def test_one_wrong_sheet(folder: Folder, case):
    edit, parts = SHEETS[case]
    edit(folder).refused(*parts)


def test_pos_in_radians(folder):
    """Numbers that could be degrees, but put the platform on the other side of the Earth."""
    rows = folder.rows("pos.csv")
    radians = [[row[0], *(repr(math.radians(float(v))) for v in row[1:3]), row[3], *row[4:]] for row in rows[1:]]
    folder.store("pos.csv", [rows[0], *radians])
    folder.refused("observations.csv, line 2 (image L1, point L1-01)", "km from the platform", "another unit")


def test_unknown_view(copy_of):
    copy_of("scanner").cell("images.csv", 2, "view", "for").refused(
        "images.csv, line 2, column view", "did you mean 'fore'", "fore, aft look"
    )


def test_look_table_that_looks_up(copy_of):
    copy_of("scanner").cell("looks.csv", 4, "z", "1").refused("looks.csv, line 4, column z", "-z", "axes link")


def test_frames(copy_of):
    """What only frame cameras can get wrong."""
    copy_of("frames").cell("poses.csv", 3, "image", "8899").refused("poses.csv, line 3, column image", "'8899'", "8811, 8812")


def test_a_frame_has_no_lines(copy_of):
    copy_of("frames").rename("observations.csv", "sigma_line_px", "sigma_lines").refused(
        "observations.csv, line 1", "sigma_lines is of line cameras", "give sigma_line_px"
    )


def test_image_without_a_pose(copy_of):
    copy_of("frames").keep_lines("poses.csv", lambda i: i != 4).refused(
        "images.csv, line 4, column image", "'8813' has no line in poses.csv"
    )


def test_quaternion_length(copy_of):
    copy_of("frames").cell("poses.csv", 3, "qx", "0.9").refused("poses.csv, line 3", "length of the quaternion")


def test_one_focal_length_missing(copy_of):
    copy_of("frames").cell("images.csv", 3, "focal_px", "").refused(
        "images.csv, line 3, column focal_px", "is blank", "other images"
    )


def test_focal_length_twice(copy_of):
    folder = copy_of("frames").toml('kind = "frame"', 'kind = "frame"\nfocal_px = 4000.0')
    folder.refused("camera.options.left", "images.csv, column focal_px", "keep one")


def test_lines_of_a_frame_camera(copy_of):
    folder = copy_of("frames")
    (folder.path / "lines.csv").write_text("image,line,time_s\n")
    folder.refused("lines.csv", "frame camera", "remove")


def test_no_folder(tmp_path):
    with pytest.raises(wj.FlightError, match="not a folder"):
        wj.read_flight(tmp_path / "nowhere")
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(wj.FlightError, match=r"no flight.toml.*notes.txt"):
        wj.read_flight(tmp_path)
