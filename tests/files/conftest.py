"""Flight folders that tests read and spoil."""

import shutil

import pytest

import whiskjax as wj
from tests.files import made_up
from tests.files.folder import Folder


@pytest.fixture(scope="session")
def haian():
    """The whiskbroom flight in memory."""
    return wj.flights.haian.simulate(3)


@pytest.fixture(scope="session")
def written(haian, tmp_path_factory):
    """The folders of three flights by name; not to be changed."""
    parent = tmp_path_factory.mktemp("written")
    flights = {"haian": haian, "scanner": made_up.scanner(), "frames": made_up.frames()}
    return {name: wj.write_flight(flight, parent / name) for name, flight in flights.items()}


@pytest.fixture
def copy_of(written, tmp_path):
    """A function from a flight's name to a fresh copy of its folder."""
    return lambda name: Folder(shutil.copytree(written[name], tmp_path / name))


@pytest.fixture
def folder(copy_of):
    """A fresh copy of the haian folder."""
    return copy_of("haian")
