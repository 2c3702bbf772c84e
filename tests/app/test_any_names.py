"""Names in files are plain text: whatever they hold, a verb ends as it does with other names, and shows them as they are."""

import csv
import dataclasses
import html
import json
import shutil
import tomllib
from xml.etree import ElementTree

import numpy as np
import pytest

import whiskjax as wj
from tests.files.folder import Folder
from whiskjax.app.command import command_text
from whiskjax.files.toml_text import toml_text
from whiskjax.files.write import flight_files
from whiskjax.flights import haian, songshan, tianshan
from whiskjax.show.style import Drawing, new_figure, shortened

NAMES = (
    "$x_{$",
    "$",
    r"$\frac{a}{b}$",
    "<b>bold</b><script>alert(1)</script>",
    "a & b",
    "[red]red[/red] :cat:",
    "=1+1",
    'said "so", and',
    "x" * 300,
    "😀👩‍🚀 点 ñ",
    "{{ 7 * 7 }} {% raw %}",
    "a/b\\c/../..",
    "%s %(x)s {0}",
    "_under",
    "non\u00a0breaking",
)
FLIGHT = "flight $x_{$ <i>& [bold]\nsecond line"


def other_names(names):
    """Each name's other name: unlike all the rest."""
    return {name: NAMES[k] if k < len(NAMES) else f"{NAMES[k % len(NAMES)]}{k}" for k, name in enumerate(names)}


def renamed(path):
    """All names of a flight folder that no address holds are replaced; returns them by file."""
    folder, found = Folder(path), {}
    for file, columns in (("images.csv", ("image", "strip")), ("points.csv", ("point",))):
        rows = folder.rows(file)
        for column in columns:
            if column in rows[0]:
                k = rows[0].index(column)
                found[column] = other_names(dict.fromkeys(row[k] for row in rows[1:]))
    for file in ("images.csv", "points.csv", "observations.csv", "lines.csv"):
        if (folder.path / file).exists():
            rows = folder.rows(file)
            for column in {*found} & {*rows[0]}:
                k = rows[0].index(column)
                for row in rows[1:]:
                    row[k] = found[column][row[k]]
            folder.store(file, rows)
    toml = tomllib.loads((folder.path / "flight.toml").read_text())
    unknowns = other_names(unknown["name"] for unknown in toml.get("unknown", ()))
    for unknown in toml.get("unknown", ()):
        unknown["name"] = unknowns[unknown["name"]]
    (folder.path / "flight.toml").write_text(toml_text(toml | {"name": FLIGHT}))
    return found | {"unknown": unknowns}


def read_csv(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def all_shown(out, names):
    """Every name is in report.html as it is, and no part of one acts as HTML; returns results.json."""
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "<script" not in page and "<b>" not in page and "<i>" not in page
    text = html.unescape(page)
    assert [name for name in (FLIGHT, *names) if name not in text] == []
    found = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert found["flight"] == FLIGHT
    return found


def all_printed(stdout, names):
    """Short names stand in the tables as they are; long ones are wrapped, and no character of theirs is lost."""
    squeezed = "".join(stdout.split())
    assert [name for name in names if len(name) < 14 and "".join(name.split()) not in squeezed] == []
    assert stdout.count("x") >= 300


def test_calibrate(whiskjax, flight, calibrated, tmp_path):
    """The figures are those of the flight with the names that it was simulated with."""
    names, out = renamed(shutil.copytree(flight, tmp_path / "flight")), tmp_path / "out"
    result = whiskjax("calibrate", tmp_path / "flight", "--out", out)
    assert result.exit_code == calibrated[0].exit_code == 0
    unknowns, images = list(names["unknown"].values()), set(names["image"].values())
    found = all_shown(out, unknowns)
    expected = json.loads((calibrated[1] / "results.json").read_text(encoding="utf-8"))
    assert [p["name"] for p in found["parameters"]] == unknowns
    for key in ("value", "sigma"):
        np.testing.assert_allclose([p[key] for p in found["parameters"]], [p[key] for p in expected["parameters"]], rtol=1e-9)
    all_printed(result.stdout, unknowns)
    assert [row["name"] for row in read_csv(out / "parameters.csv")] == unknowns
    assert {row["image"] for row in read_csv(out / "residuals.csv")} == images
    back = wj.read_flight(out / "calibrated")
    assert back.name == f"{FLIGHT}, calibrated" and [x.name for x in back.unknowns] == unknowns


def test_adjust(whiskjax, tmp_path):
    """Strips too, which head the columns of figures."""
    folder = Folder(wj.write_flight(songshan.simulate(songshan.Scene("B", ties=60), 1), tmp_path / "flight"))
    names, out = renamed(folder.path), tmp_path / "out"
    result = whiskjax("adjust", folder.path, "--out", out)
    assert result.exit_code in (0, 3), result.stderr
    unknowns = list(names["unknown"].values())
    found = all_shown(out, [*unknowns, *names["strip"].values()])
    assert [x["name"] for x in found["unknowns"]] == unknowns
    all_printed(result.stdout, unknowns)
    points, rays = read_csv(out / "adjusted_points.csv"), read_csv(out / "residuals.csv")
    assert [row["point"] for row in points] == list(names["point"].values())
    assert {row["image"] for row in rays} == set(names["image"].values())


@pytest.mark.parametrize("target", ["$x_{$ 😀👩‍🚀, <b>[red] a-[0-9]*", "x" * 300])
def test_locate(whiskjax, tmp_path, target):
    """The target's name goes into figures, pages and maps, and is a name even where it reads like a pattern."""
    folder = Folder(wj.write_flight(tianshan.simulate(3, tianshan.Scene(path="race", looks=12)), tmp_path / "flight"))
    for file in ("points.csv", "observations.csv"):
        rows = folder.rows(file)
        k = rows[0].index("point")
        folder.store(file, [rows[0], *([*row[:k], target, *row[k + 1 :]] for row in rows[1:])])
    names, out = renamed_images(folder), tmp_path / "out"
    result = whiskjax("locate", folder.path, "--target", target, "--out", out, "--height", 1000, "--sigma-enu", 2000, 2100, 1500)
    assert result.exit_code == 0, result.stderr
    all_shown(out, [target])
    assert [row["image"] for row in read_csv(out / "looks.csv")] == list(names)
    features = json.loads((out / "target.geojson").read_text(encoding="utf-8"))["features"]
    assert {feature["properties"]["name"] for feature in features} == {target}
    space = "{http://www.opengis.net/kml/2.2}"
    assert ElementTree.parse(out / "target.kml").find(f".//{space}Folder/{space}name").text == target


def renamed_images(folder):
    """Images and flight only, as the target has been renamed; the names of the images."""
    rows, seen = folder.rows("images.csv"), folder.rows("observations.csv")
    other = other_names(row[0] for row in rows[1:])
    folder.store("images.csv", [rows[0], *([other[row[0]], *row[1:]] for row in rows[1:])])
    k = seen[0].index("image")
    folder.store("observations.csv", [seen[0], *([*row[:k], other[row[k]], *row[k + 1 :]] for row in seen[1:])])
    toml = tomllib.loads((folder.path / "flight.toml").read_text())
    (folder.path / "flight.toml").write_text(toml_text(toml | {"name": FLIGHT}))
    return other.values()


ODD = {"escape": "\x1b[31m", "zero": "\0", "return": "a\rb", "C1": "\x9b31m", "no character": "\uffff"}


@pytest.mark.parametrize("case", ODD)
def test_what_no_page_can_show_is_refused_by_name(whiskjax, flight, tmp_path, case):
    """Control characters, which terminals obey and maps cannot hold: named at reading, not after the solve."""
    folder = shutil.copytree(flight, tmp_path / "flight")
    toml = tomllib.loads((folder / "flight.toml").read_text())
    toml["unknown"][3]["name"] = ODD[case]
    (folder / "flight.toml").write_text(toml_text(toml))
    result = whiskjax("calibrate", folder, "--out", tmp_path / "out")
    assert result.exit_code == 1 and f"flight.toml: unknown {ODD[case]!r} holds the character U+00" in result.stderr.replace(
        "U+FF", "U+00"
    )
    with pytest.raises(wj.FlightError, match="unknown"):
        wj.write_flight(
            dataclasses.replace(wj.read_flight(flight), unknowns=[wj.Unknown(ODD[case], "sensor.angles_rad[0]", scale=1.0)]),
            tmp_path / "f",
        )


def test_names_in_names_of_files(tmp_path):
    """Frames and options name tables: whatever they hold stays in the folder, and is read back."""
    t = np.linspace(0.0, 10.0, 21)
    long, odd = "x" * 300, "点" * 120
    turns = {name: wj.Turn("x", wj.Encoder(t + k, 0.01 * t * (k + 1), 1.0)) for k, name in enumerate((long, f"{long}y", odd))}
    flight = haian.simulate(5)
    links = {**dict(zip(flight.sensor.names, flight.sensor.links, strict=True)), **turns}
    flight = dataclasses.replace(flight, sensor=wj.Sensor(links, flight.sensor.camera))
    files = flight_files(flight)
    assert all(len(name) < 255 and "/" not in name for name in files)
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    toml = tomllib.loads(files["flight.toml"])
    for link in toml["chain"][-3:]:
        encoder = link["encoder"]
        file, column = (encoder["file"], encoder["column"]) if isinstance(encoder, dict) else ("encoders.csv", encoder)
        assert f"{column}_deg" in files[file].split("\n", 1)[0].split(",")


def test_a_figure_reads_no_text_as_mathematics():
    """Titles, labels, ticks, legends and notes; and characters that no font has."""
    figure = new_figure(4.0)
    axes = figure.subplots()
    axes.plot([1, 2], [1e-3, 1e3], label="$a_{$")
    axes.set_yscale("log")
    axes.set(title="$b_{$ 😀", xlabel="$c_{$", ylabel=r"$\frac{$")
    axes.set_xticks([1, 2], ["$d_{$", "点"])
    axes.annotate("$e_{$", (1, 1))
    axes.text(1, 1, "$f_{$")
    axes.legend(title="$g_{$")
    figure.suptitle("$h_{$")
    drawing = Drawing("name", "title", "caption", figure)
    assert drawing.png.startswith(b"\x89PNG")
    assert "10⁻³" in [tick.get_text() for tick in axes.get_yticklabels()]


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_has_room_for_every_name(name):
    found = shortened(name, 20)
    assert len(found) <= 20 and (found == name or (len(name) > 10 and "…" in found))
    assert shortened("a" * 50 + "1", 20) != shortened("a" * 50 + "2", 20)


def test_a_path_that_is_no_text():
    """Bytes of a file name that are not UTF-8 are shown by number, as results.json is text."""
    path = b"out\xff".decode("utf-8", "surrogateescape")
    assert command_text(["whiskjax", "calibrate", path]) == "whiskjax calibrate 'out\\xff'"
