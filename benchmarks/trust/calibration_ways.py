"""The catalogue of ways to be wrong in a calibration."""

import equinox as eqx
import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from .calibration_spoils import (
    blunders,
    coherent,
    copies,
    fading,
    late,
    measured,
    number,
    one_pose,
    one_record,
    prior,
    respread,
    respread_witness,
    sample_px,
    scan,
    smooth,
    stated,
    stated_witness,
    surveyed,
    then,
    time_s,
    turned_record,
    weak,
)  # fmt: skip
from .calibrations import EQUAL, Calibrations
from .score import scaled
from .way import Kind, Spoil, Way, nothing

SCENE = Calibrations()
_INFINITE = lambda case: float("inf")  # copies have no density beside what is stated
_BOTH = ("L1", "R1")
_ALIKE = (
    ("correlated in time, 0.3 s", fading(time_s, 0.3)),
    ("correlated in time, half of the variance", fading(time_s, 1.0, 0.5)),
    ("correlated along the detector", fading(sample_px, 500.0)),
)
_FACTORS = (2.0, 3.0, 30.0)


def _negated(sensor: wj.Sensor, turn: str) -> wj.Sensor:
    return eqx.tree_at(lambda s: s[turn].encoder.angle_rad, sensor, -sensor[turn].encoder.angle_rad)


def _reordered(sensor: wj.Sensor) -> wj.Sensor:
    return haian.sensor(sensor["body"], sensor["scan"].encoder, sensor["pitch"].encoder, scan_first=False)


def _other_axes(sensor: wj.Sensor) -> wj.Sensor:
    links = dict(zip(sensor.names, sensor.links, strict=True)) | {"flu": wj.Axes("y x -z")}
    return wj.Sensor(links, sensor.camera)


def _way(name: str, spoil: Spoil, kind: Kind = "scored") -> Way:
    return Way(name, SCENE, spoil, kind)


CLEAN = (
    Way("clean", SCENE, nothing, "clean"),
    Way("clean, reweighed", Calibrations(reweigh=wj.Reweigh()), nothing, "clean"),
    Way("clean, reweighed with priors", Calibrations(reweigh=wj.Reweigh(priors=True)), nothing, "clean"),
    Way("clean, equal priors", Calibrations(EQUAL), nothing, "clean"),
    Way("clean, equal priors, reweighed", Calibrations(EQUAL, wj.Reweigh()), nothing, "clean"),
    Way("clean, equal priors, reweighed with them", Calibrations(EQUAL, wj.Reweigh(priors=True)), nothing, "clean"),
    Way("clean, control in one corner", SCENE, weak, "clean"),
)

WAYS = (
    _way("one blunder of 15 sigma", blunders(1, 15.0)),
    _way("blunders scattered, 10 %", blunders(13, 10.0)),
    _way("blunders scattered, 20 %, reweighed", then(blunders(26, 150.0), reweigh=wj.Reweigh())),
    _way("blunders scattered, 10 %, snooped", then(blunders(13, 10.0), blunders=wj.Blunders())),
    _way("blunders clustered, first of a scan", coherent("L1", (12.0, 6.0), slice(0, 10))),
    _way("blunders clustered, middle of a scan", coherent("L1", (12.0, 6.0), slice(27, 37))),
    _way("blunders clustered, last of a scan", coherent("R1", (12.0, 6.0), slice(-10, None))),
    _way("blunders clustered, snooped", then(coherent("L1", (12.0, 6.0), slice(27, 37)), blunders=wj.Blunders())),
    _way("half an image off, snooped", then(coherent("L1", (40.0, 0.0), slice(0, 33)), blunders=wj.Blunders())),
    _way("control of one image off, both axes", coherent("L1", (8.0, 8.0))),
    _way("control of one image off, samples", coherent("R1", (8.0, 0.0))),
    _way("control of one image off, lines", coherent("R1", (0.0, 8.0))),
    Way("copies, ten of each", SCENE, copies(10), witness=_INFINITE, shifts=False),
    Way("copies, ten of each, 1e-6 px apart", SCENE, copies(10, 1e-6), witness=lambda case: scaled(1e-6, 2 * 117), shifts=False),
    Way("copies, ten of each, renamed", SCENE, copies(10, 0.0, True), witness=_INFINITE, shifts=False),
    Way(
        "copies, five of each, renamed, 1e-6 px apart",
        SCENE,
        copies(5, 1e-6, True),
        witness=lambda case: scaled(1e-6, 2 * 104),
        shifts=False,
    ),
    # Surveys and the jitter of POS, a twentieth of the variance, stay each measurement's own.
    Way(
        "one record behind ten measurements",
        SCENE,
        respread(one_record(10)),
        "scored",
        respread_witness(one_record(10, 0.95)),
        False,
    ),
    *(Way(name, SCENE, respread(how), witness=respread_witness(how), shifts=False) for name, how in _ALIKE),
    _way("a wave along the scan, 1 sigma", smooth(scan, 1.0)),
    _way("a wave along the detector, 1 sigma", smooth(sample_px, 1.0)),
    _way("POS late by 5 ms", number("delay_s", "body.delay_s", 0.005)),
    _way("attitude late by 10 ms", number("attitude_delay_s", "body.attitude_delay_s", 0.01)),
    _way("focal length wrong by 0.1 %", number("focal_px", "camera.left.focal_px camera.right.focal_px", 0.001, scaled_by=True)),
    _way("focal length wrong by 1 %", number("focal_px", "camera.left.focal_px camera.right.focal_px", 0.01, scaled_by=True)),
    _way("one image's attitude off by 0.05 deg", one_pose("L1", turn_rad=tuple(np.radians([0.05, -0.05, 0.05])))),
    _way("a check image's attitude off by 0.05 deg", one_pose("R2", turn_rad=tuple(np.radians([0.05, -0.05, 0.05])))),
    _way("one image's position off by 3 m", one_pose("R1", shift_m=(3.0, -3.0, 3.0))),
    *(
        Way(f"errors of one image {f:.2g} times as stated", SCENE, stated(f), witness=stated_witness(f), shifts=False)
        for factor in _FACTORS
        for f in (factor, 1 / factor)
    ),
    *(
        Way(
            f"errors of all control {f:.2g} times as stated",
            SCENE,
            stated(f, _BOTH),
            witness=stated_witness(f, _BOTH),
            shifts=False,
        )
        for factor in _FACTORS
        for f in (factor, 1 / factor)
    ),
    Way(
        "errors of one image 30 times as stated, reweighed",
        SCENE,
        then(stated(30.0), reweigh=wj.Reweigh()),
        witness=stated_witness(30.0),
        shifts=False,
    ),
    *(_way(f"a prior {s:g} sigma off", prior(s)) for s in (3.0, 20.0, 100.0)),
    _way("control 1 m east, check right", surveyed((1.0, 0.0, 0.0))),
    _way("control 30 m high (geoid), check right", surveyed((0.0, 0.0, 30.0))),
    _way("all points 30 m high (geoid)", surveyed((0.0, 0.0, 30.0), "all")),
    _way("check points 10 m off", surveyed((7.0, 7.0, 0.0), "check")),
    _way("sample and line exchanged", measured(lambda pixel: pixel[:, ::-1], "pixel_px")),
    _way("pixels in units of 10 um", measured(lambda pixel: pixel * 0.01, "pixel_px")),
    _way("samples counted from the other end", measured(lambda pixel: pixel * [-1.0, 1.0], "pixel_px")),
    _way("scan angle with the other sign", turned_record(lambda sensor: _negated(sensor, "scan"), "scan")),
    _way("pitch angle with the other sign", turned_record(lambda sensor: _negated(sensor, "pitch"), "pitch")),
    _way("turns in the other order", turned_record(_reordered, "scan")),
    _way("axes y x -z for x -y -z", turned_record(_other_axes, "flu")),
    _way("clock of the camera 50 ms late", late(0.05)),
    _way("clock of the camera 18 s late", late(18.0)),
    _way("datum: all points 0.3 m east", surveyed((0.3, 0.0, 0.0), "all"), "blind"),
    _way("a tight prior, 20 sigma off", prior(20.0, ("u_gps", "u_sen"), 100.0), "blind"),
    _way("scan read late by 1 ms, unseen", number("delay_s", "scan.delay_s", 0.001), "blind"),
    _way("index of the scan off by 0.3 deg, unseen", number("zero_rad", "scan.zero_rad", np.radians(0.3)), "blind"),
    _way("index of the pitch off by 0.05 deg, unseen", number("zero_rad", "pitch.zero_rad", np.radians(0.05)), "blind"),
)
