"""Writing is all or nothing, and destroys nothing that is not a flight."""

import dataclasses
import math
import os
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whiskjax as wj
from tests.files import made_up
from whiskjax.chain.link import Given
from whiskjax.files import whole_folder, write
from whiskjax.files.tables import exact, rounded
from whiskjax.files.toml_text import toml_text
from whiskjax.files.units import degrees


@pytest.fixture(scope="module")
def frames():
    return made_up.frames()


def test_refuses_what_is_in_the_way(frames, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(wj.FlightError, match="is a file"):
        wj.write_flight(frames, tmp_path / "file")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("")
    for overwrite in (False, True):
        with pytest.raises(wj.FlightError, match="not empty and not a flight folder"):
            wj.write_flight(frames, tmp_path / "full", overwrite=overwrite)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "full"]


def test_overwrites_only_a_flight(frames, tmp_path):
    folder = wj.write_flight(frames, tmp_path / "new" / "flight")
    with pytest.raises(wj.FlightError, match="overwrite=True"):
        wj.write_flight(frames, folder)
    (folder / "old.csv").write_text("")
    wj.write_flight(frames, folder, overwrite=True)
    assert not (folder / "old.csv").exists()
    (folder / "thesis.tex").write_text("")
    with pytest.raises(wj.FlightError, match=r"thesis\.tex"):
        wj.write_flight(frames, folder, overwrite=True)
    assert (folder / "thesis.tex").exists() and (folder / "flight.toml").exists()
    assert os.listdir(tmp_path / "new") == ["flight"]


def test_an_empty_folder_is_filled(frames, tmp_path):
    (tmp_path / "empty").mkdir()
    wj.write_flight(frames, tmp_path / "empty")
    assert wj.read_flight(tmp_path / "empty").name == frames.name


ALIGNED = {
    "Records": (lambda: {"body": wj.Records(0.1, 0.2, 900.0)}, "link 'body': Records cannot .* use a Trajectory.from_geodetic"),
    "Readings": (
        lambda: {"scan": wj.Turn("x", wj.Readings(np.array([0.1, 0.2])))},
        "link 'scan': Turn by Readings cannot .* use an Encoder",
    ),
}


@pytest.mark.parametrize("case", ALIGNED)
def test_what_has_no_times_is_refused(frames, tmp_path, case):
    """And the message says what to use instead."""
    links, message = ALIGNED[case]
    odd = dataclasses.replace(frames, sensor=wj.Sensor(links(), wj.FrameCamera(1e3, jnp.zeros(2))))
    with pytest.raises(wj.FlightError, match=message):
        wj.write_flight(odd, tmp_path / "flight")


ERRORS = {
    "each look": (
        [wj.FrameErrors("body", (np.array([1e-3, 2e-3]), 0, 0))],
        "errors of 'body': a sigma for each exposure has no form",
    ),
    "no frame": ([wj.FrameErrors("gimbal", (1e-3, 0, 0))], "no frame named 'gimbal'; there are body, mount"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_errors_that_have_no_form_are_refused(frames, tmp_path, case):
    errors, message = ERRORS[case]
    with pytest.raises(wj.FlightError, match=message):
        wj.write_flight(dataclasses.replace(frames, errors=errors), tmp_path / "flight")


def test_the_same_errors_twice_are_no_flight(frames):
    with pytest.raises(wj.WhiskjaxError, match=r"Flight: errors\[1\] of 'body' says exactly what one before it says"):
        dataclasses.replace(frames, errors=[wj.FrameErrors("body", (1e-3, 0, 0)) for _ in range(2)])


def test_nothing_is_left_of_a_failure(frames, tmp_path, monkeypatch):
    """Neither half a new flight, nor a lost old one: on refusal, on a full disk, and when the last step fails."""
    odd = wj.Flight(**{**vars(frames), "sensor": wj.Sensor({"body": Given(0)}, wj.FrameCamera(1e3, jnp.zeros(2)))})
    with pytest.raises(wj.FlightError, match="'body' is a Given"):
        wj.write_flight(odd, tmp_path / "flight")
    assert os.listdir(tmp_path) == []
    folder = wj.write_flight(frames, tmp_path / "flight")
    before = {p.name: p.read_bytes() for p in folder.iterdir()}

    def no_space(*args, **kwargs):
        raise OSError("no space left on device")

    monkeypatch.setattr(write.Path, "write_text", no_space)
    with pytest.raises(OSError, match="no space"):
        wj.write_flight(frames, folder, overwrite=True)
    monkeypatch.undo()
    monkeypatch.setattr(whole_folder, "exchange", no_space)
    with pytest.raises(OSError, match="no space"):
        wj.write_flight(frames, folder, overwrite=True)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert os.listdir(tmp_path) == ["flight"]


def test_haian_is_small_and_readable(written):
    folder = written["haian"]
    assert sum(p.stat().st_size for p in folder.iterdir()) < 1e6
    text = (folder / "flight.toml").read_text()
    assert '[[chain]]\nframe = "flu"\nlink = "axes"\naxes = "x -y -z"\n' in text
    assert "lever_arm_m = [0.0, 0.0, 0.0]\n" in text
    assert 'where = "platform.left.angles_deg[0]"\nprior_mean = 0.0\nprior_sigma = 5.0\n' in text
    assert (folder / "lines.csv").read_text().startswith("image,line,time_s\nL1,0,0\n")


def test_encoders_share_a_file_where_they_share_a_clock(written):
    names = sorted(p.name for p in written["scanner"].iterdir() if p.name.startswith("encoders"))
    assert names == ["encoders.csv", "encoders_tilt.csv"]
    assert (written["scanner"] / "encoders_tilt.csv").read_text().splitlines()[0] == "time_s,tilt_deg"


def test_names_that_become_one(haian):
    """Two options whose names differ only in what file names cannot hold, each with its own clock and table."""
    encoders = [wj.Encoder(np.arange(3) + k, np.arange(3) * 0.1, 1.5) for k in (0.0, 0.1)]
    looks = [np.array([[x, 0, -1.0], [1, 0, -1]]) for x in (-1.0, -2.0, -3.0)]
    names = ["a b", "a-b", "a/b"]
    links = {
        "body": haian.sensor["body"],
        "arm": wj.By("view", {n: wj.Turn("x", e) for n, e in zip(names, [*encoders, encoders[0]], strict=True)}),
    }
    cameras = wj.By("view", {n: wj.LookTable([0.0, 1.0], d) for n, d in zip(names, looks, strict=True)})
    images = [dataclasses.replace(haian.images[0], view="a-b")]
    m = dataclasses.replace(
        haian.measurements, **{f.name: getattr(haian.measurements, f.name)[:1] for f in dataclasses.fields(haian.measurements)}
    )
    flight = dataclasses.replace(haian, sensor=wj.Sensor(links, cameras), images=images, measurements=m, unknowns=())
    files = write.flight_files(flight)
    assert {n for n in files if n.startswith("looks")} == {"looks.csv", "looks_a_b.csv", "looks_a_b_2.csv"}
    assert {n for n in files if n.startswith("encoders")} == {"encoders.csv", "encoders_arm_a_b.csv"}
    toml = tomllib.loads(files["flight.toml"])
    assert [toml["camera"]["options"][n].get("file") for n in names] == [None, "looks_a_b.csv", "looks_a_b_2.csv"]
    assert toml["chain"][1]["options"]["a/b"]["encoder"] == toml["chain"][1]["options"]["a b"]["encoder"] == "arm_a_b"


@given(st.floats(-1e4, 1e4))
def test_degrees(value):
    assert math.radians(degrees(value)) == pytest.approx(value, rel=2.3e-16, abs=0)


@pytest.mark.parametrize("nice", [0.03, 5.0, -0.0051, 90.3, 1e-4, 359.75])
def test_degrees_that_people_wrote(nice):
    assert degrees(math.radians(nice)) == nice


@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.sampled_from([1e-12, 1e-6, 1e-3]))
def test_rounded(values, tolerance):
    back = np.array([float(t) for t in rounded(values, tolerance)])
    # Decimals end at 14, beyond the rounding of a float64 of this size.
    assert np.all(np.abs(back - values) <= tolerance + 2e-16 * np.abs(values))


@given(st.lists(st.floats(allow_infinity=False), min_size=1))
def test_exact(values):
    back = np.array([float(t or "nan") for t in exact(values)])
    np.testing.assert_array_equal(back, np.array(values) + 0.0)


keys = st.text(min_size=1, max_size=8)
leaves = st.one_of(
    st.text(max_size=30), st.integers(-(2**40), 2**40), st.floats(allow_nan=False, allow_infinity=False), st.booleans()
)
items = st.one_of(leaves, st.lists(leaves), st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False))))
tables = st.recursive(
    st.dictionaries(keys, items), lambda inner: st.dictionaries(keys, st.one_of(items, inner, st.lists(inner))), max_leaves=6
)


@given(tables)
def test_toml(table):
    assert tomllib.loads(toml_text(table)) == table
