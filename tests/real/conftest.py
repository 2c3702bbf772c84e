"""Each set is converted and calibrated once for all tests of a worker."""

import json

import pytest

from tests.real import reach_clarreo, reach_ign_frame, reach_misb_uas, reach_rtk_drone
from tests.real.sets import data_folder, missing

SETS = {module.SET: module for module in (reach_clarreo, reach_ign_frame, reach_misb_uas, reach_rtk_drone)}


@pytest.fixture(scope="session")
def source_of():
    """A function from a set's name to its folder; skips where it is not there."""

    def find(name):
        source = data_folder() / name
        if why := missing(source):
            pytest.skip(why)
        return source

    return find


@pytest.fixture(scope="session")
def reached_on(source_of, tmp_path_factory):
    """A function from a set's name to what `python -m tests.real` reaches on it."""
    done = {}

    def reach(name):
        if name not in done:
            done[name] = SETS[name].reach(source_of(name), tmp_path_factory.mktemp("real"))
        return done[name]

    return reach


@pytest.fixture(scope="session")
def assert_met(reached_on):
    """A function that fails with every figure of a set that is not as good as asked."""

    def check(name):
        asked = [f for f in reached_on(name).figures if f.asked is not None]
        assert asked
        assert not [f"{f.what}: {f.reached:g} {f.unit}, asked {f.asked_text}" for f in asked if not f.is_met]

    return check


@pytest.fixture
def calibrate_by_command(tmp_path):
    """A function that runs `whiskjax calibrate` on a folder, and gives its results.json."""
    pytest.importorskip("typer", reason="the command needs the extra: pip install 'whiskjax[app]'")
    from typer.testing import CliRunner

    from whiskjax.app.command_line import app

    def run(folder, *options):
        out = tmp_path / "out"
        answer = CliRunner().invoke(app, ["calibrate", str(folder), "--out", str(out), *options])
        assert answer.exit_code == 0, answer.output
        return json.loads((out / "results.json").read_text())

    return run
