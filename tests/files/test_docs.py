"""The page that documents the folder is right: its example is a flight, and it names every key and column."""

import re
from pathlib import Path

import numpy as np
import pytest

import whiskjax as wj
from tests.files.folder import Folder
from whiskjax.files import navigation, schema, source

PAGE = (Path(__file__).parents[2] / "docs" / "flight-folder.md").read_text()


@pytest.fixture
def example(tmp_path):
    for name, text in re.findall(r"`([\w.]+)`\n\n```(?:toml|csv)\n(.*?)```", PAGE, re.DOTALL):
        (tmp_path / name).write_text(text)
    return Folder(tmp_path)


def test_example_is_a_flight(example):
    flight = wj.read_flight(example.path)
    o = flight.observations()
    assert [u.name for u in flight.unknowns] == ["lever z", "omega", "phi", "kappa"]
    pixel = np.asarray(wj.project(flight.sensor, o.shot, o.point_m).pixel_px)
    assert np.abs(pixel - o.pixel_px).max() < 2e-3  # the points of the example have 8 decimals


def test_every_key_is_documented():
    models = {schema.FlightTable, *schema.LINKS.values(), *schema.CAMERAS.values(), *schema.TABLES.values()}
    for model in models:
        for key in model.model_fields:
            assert f"`{key}`" in PAGE or f"[{key}]" in PAGE or f"{key} =" in PAGE or f", {key}" in PAGE, f"{model.__name__}.{key}"
    for name in (*schema.LINKS, *schema.CAMERAS):
        assert f"**`{name}`**" in PAGE, name


def test_every_column_is_documented():
    known = [*navigation._COLUMNS, *(name for names in navigation.VELOCITIES for name in names)]
    for name in (*known, *(column.name for column in source._IMAGE_COLUMNS)):
        assert f"`{name}`" in PAGE, name
