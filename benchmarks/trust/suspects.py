"""`python -m benchmarks trust --suspects`: is the number that is wrong the one that the verdict suspects?

A number that nobody estimates, or one image's pose, is spoiled so that the score test, after projection on what is estimated,
says 11 to 15 sigma. Counted is how often it stands first, or in the group of those that look the same, printed as one. Where a
number would have to be more wrong than any instrument is, the data of the scene cannot show it, and it is not counted.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import whiskjax as wj
from whiskjax.chain.address import make_room, parse, put, read
from whiskjax.earth.refraction import Refraction
from whiskjax.flights import songshan, tianshan

from . import block_spoils, blocks, calibrations, targets

SEEDS = 20
LEAST, MOST, LEAST_STATISTIC = 11.0, 15.0, 100.0  # sigmas; squared
LARGEST = {"_m": 30.0, "_rad": 0.2, "_s": 0.3, "gain": 0.2, "_px": 300.0, "scale": 3.0, "distortion": 0.5}
_POSE = "pose of S2-2"

Answered = tuple[wj.Sensor, Callable[[wj.Sensor], Any]]  # the right sensor, and the verb's answer with another


def _haian(seed: int) -> Answered:
    scene = calibrations.Calibrations()
    case = scene.draw(seed, True)
    return case.sensor, lambda sensor: scene.answer(dataclasses.replace(case, sensor=sensor))


def _frames(seed: int) -> Answered:
    scene = blocks.Blocks()
    case = scene.draw(seed, True)
    return case.sensor, lambda sensor: scene.answer(dataclasses.replace(case, sensor=sensor))


def _songshan(seed: int) -> Answered:
    """Detectors are as the sensor says: lever arm and boresight are estimated."""
    of = songshan.Scene("B", ties=60, pos_hz=20.0, spacing_s=24.0, truth="matching")
    drawn, errors = songshan.simulate_block(of, seed), songshan.frame_errors(of)
    links = dict(zip(drawn.sensor.names, drawn.sensor.links, strict=True))
    unknowns = songshan.unknowns(of)[:6]
    right = wj.Sensor(links, drawn.truth.camera)
    return right, lambda sensor: wj.adjust(sensor, drawn.block, unknowns, errors=errors, retime=False, throw=False)


def _tianshan(seed: int) -> Answered:
    """In a vacuum, which a refraction of nothing is: it may be suspected, too."""
    scene = targets.Targets(scene=tianshan.Scene("race", looks=targets.LOOKS))
    case = scene.draw(seed, True)
    looks = wj.Looks(wj.Shot(time_s=tianshan.time_s(case.scene)), case.pixel_px, (case.sigma_px,) * 2)
    guess, sensor = wj.Guess.around(case.guess_m, (case.guess_sigma_m,) * 3), tianshan.sensor(case.recorded)
    right = wj.Sensor(dict(zip(sensor.names, sensor.links, strict=True)), sensor.camera, Refraction(0.0))
    return right, lambda sensor: wj.locate(sensor, looks, guess=guess, errors=case.errors, throw=False)


# Of each scene how it is answered, and numbers that may be wrong.
SCENES: dict[str, tuple[Callable[[int], Answered], tuple[str, ...]]] = {
    "haian": (
        _haian,
        (
            "body.delay_s",
            "body.attitude_delay_s",
            "pitch.delay_s",
            "scan.gain",
            "pitch.gain",
            "scan.polynomial_deg[0]",
            "gps_arm.angles_deg[1]",
            "gps_arm.angles_deg[2]",
            "platform.left.lever_arm_m[1]",
            "camera.left.focal_px",
            "camera.right.principal_sample_px",
            "camera.left.deformation_px[1,1]",
        ),
    ),
    "songshan": (
        _songshan,
        (
            "body.delay_s",
            "body.attitude_delay_s",
        ),
    ),
    "tianshan": (
        _tianshan,
        (
            "gimbal_roll.zero_deg",
            "gimbal_pitch.zero_deg",
            "gimbal_roll.gain",
            "gimbal_pitch.gain",
            "camera.focal_px",
            "camera.principal_point_px[0]",
            "camera.principal_point_px[1]",
            "refraction.scale",
        ),
    ),
    "frames": (
        _frames,
        (
            "camera.principal_point_px[0]",
            "camera.principal_point_px[1]",
            *(f"camera.distortion[{i}]" for i in range(5)),
        ),
    ),
}


class Tried(NamedTuple):
    """A number that was spoiled: whether it was named first; what the verdict said; NaN where it could not be seen."""

    scene: str
    number: str
    seed: int
    statistic: float
    first: bool
    said: tuple[str, ...]

    @property
    def counts(self) -> bool:
        """Whether the data show it."""
        return self.statistic >= LEAST_STATISTIC


def tried(scene: str, seed: int) -> Iterator[Tried]:
    """Every number of a scene on one draw."""
    draw, numbers = SCENES[scene]
    right, answer = draw(seed)
    clean = answer(right).evidence
    rng = np.random.default_rng(seed)
    for number in numbers:
        place, size = parse(number), math.inf
        if number in (names := clean.suspects.names) and clean.suspects.usual[i := names.index(number)] > 0:
            size = float(clean.suspicions.sigma[i] * clean.suspects.usual[i]) * rng.uniform(LEAST, MOST) * rng.choice([-1.0, 1.0])
        if abs(size) > next(most for suffix, most in LARGEST.items() if place.path[-1].endswith(suffix)):
            yield Tried(scene, number, seed, math.nan, False, ())
            continue
        room = make_room(right, place)
        found = answer(put(room, [place], [read(room, place) + size]))
        if (suspected := found.evidence.suspicions) is None:
            yield Tried(scene, number, seed, math.nan, False, tuple(reason.kind for reason in found.reasons))
            continue
        said = next((reason.figures["numbers"] for reason in found.reasons if reason.kind == "a number taken as known"), ())
        yield Tried(scene, number, seed, float(suspected.sigmas[i]) ** 2, number in said, tuple(said))
    if scene == "frames":
        case, _ = block_spoils.pose(("S2-2",), turn_rad=1e-3)(blocks.Blocks().draw(seed, True), np.random.default_rng(seed))
        reasons = blocks.Blocks().answer(case).reasons
        said = tuple(reason.figures["image"] for reason in reasons if reason.kind == "one pose")
        yield Tried(scene, _POSE, seed, math.inf, said == ("S2-2",), said)


def table(runs: list[Tried]) -> str:
    """By scene and number, and all of them."""
    lines = []
    for scene, number in dict.fromkeys((run.scene, run.number) for run in runs):
        mine = [run for run in runs if (run.scene, run.number) == (scene, number) and run.counts]
        others = sorted({run.said[0] if run.said else "nothing" for run in mine if not run.first})
        beside = f"; else {', '.join(others)}" if others else ""
        lines.append(f"{scene:10s} {number:36s} {sum(run.first for run in mine):3d} of {len(mine):3d}{beside}")
    counted = [run for run in runs if run.counts]
    share = 100 * sum(run.first for run in counted) / max(len(counted), 1)
    return "\n".join([*lines, f"named first: {share:.1f} % of {len(counted)}; {len(runs) - len(counted)} could not be seen"])
