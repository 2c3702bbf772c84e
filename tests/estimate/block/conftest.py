"""One small block of the three-line camera and its adjustment, shared by the tests of this room."""

import pytest

import whiskjax as wj
from tests.estimate.block.textbook import SCENES
from whiskjax.flights import songshan

SCENE = SCENES["orientation images"]


@pytest.fixture(scope="session")
def drawn():
    return songshan.simulate_block(SCENE, 2)


@pytest.fixture(scope="session")
def adjusted(drawn):
    errors = songshan.frame_errors(SCENE)
    return wj.adjust(drawn.sensor, drawn.block, songshan.unknowns(SCENE), errors=errors, retime=False)
