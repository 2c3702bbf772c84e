"""The sound flights that are spoiled: the three simulated scenes, and two real ones."""

import dataclasses
import tempfile
from pathlib import Path

import whiskjax as wj
from tests.real import convert_ign_frame, convert_misb_uas
from tests.real.sets import data_folder
from whiskjax.flights import haian, songshan, tianshan


def of_haian():
    return haian.simulate(7)


def of_songshan():
    return songshan.simulate(songshan.Scene(ties=60), 1)


def of_tianshan():
    """The target is a control point."""
    flight = tianshan.simulate(3)
    return dataclasses.replace(flight, points=dataclasses.replace(flight.points, roles=["control"]))


def _converted(convert, source):
    with tempfile.TemporaryDirectory() as folder:
        convert(source, Path(folder) / "flight")
        return wj.read_flight(Path(folder) / "flight")


def of_ign_frame():
    return _converted(convert_ign_frame.convert, data_folder() / "ign_frame")


def of_misb_uas():
    return _converted(convert_misb_uas.convert, data_folder() / "misb_uas" / "cheyenne.csv")


SIMULATED = {"haian": of_haian, "songshan": of_songshan, "tianshan": of_tianshan}
REAL = {"ign_frame": of_ign_frame, "misb_uas": of_misb_uas}
