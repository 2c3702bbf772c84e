"""The page that documents the folder is right: its example is a flight, and it names every key and column."""

import re
from pathlib import Path

import numpy as np
import pytest

import whiskjax as wj
from tests.files.folder import Folder
from whiskjax.chain.imaging import Projection
from whiskjax.files import measured, navigation, schema, source
from whiskjax.locate.look_by_look import LookByLook

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


SAID = (
    "Of a line camera the second coordinate, and its sigma, are focal-plane pixels across the line at the shot's time, not "
    "lines: one line is `px_per_line` of them."
)


def test_what_the_second_coordinate_of_a_line_camera_is():
    """One sentence, wherever it is spoken of."""
    speakers = (wj.Observations, wj.Block, wj.Looks, wj.LineCamera, wj.Calibration, wj.Adjustment, wj.ray, wj.project)
    told = {x.__name__: x.__doc__ for x in (*speakers, wj.image_to_ground, wj.intersect, Projection, LookByLook)}
    told |= {"flight-folder.md": PAGE, "conventions.md": (Path(__file__).parents[2] / "docs" / "conventions.md").read_text()}
    assert [name for name, text in told.items() if SAID not in " ".join(text.split())] == []


def test_every_key_is_documented():
    models = {schema.FlightTable, *schema.LINKS.values(), *schema.CAMERAS.values(), *schema.TABLES.values()}
    for model in models:
        for key in model.model_fields:
            assert f"`{key}`" in PAGE or f"[{key}]" in PAGE or f"{key} =" in PAGE or f", {key}" in PAGE, f"{model.__name__}.{key}"
    for name in (*schema.LINKS, *schema.CAMERAS):
        assert f"**`{name}`**" in PAGE, name


def test_every_column_is_documented():
    known = [
        measured.SIGMA_LINE_PX,
        measured.SIGMA_LINES,
        *navigation._COLUMNS,
        *(name for names in navigation.VELOCITIES for name in names),
    ]
    for name in (*known, *(column.name for column in source._IMAGE_COLUMNS)):
        assert f"`{name}`" in PAGE, name
