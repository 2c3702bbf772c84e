"""Where results may go: said before the work, and nothing of somebody else's is lost."""

import json
import os
import shutil
from pathlib import Path

import pytest

from whiskjax.app.output import refuse_place, result_folder
from whiskjax.files import carry, place, whole_folder
from whiskjax.rules import FlightError

OURS = ("results.json", "report.html", "table.csv", "calibrated")


def run(out, version="1", more=(), ours=OURS):
    """What a verb does: ask first, write later."""
    refuse_place(out, ours)
    with result_folder(out, ours) as folder:
        (folder / "results.json").write_text(json.dumps({"version": version, "figure": 0.1, "none": None}))
        (folder / "report.html").write_text(f"version {version}")
        for name in more:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(name + version)


def names(folder):
    return sorted(path.name for path in Path(folder).iterdir())


def refused(out, *parts, ours=OURS, flight=None):
    """The place is refused by a message that holds all parts and begins with the option."""
    with pytest.raises(FlightError) as caught:
        refuse_place(out, ours, flight)
    message = str(caught.value)
    assert message.startswith("--out ")
    missing = [part for part in parts if part not in message]
    assert not missing, f"{missing} not in: {message}"


@pytest.fixture
def results(tmp_path):
    """A folder of results with a flight in it."""
    run(tmp_path / "out", "1", ("calibrated/flight.toml", "calibrated/pos.csv", "table.csv"))
    return tmp_path / "out"


def test_places_that_lead_nowhere(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to("gone")
    (tmp_path / "circle").symlink_to("circle")
    refused(tmp_path / "dangling", "a link to gone, which does not exist", "remove the link")
    refused(tmp_path / "dangling" / "new", "a link to gone")
    refused(tmp_path / "circle", "circle")
    refused(tmp_path / "file", "is a file", "give the name of a folder")
    refused(tmp_path / "file" / "new", "is a file")
    refused(tmp_path / ("n" * 300), "too long")
    refused(tmp_path / ("n" * 300) / "new", "too long")
    refused(tmp_path / "new" / ("n" * 300), "too long")
    refused(tmp_path / "a\0b", "zero byte")
    assert names(tmp_path) == ["circle", "dangling", "file"]


def test_places_that_cannot_be_renamed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for out in (".", "..", "", "../", str(tmp_path)):
        refused(Path(out), "the folder that you are in", "inside")
    refused(Path("/"), "mounted")
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    run(tmp_path / "out")  # who stands nowhere can still name a place


def test_places_that_cannot_be_written(tmp_path, monkeypatch):
    if Path("/proc/self").exists():
        refused(Path("/proc/new"), "/proc")

    def full(handle):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(place.os, "fsync", full)
        refused(tmp_path / "out", "nothing can be written", "No space left", str(tmp_path))
    with monkeypatch.context() as patch:
        patch.setattr(place.os, "access", lambda path, how: Path(path) != tmp_path)
        refused(tmp_path / "out", f"you may not write in {tmp_path}")
        refused(tmp_path / "a" / "b" / "out", f"you may not write in {tmp_path}")
    assert names(tmp_path) == []


def test_flights_are_only_read(tmp_path, results):
    flight = tmp_path / "flight"
    flight.mkdir()
    (flight / "flight.toml").write_text("")
    refused(flight, "holds a flight", flight=flight)
    refused(flight, "holds a flight")
    refused(flight / "new", "lies in the flight", flight=flight)
    (tmp_path / "link").symlink_to("flight")
    refused(flight / "new", "lies in the flight", flight=tmp_path / "link")
    refused(tmp_path / "link", "holds a flight")
    refused(results, "calibrated", "would replace", flight=results / "calibrated")
    assert names(flight) == ["flight.toml"]


def test_a_link_to_a_folder_stays_one(tmp_path, results):
    (tmp_path / "link").symlink_to("out")
    run(tmp_path / "link", "2")
    assert (tmp_path / "link").is_symlink() and "2" in (results / "report.html").read_text()
    assert names(tmp_path) == ["link", "out"]


def test_results_of_an_earlier_run_are_replaced_whole(results):
    """Those of another verb too: what it alone wrote goes, as it belongs to a result that is no longer there."""
    run(results, "2", ("other.csv",), ours=("results.json", "report.html", "other.csv"))
    assert names(results) == ["other.csv", "report.html", "results.json"]
    listed = json.loads((results / "results.json").read_text())
    assert listed["version"] == "2" and set(listed["files"]) == {"other.csv", "report.html", "results.json"}


def test_the_list_is_of_sha256(results):
    """As `printf 'version 1' | sha256sum` has it."""
    listed = json.loads((results / "results.json").read_text())["files"]
    assert listed["report.html"] == "b19f8edae2ee6c225b7278b289c2823ab9accfa225c5d67c4bef270b88ea55f0"
    assert {*listed} == {"results.json", "report.html", "table.csv", "calibrated/flight.toml", "calibrated/pos.csv"}


def test_files_of_others_go_along(results):
    """The very same files, so that a program that writes into one goes on doing so."""
    (results / "notes.txt").write_text("mine")
    (results / "mine" / "deep").mkdir(parents=True)
    (results / "mine" / "deep" / "data").write_text("deep")
    (results / "mine" / "up").symlink_to("../notes.txt")
    (results / "mine" / "nowhere").symlink_to("nowhere")
    (results / "mine").chmod(0o2750)
    results.chmod(0o2770)
    os.utime(results / "mine", (1e9, 1e9))
    before = (results / "notes.txt").stat().st_ino
    with (results / "log.txt").open("w") as log:
        log.write("first ")
        run(results, "2")
        log.write("second")
    assert names(results) == ["log.txt", "mine", "notes.txt", "report.html", "results.json"]
    assert (results / "log.txt").read_text() == "first second"
    assert (results / "notes.txt").stat().st_ino == before and (results / "notes.txt").stat().st_nlink == 1
    assert (results / "mine" / "up").read_text() == "mine" and os.readlink(results / "mine" / "nowhere") == "nowhere"
    assert (results / "mine" / "deep" / "data").read_text() == "deep"
    assert (results / "mine").stat().st_mode & 0o7777 == 0o2750 and (results / "mine").stat().st_mtime == 1e9
    assert results.stat().st_mode & 0o7777 == 0o2770


def test_files_of_others_are_copied_where_there_are_no_hard_links(results, monkeypatch):
    (results / "mine").mkdir()
    (results / "mine" / "data").write_text("deep")
    (results / "mine" / "link").symlink_to("data")

    def none(*arguments, **more):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(carry.os, "link", none)
    run(results, "2")
    assert (results / "mine" / "data").read_text() == "deep" and (results / "mine" / "link").is_symlink()


def change(path, text="changed"):
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)


STRANGERS = {
    "added to the flight": (lambda out: change(out / "calibrated" / "notes.txt"), "calibrated/notes.txt is there"),
    "changed in the flight": (lambda out: change(out / "calibrated" / "pos.csv"), "calibrated/pos.csv was changed"),
    "changed report": (lambda out: change(out / "report.html"), "report.html was changed"),
    "changed figures": (
        lambda out: change(out / "results.json", (out / "results.json").read_text().replace("0.1", "0.2")),
        "results.json was changed",
    ),
    "folder for a file": (lambda out: (out / "table.csv").unlink() or (out / "table.csv").mkdir(), "table.csv is there"),
    "link for a file": (
        lambda out: (out / "table.csv").rename(out / "x") and (out / "table.csv").symlink_to("x"),
        "table.csv is there",
    ),
    "link for the flight": (
        lambda out: (out / "calibrated").rename(out / "x") and (out / "calibrated").symlink_to("x"),
        "calibrated is there",
    ),
}


@pytest.mark.parametrize("case", STRANGERS)
def test_what_others_did_to_results_is_not_replaced(results, case):
    spoil, message = STRANGERS[case]
    spoil(results)
    before = {path: path.read_bytes() for path in results.rglob("*") if path.is_file()}
    refused(results, message, "move it away, or give another folder")
    assert {path: path.read_bytes() for path in results.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("name", ["calibrated/thesis.tex", "report.html", "results.json"])
def test_a_folder_of_others(tmp_path, name):
    """Names that we would write, in a folder where we never were; all else there is no obstacle."""
    out = tmp_path / "out"
    change(out / "data.txt")
    run(out)
    shutil.rmtree(out)
    out.mkdir()
    change(out / name, "[]")
    refused(out, name, "not of an earlier run")
    (out / name).unlink()
    if "/" in name:
        refused(out, "calibrated is there")  # an empty folder is somebody's too


def test_what_appears_during_the_work_is_not_replaced_either(results):
    before = (results / "report.html").read_text()
    refuse_place(results, OURS)
    with pytest.raises(FlightError, match=r"report\.html was changed"), result_folder(results, OURS) as folder:
        (folder / "results.json").write_text("{}")
        (results / "report.html").write_text("edited")
    assert (results / "report.html").read_text() == "edited" != before
    assert names(results.parent) == ["out"] and "calibrated" in names(results)


def test_a_folder_that_was_taken_for_another(tmp_path, monkeypatch):
    monkeypatch.setattr(carry, "MOST", 50)
    (tmp_path / "home" / "many").mkdir(parents=True)
    for k in range(51):
        (tmp_path / "home" / "many" / str(k)).write_text("")
    refused(tmp_path / "home", "more than 50 files of others")


@pytest.mark.parametrize("name", ["n" * 255, "ä" * 127, "-", "a b", "a\nb", "$x_{$", "*[0-9]*", ".hidden"])
def test_any_name(tmp_path, name):
    for version in ("1", "2"):
        run(tmp_path / name, version)
    assert names(tmp_path) == [name] and "2" in (tmp_path / name / "report.html").read_text()


def test_the_dead_are_cleared_away_and_the_living_left(tmp_path):
    """Work folders of a run that died, of one at work, and of somebody else, whatever their names promise."""
    out = tmp_path / "out"
    dead, alive, strange = (tmp_path / f".out.writing-{word * 2}" for word in ("dead", "live", "odd_"))
    for folder in (dead, alive):
        (folder / "new").mkdir(parents=True)
        (folder / "new" / "results.json").write_text("{}")
        (folder / "lock").write_text("")
    strange.mkdir()
    (strange / "thesis.tex").write_text("")
    (tmp_path / ".out.writing-x.writing-deaddead").mkdir()
    held = whole_folder.hold(alive / "lock")
    refuse_place(out, OURS)
    left = [".out.writing-livelive", ".out.writing-odd_odd_", ".out.writing-x.writing-deaddead"]
    assert names(tmp_path) == left
    run(out)
    assert names(tmp_path) == [*left, "out"]
    os.close(held)
    run(out, "2")
    assert names(tmp_path) == [*left[1:], "out"]


WORDS = {
    "calibrate": ("nowhere",),
    "adjust": ("nowhere",),
    "locate": ("nowhere", "--target", "T"),
    "simulate haian": ("--seed", 1),
    "simulate tianshan": ("--seed", 1),
    "simulate songshan": ("--seed", 1),
    "reproduce whiskbroom": (),
    "reproduce location": (),
    "reproduce three-line": (),
}


@pytest.mark.parametrize("verb", WORDS)
def test_every_verb_asks_before_it_reads_or_computes(whiskjax, tmp_path, verb):
    (tmp_path / "dangling").symlink_to("gone")
    result = whiskjax(*verb.split(), *WORDS[verb], "--out", tmp_path / "dangling")
    assert result.exit_code == 1 and result.stdout == ""
    assert result.stderr.startswith(f"whiskjax: error: --out {tmp_path}/dangling: ") and "does not exist" in result.stderr
    assert names(tmp_path) == ["dangling"]
