"""The catalogue of ways to be wrong in a block."""

from collections.abc import Callable

import whiskjax as wj

from .block_spoils import (
    blunders,
    camera,
    datum,
    distorting,
    each_ray_twice,
    exchanged,
    heading,
    measured,
    mismatched,
    of_strip,
    pose,
    principal,
    prior,
    rays,
    strip_rays,
    surveyed,
    then,
    twice,
    without_control,
)
from .block_spread import (
    lasting,
    lasting_witness,
    near_in_image,
    respread,
    respread_witness,
    same_group,
    stated_control,
    stated_control_witness,
    stated_pos,
    stated_pos_witness,
    stated_rays,
    stated_rays_witness,
)
from .blocks import CENTRE_PX, EQUAL, IMAGE, IMAGES, POINT, Blocks, Case
from .score import scaled
from .way import Kind, Spoil, Way, nothing

SCENE = Blocks()
_INFINITE = lambda case: float("inf")  # copies have no density beside what is stated
_ALIKE = (
    ("errors alike in one point's rays", same_group(POINT, 0.8), ("tie",)),
    ("errors alike over an image", near_in_image(1500.0, 0.9), IMAGES),
    ("errors alike in one image, half of the variance", same_group(IMAGE, 0.5), IMAGES),
)


def _way(name: str, spoil: Spoil, kind: Kind = "scored") -> Way:
    return Way(name, SCENE, spoil, kind)


def _grown(name: str, spoil: Spoil, witness: Callable[[Case], float]) -> Way:
    """Errors of another size or likeness than stated: no mean moves."""
    return Way(name, SCENE, spoil, witness=witness, shifts=False)


CLEAN = (
    Way("clean", SCENE, nothing, "clean"),
    Way("clean, reweighed", Blocks(reweigh=wj.Reweigh()), nothing, "clean"),
    Way("clean, reweighed with POS", Blocks(reweigh=wj.Reweigh(priors=True)), nothing, "clean"),
    Way("clean, equal priors", Blocks(EQUAL), nothing, "clean"),
    Way("clean, control in one corner", SCENE, without_control, "clean"),
)

WAYS = (
    _way("one ray 15 sigma off", blunders(1, 15.0)),
    _way("rays scattered, 5 %", blunders(21, 10.0)),
    _way("rays scattered, 5 %, snooped", then(blunders(21, 10.0), blunders=wj.Blunders())),
    _way("rays scattered, 20 %, reweighed", then(blunders(84, 150.0), reweigh=wj.Reweigh())),
    _way("a tie point is two", mismatched(8.0)),
    _way("rays of the first image off", rays(("S1-1",), (5.0, 3.0))),
    _way("rays of a middle image off", rays(("S2-2",), (5.0, 3.0))),
    _way("rays of the last image off, columns", rays(("S3-4",), (6.0, 0.0))),
    _way("rays of half an image off", rays(("S2-2",), (3.0, 3.0), half=True)),
    _way("rays of half an image off, snooped", then(rays(("S2-2",), (8.0, 8.0), half=True), blunders=wj.Blunders())),
    _way("rays of one strip off", strip_rays("S2", (3.0, -3.0))),
    _way("rays of one strip off, rows", strip_rays("S1", (0.0, 4.0))),
    _way("rays of one strip off, reweighed", then(strip_rays("S2", (5.0, 0.0)), reweigh=wj.Reweigh())),
    _way("attitude of one image 20 sigma off", pose(("S2-3",), turn_rad=20e-4)),
    _way("position of one image 20 sigma off", pose(("S1-2",), shift_m=1.0)),
    _way("attitude of one strip 10 sigma off", pose(of_strip("S3"), turn_rad=10e-4)),
    _way("position of one strip 6 sigma off", pose(of_strip("S1"), shift_m=0.3)),
    _way("all positions 0.5 m off", pose(IMAGES, shift_m=0.5)),
    _grown("POS errs alike within strips", lasting(), lasting_witness()),
    _grown("POS errs alike in all images", lasting(False), lasting_witness(False)),
    _grown("ties listed twice, renamed", twice("tie"), _INFINITE),
    _grown("ties listed twice, renamed, 1e-6 px apart", twice("tie", 1e-6), lambda case: scaled(1e-6, 70)),
    _grown("control listed twice, renamed", twice("control"), _INFINITE),
    _grown("each ray twice", each_ray_twice(), _INFINITE),
    _grown("each ray twice, 1e-6 px apart", each_ray_twice(1e-6), lambda case: scaled(1e-6, 2 * len(POINT))),
    *(_grown(name, respread(how, whom), respread_witness(how)) for name, how, whom in _ALIKE),
    _way("principal point 3 px off", camera("principal_point_px", principal)),
    _way("distortion of 3 px in the corners", camera("distortion", distorting)),
    *(
        _grown(f"errors of ties {f:.2g} times as stated", stated_rays(f), stated_rays_witness(f))
        for factor in (2.0, 3.0, 30.0)
        for f in (factor, 1 / factor)
    ),
    _grown(
        "errors of ties 30 times as stated, reweighed",
        then(stated_rays(30.0), reweigh=wj.Reweigh()),
        stated_rays_witness(30.0),
    ),
    *(_grown(f"POS errs {f:.2g} times as stated", stated_pos(f), stated_pos_witness(f)) for f in (3.0, 30.0, 1 / 3, 1 / 30)),
    *(_grown(f"control errs {f:.2g} times as stated", stated_control(f), stated_control_witness(f)) for f in (3.0, 30.0)),
    *(_way(f"a prior {s:g} sigma off", prior(s)) for s in (3.0, 20.0, 100.0)),
    _way("one control point 1 m off", surveyed((0.7, -0.7, 0.0), only=3)),
    _way("two control points exchanged", exchanged(2, 5)),
    _way("control 1 m east, check right", surveyed((1.0, 0.0, 0.0))),
    _way("control 30 m high (geoid), check right", surveyed((0.0, 0.0, 30.0))),
    _way("control and check 30 m high (geoid)", surveyed((0.0, 0.0, 30.0), ("control", "check"))),
    _way("check points 10 m off", surveyed((7.0, 7.0, 0.0), ("check",))),
    _way("columns and rows exchanged", measured(lambda pixel: pixel[:, ::-1])),
    _way("rows counted upwards", measured(lambda pixel: pixel * [1.0, -1.0] + [0.0, 2 * CENTRE_PX[1]])),
    _way("pixels in units of 10 um", measured(lambda pixel: pixel * 0.01)),
    _way("origin of pixels half a pixel off", measured(lambda pixel: pixel + 0.5)),
    _way("attitudes the other way round", heading(lambda q: q * [-1.0, -1.0, -1.0, 1.0])),
    _way("datum: everything 10 m east", datum((10.0, 0.0, 0.0)), "blind"),
    _way("a tight prior, 20 sigma off", prior(20.0, ("lever_z",), 100.0), "blind"),
)
