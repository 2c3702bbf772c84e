"""One simulated flight and one calibration of it, both made by the command line."""

import pytest
from typer.testing import CliRunner

from whiskjax.app.command_line import app


@pytest.fixture(scope="session")
def whiskjax():
    """Run the command in this process; returns exit code, standard output and standard error."""

    def run(*words):
        result = CliRunner().invoke(app, [str(word) for word in words])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return run


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    """No test writes into the user's cache folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def flight(whiskjax, tmp_path_factory):
    """A flight folder; not to be changed."""
    folder = tmp_path_factory.mktemp("flights") / "haian"
    assert whiskjax("simulate", "haian", "--seed", 5, "--out", folder).exit_code == 0
    return folder


@pytest.fixture(scope="session")
def calibrated(whiskjax, flight, tmp_path_factory):
    """(the command's result, the folder it wrote); not to be changed."""
    out = tmp_path_factory.mktemp("results") / "new" / "haian"
    return whiskjax("calibrate", flight, "--out", out), out
