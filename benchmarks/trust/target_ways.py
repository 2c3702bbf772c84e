"""The catalogue of ways to be wrong with a target."""

import numpy as np

from whiskjax.flights import tianshan

from .score import scaled
from .target_spoils import (
    another,
    constant,
    copied,
    focal,
    gated,
    guess,
    lagging,
    late,
    moving,
    off,
    one_record,
    one_record_witness,
    prior,
    records,
    remembered,
    remembered_witness,
    stated,
    stated_witness,
)  # fmt: skip
from .targets import LOOKS, Targets
from .way import Kind, Spoil, Way, nothing

SCENE, BATCH = Targets(), Targets("batch")
SHORT = Targets(scene=tianshan.Scene("orbit", looks=LOOKS, spacing_m=20.0))
RACE = Targets(scene=tianshan.Scene("race", looks=LOOKS))
_INFINITE = lambda case: float("inf")  # copies have no density beside what is stated


def _way(name: str, spoil: Spoil, kind: Kind = "scored") -> Way:
    return Way(name, SCENE, spoil, kind)


CLEAN = (
    Way("clean", SCENE, nothing, "clean"),
    Way("clean, batch", BATCH, nothing, "clean"),
    Way("clean, race", RACE, nothing, "clean"),
    Way("clean, within 4 degrees", SHORT, nothing, "clean"),
    Way("clean, gated", SCENE, gated(nothing), "clean"),
)

WAYS = (
    _way("one look 2000 px off", off(1, (1500.0, 1000.0))),
    _way("looks scattered, 10 %", off(4, (600.0, 600.0))),
    _way("looks scattered, 10 %, gated", gated(off(4, (1500.0, 1500.0)))),
    Way("looks scattered, 10 %, batch", BATCH, off(4, (600.0, 600.0))),
    _way("first ten looks off", off(slice(0, 10), (300.0, 300.0))),
    _way("middle ten looks off", off(slice(15, 25), (300.0, 300.0))),
    _way("last ten looks off", off(slice(30, 40), (300.0, 300.0))),
    Way("last ten looks off, batch", BATCH, off(slice(30, 40), (300.0, 300.0))),
    _way("first five looks off, gated", gated(off(slice(0, 5), (3000.0, 0.0)))),
    _way("last 25 looks off, gated", gated(off(slice(15, 40), (2000.0, 0.0)))),
    _way("first half saw a thing 60 m east", another(slice(0, 20), 60.0)),
    _way("last five saw a thing 200 m east, gated", gated(another(slice(35, 40), 200.0))),
    Way("copies, four of each", SCENE, copied(4), witness=_INFINITE, shifts=False),
    Way("copies, four of each, 1e-6 px apart", SCENE, copied(4, 1e-6), witness=lambda c: scaled(1e-6, 60), shifts=False),
    Way("copies, four of each, batch", BATCH, copied(4), witness=_INFINITE, shifts=False),
    Way("one record behind four looks", SCENE, one_record(4), witness=one_record_witness(4), shifts=False),
    *(Way(f"errors last {t:g} s", SCENE, remembered(t), witness=remembered_witness(t), shifts=False) for t in (3.0, 10.0, 60.0)),
    Way("errors last 60 s, batch", BATCH, remembered(60.0), witness=remembered_witness(60.0), shifts=False),
    Way("errors are constant", SCENE, remembered(np.inf), witness=remembered_witness(1e9), shifts=False),
    _way("heading off by 0.1 deg", constant("body", heading_rad=np.radians(0.1))),
    _way("heading off by the convergence of meridians, 0.5 deg", constant("body", heading_rad=np.radians(0.5))),
    _way("roll off by 0.2 deg", constant("body", roll_rad=np.radians(0.2))),
    _way("gimbal off by 0.2 deg in pitch", constant("gimbal_pitch", gimbal_pitch_rad=np.radians(0.2))),
    _way("positions late by 0.5 s", late(0.5)),
    _way("positions 18 s late (leap seconds)", lagging(6)),
    _way("focal length wrong by 5 %", focal(0.05)),
    *(
        Way(f"errors {f:.2g} times as stated", SCENE, stated(f), witness=stated_witness(f), shifts=False)
        for factor in (2.0, 3.0, 30.0)
        for f in (factor, 1 / factor)
    ),
    *(_way(f"a guess of 5 m, {s:g} sigma off", guess(s, 100.0)) for s in (3.0, 20.0, 100.0)),
    *(_way(f"a prior {s:g} sigma off", prior(s)) for s in (3.0, 20.0, 100.0)),
    _way("gimbal roll with the other sign", records("gimbal_roll", lambda r: {"gimbal_roll_rad": -r.gimbal_roll_rad})),
    _way(
        "gimbal angles exchanged",
        records("gimbal_roll", lambda r: {"gimbal_roll_rad": r.gimbal_pitch_rad, "gimbal_pitch_rad": r.gimbal_roll_rad}),
    ),
    _way("heading counted the other way", records("heading", lambda r: {"heading_rad": -r.heading_rad})),
    _way("latitude and longitude exchanged", records("lat", lambda r: {"lat_rad": r.lon_rad, "lon_rad": r.lat_rad})),
    _way("heights in feet", records("height", lambda r: {"height_m": r.height_m / 0.3048})),
    _way("the target drives at 2 m/s", moving(2.0)),
    _way("datum: POS 30 m high (geoid)", constant("body", height_m=30.0), "blind"),
    _way("datum: POS 30 m east", constant("body", east_m=30.0), "blind"),
    _way("a tight prior, 20 sigma off", prior(20.0, 100.0), "blind"),
)
