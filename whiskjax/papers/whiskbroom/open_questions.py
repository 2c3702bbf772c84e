"""What Jin et al. (2024) leave open, tried on their flight: weights, drift, blunders, the choice of the model, POS errors.

Each question is asked of many seeds by the public verbs; nothing here knows more than a user could. The measure of a calibration
is its noise-free prediction error: how far it misses the points of an exact flight (same seed, no errors in POS, points and
image), as RMS length in pixels. It holds only what the calibration got wrong, not what any measurement adds.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...chain.by import By
from ...chain.correction import Bias, Correction, Drift
from ...chain.imaging import project
from ...chain.process import Process
from ...chain.sensor import Sensor
from ...estimate.blunders import Blunders
from ...estimate.calibrate import calibrate
from ...estimate.calibration import Calibration
from ...estimate.consistency import nees
from ...estimate.many import calibrate_batch, calibrate_redrawn, images_of
from ...estimate.motions import motion_unknowns
from ...estimate.observations import Observations
from ...estimate.selection import Comparison, compare
from ...estimate.unknown import Unknown
from ...estimate.variance_components import Reweigh
from ...flights.flight import Flight
from ...flights.haian import POS_BIAS_M, POS_BIAS_RAD, PRIOR_SIGMA, SCENES, TABLE_4, Truth, simulate, unknowns

FIRST_PAIR = ("L1", "R1")
PAIRS = ("pair_1", "pair_2", "pair_3")
ANCHORS = 6  # points of L3 and of R3 that tell of the drift
DRIFT_SIGMA_RAD = np.radians(0.03)  # a-priori change of the boresight within 15 minutes
SHARED = TABLE_4._replace(
    left_rad=(TABLE_4.left_rad + TABLE_4.right_rad) / 2, right_rad=(TABLE_4.left_rad + TABLE_4.right_rad) / 2
)
Change = Callable[[Flight, Observations], dict[str, Any]]


@functools.lru_cache(maxsize=2)  # one seed is asked many times in a row
def _exact(seed: int) -> tuple[Flight, Observations]:
    flight = simulate(seed, noise=False, drift=True)
    return flight, flight.observations()


def misses_px(calibrated: Sensor, seed: int) -> dict[str, Float[np.ndarray, " n"]]:
    """How far a calibrated sensor misses every point of the exact flight, by image, in pixels."""
    exact, found = _exact(seed)
    links = dict(zip(calibrated.names, calibrated.links, strict=True)) | {"body": exact.sensor["body"]}
    pixel = np.asarray(project(Sensor(links, calibrated.camera), found.shot, found.point_m).pixel_px)
    length = np.hypot(*(found.pixel_px - pixel).T)
    return {name: length[np.asarray(found.images) == name] for name in SCENES}


def prediction_error_px(calibrated: Sensor, seed: int) -> float:
    """RMS miss over the points of the first pair of images."""
    miss = misses_px(calibrated, seed)
    return float(np.sqrt(np.mean(np.concatenate([miss[name] for name in FIRST_PAIR]) ** 2)))


def solved(flight: Flight, **change: Any) -> Calibration:
    """`calibrate` of a flight, with other observations or unknowns, or features switched on."""
    given = {"sensor": flight.sensor, "observations": flight.observations(), "unknowns": flight.unknowns} | change
    return calibrate(throw=False, **given)


# ---------------------------------------------------------------------------------------------------------------- a. weights
class Weights(NamedTuple):
    """Per seed: errors (px) with the true weights, image sigmas wrong by 3, and the same reweighed; likewise priors wrong by 30.

    `sigma_ratio` (seeds, 4): estimated over true sigma of x and y on L1 and R1; `sigma_predicted` what each was said to be
    uncertain by. `prior_wrong`, `prior_reweighed` (seeds, 2): priors 30 times too narrow, and too wide.
    """

    well: Float[np.ndarray, " seeds"]
    wrong: Float[np.ndarray, " seeds"]
    reweighed: Float[np.ndarray, " seeds"]
    sigma_ratio: Float[np.ndarray, "seeds 4"]
    sigma_predicted: Float[np.ndarray, "seeds 4"]
    prior_wrong: Float[np.ndarray, "seeds 2"]
    prior_reweighed: Float[np.ndarray, "seeds 2"]


def weights(seeds: Sequence[int]) -> Weights:
    """Sigmas of each image and axis wrong by 3, up or down; all prior sigmas wrong by 30."""
    rows = []
    for seed in seeds:
        flight, draw = simulate(seed, drift=True), np.random.default_rng([seed, 1])
        right = flight.observations()
        image = np.array([list(SCENES).index(name) for name in right.images])
        factor = 3.0 ** draw.choice([-1, 1], (len(SCENES), 2))
        wrong = dataclasses.replace(right, sigma_px=right.sigma_px * factor[image])

        def error(answer: Calibration, seed: int = seed) -> float:
            return prediction_error_px(answer.sensor, seed)

        found = solved(flight, observations=wrong, reweigh=Reweigh())
        assert found.components is not None
        # The first four groups are x and y of L1 and R1 in this order: the images that have control points.
        ratio = (found.components.factor[:4].reshape(2, 2) * factor[:2]).ravel()
        priors = [[dataclasses.replace(x, sigma=x.size * by) for x in flight.unknowns] for by in (1 / 30, 30.0)]
        together = Reweigh(priors={"priors": [x.name for x in flight.unknowns]})  # each sigma by itself nobody could tell
        rows.append(
            (
                error(solved(flight)),
                error(solved(flight, observations=wrong)),
                error(found),
                ratio,
                found.components.log_sigma[:4],
                [error(solved(flight, unknowns=prior)) for prior in priors],
                [error(solved(flight, unknowns=prior, reweigh=together)) for prior in priors],
            )
        )
    return Weights(*map(np.array, zip(*rows, strict=True)))


# ------------------------------------------------------------------------------------------------------------------ b. drift
DRIFTS = ("none", "linear", "random walk", "smooth")


def anchored(observations: Observations) -> Observations:
    """Six points of L3 and of R3, spread over the swing, become control points."""
    control, time = observations.is_control.copy(), observations.key("time_s")
    assert time is not None
    for name in ("L3", "R3"):
        there = np.flatnonzero(np.asarray(observations.images) == name)
        there = there[np.argsort(time[there])]
        control[there[np.linspace(0, len(there) - 1, ANCHORS).round().astype(int)]] = True
    return dataclasses.replace(observations, is_control=control)


def drifting(sensor: Sensor, kind: str, by_swing: bool = True) -> tuple[Sensor, tuple[Unknown, ...]]:
    """The sensor with a correction of the IMU boresight that changes in time, and its unknowns.

    **Arguments:** `kind`: of `DRIFTS`; `by_swing`: each swing drifts by itself, or both alike.
    """
    if kind == "none":
        return sensor, ()
    last = max(start for start, *_ in SCENES.values())
    nodes = np.array([0.0, 60.0, last, last + 10.0])
    basis, chosen, sigma = {
        "linear": lambda: (Drift(0.0, last), (1,), DRIFT_SIGMA_RAD),
        "random walk": lambda: (Process.random_walk(nodes), None, DRIFT_SIGMA_RAD / np.sqrt(last)),
        "smooth": lambda: (Process.smooth(nodes, 600.0), None, DRIFT_SIGMA_RAD),
    }[kind]()
    link = By("swing", {"left": Correction(basis), "right": Correction(basis)}) if by_swing else Correction(basis)
    sensor = sensor.after("platform", "drift", link)
    return sensor, motion_unknowns(sensor, "drift", turn_sigma_rad=[sigma] * 3, coefficients=chosen)


def drift(seeds: Sequence[int]) -> dict[str, dict[str, Float[np.ndarray, " seeds"]]]:
    """Noise-free prediction error (px) of every image, by kind of drift; "none" without anchor points, as the paper."""
    out: dict[str, dict[str, list[float]]] = {kind: {name: [] for name in SCENES} for kind in DRIFTS}
    for seed in seeds:
        flight = simulate(seed, drift=True)
        for kind in DRIFTS:
            sensor, more = drifting(flight.sensor, kind)
            found = flight.observations() if kind == "none" else anchored(flight.observations())
            answer = solved(flight, sensor=sensor, observations=found, unknowns=(*flight.unknowns, *more))
            for name, miss in misses_px(answer.sensor, seed).items():
                out[kind][name].append(float(np.sqrt(np.mean(miss**2))))
    return {kind: {name: np.array(values) for name, values in images.items()} for kind, images in out.items()}


# --------------------------------------------------------------------------------------------------------------- c. blunders
SPOILT = (
    ("scattered", 0.05), ("scattered", 0.10), ("scattered", 0.20),
    ("clustered", 0.05), ("clustered", 0.10), ("clustered", 0.15), ("clustered", 0.20), ("clustered", 0.25),
)  # fmt: skip


def spoil(observations: Observations, how: str, share: float, seed: int) -> tuple[Observations, np.ndarray]:
    """Observations with gross errors of 10 to 150 px in a share of all control points, and the indices of the wrong ones.

    Scattered: any points, each with an error of its own. Clustered: neighbours in scan angle on one image, all with the same
    error, as where a reference map is shifted; a fifth of all points then is two fifths of that image's.
    """
    draw, control = np.random.default_rng([seed, 2]), np.flatnonzero(observations.is_control)
    count = round(share * len(control))
    if how == "scattered":
        wrong, errors = draw.choice(control, count, replace=False), count
    else:
        time = observations.key("time_s")
        assert time is not None
        image = control[np.asarray(observations.images)[control] == draw.choice(FIRST_PAIR)]
        image = image[np.argsort(time[image])]
        first = draw.integers(len(image) - count + 1)
        wrong, errors = image[first : first + count], 1
    angle, size = draw.uniform(0, 2 * np.pi, errors), draw.uniform(10, 150, errors)
    pixel = observations.pixel_px.copy()
    pixel[wrong] += np.stack([size * np.cos(angle), size * np.sin(angle)], -1)
    return dataclasses.replace(observations, pixel_px=pixel), np.sort(wrong)


class Spoilt(NamedTuple):
    """Per seed: the error (px) of the clean flight, of least squares on the spoilt one, with blunders found, and of an oracle.

    The oracle knows the wrong points and leaves them out: nobody without their true values can do better. `found`, `missed` and
    `false` count wrong points that were left out, that were not, and good ones that were.
    """

    clean: Float[np.ndarray, " seeds"]
    plain: Float[np.ndarray, " seeds"]
    found_px: Float[np.ndarray, " seeds"]
    oracle: Float[np.ndarray, " seeds"]
    found: np.ndarray
    missed: np.ndarray
    false: np.ndarray


def blunders(seeds: Sequence[int]) -> dict[tuple[str, float], Spoilt]:
    """Every kind and share of `SPOILT` on every seed."""
    out: dict[tuple[str, float], list] = {case: [] for case in SPOILT}
    for seed in seeds:
        flight = simulate(seed, drift=True)
        good = flight.observations()

        def error(seed: int = seed, flight: Flight = flight, **change: Any) -> tuple[float, Calibration]:
            answer = solved(flight, **change)
            return prediction_error_px(answer.sensor, seed), answer

        clean = error()[0]
        for how, share in SPOILT:
            bad, wrong = spoil(good, how, share, seed)
            found_px, answer = error(observations=bad, blunders=Blunders())
            left_out = np.flatnonzero(good.is_control & ~answer.used)
            known = good.is_control.copy()
            known[wrong] = False
            oracle = error(observations=dataclasses.replace(good, is_control=known))[0]
            counts = [
                len(x) for x in (np.intersect1d(left_out, wrong), np.setdiff1d(wrong, left_out), np.setdiff1d(left_out, wrong))
            ]
            out[how, share].append((clean, error(observations=bad)[0], found_px, oracle, *counts))
    return {case: Spoilt(*np.array(rows).T) for case, rows in out.items()}


# ------------------------------------------------------------------------------------------------------------- d. which model
def candidates(flight: Flight) -> dict[str, Calibration]:
    """12 shared or 15 split unknowns, constant or drifting linearly, from the control points of the first and the last pair.

    Each of them knows that the POS has a bias of its own in each pair: a model that does not takes it for drift.
    """
    split = tuple(flight.unknowns)
    shared = tuple(
        dataclasses.replace(x, name=x.name.removesuffix("_left"), where=(x.where, x.where.replace("left", "right")))
        if x.name.endswith("_left") and isinstance(x.where, str)
        else x
        for x in split
        if not x.name.endswith("_right")
    )
    sensor, pos = with_pos_bias(flight.sensor, PAIRS)
    found = anchored(dataclasses.replace(flight, sensor=sensor).observations())
    pos = tuple(x for x in pos if "pair_2" not in x.name)  # it has no control points
    out = {}
    for name, given in (("12 shared", shared), ("15 split", split)):
        for kind, word in (("none", ""), ("linear", ", drifting")):
            moving, more = drifting(sensor, kind, by_swing=name == "15 split")
            out[name + word] = solved(flight, sensor=moving, observations=found, unknowns=(*given, *more, *pos))
    return out


def model_choice(seeds: Sequence[int], **flown: Any) -> list[Comparison]:
    """The comparison of every seed; `flown`: truth and drift for `simulate`."""
    return [compare(candidates(simulate(seed, **flown))) for seed in seeds]


# -------------------------------------------------------------------------------------------- e. POS errors, and 4. covariance
def drawn_truth(run: int) -> Truth:
    """A truth drawn from the prior."""
    draw = np.random.default_rng([run, 3])
    return Truth(*(draw.normal(0, 1, 3) * sigma for sigma in PRIOR_SIGMA))


def with_pos_bias(sensor: Sensor, pairs: Sequence[str] = ()) -> tuple[Sensor, tuple[Unknown, ...]]:
    """The sensor with a bias of the POS at the joint "body", and its six unknowns: as large as the scenario says.

    **Arguments:** `pairs`: names of strips that have a bias each; none is one for all.
    """
    link = By("strip", {name: Correction(Bias()) for name in pairs}) if pairs else Correction(Bias())
    sensor = sensor.after("body", "pos_bias", link)
    return sensor, motion_unknowns(sensor, "pos_bias", turn_sigma_rad=POS_BIAS_RAD.tolist(), shift_sigma_m=[POS_BIAS_M] * 3)


class PosErrors(NamedTuple):
    """NEES of the 15 unknowns, a value for each run: POS bias ignored, estimated, considered; 15 on average where honest.

    `spread` (15,): Monte Carlo spread of the errors over the predicted sigma, with the bias estimated.
    """

    ignored: Float[np.ndarray, " runs"]
    estimated: Float[np.ndarray, " runs"]
    considered: Float[np.ndarray, " runs"]
    spread: Float[np.ndarray, " unknowns"]


def pos_errors(runs: int) -> PosErrors:
    """Truths drawn from the prior, POS bias and jitter switched on, calibrated from the first pair."""
    truth = np.array([np.concatenate(drawn_truth(run)) for run in range(runs)])
    sigma = np.concatenate(PRIOR_SIGMA)

    def flights() -> Iterator[Flight]:
        return (simulate(run, truth=drawn_truth(run), drift=True) for run in range(runs))

    def control(flight: Flight) -> Observations:
        found = flight.observations()
        return found.take(found.is_control)

    def judged(value: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        return nees((value[:, :15] - truth) / sigma, covariance[:, :15, :15] / np.outer(sigma, sigma))

    more = with_pos_bias(simulate(0).sensor)[1]
    ignored = calibrate_batch(((f.sensor, control(f)) for f in flights()), unknowns())
    estimated = calibrate_batch(((with_pos_bias(f.sensor)[0], control(f)) for f in flights()), (*unknowns(), *more))
    considered: list[Calibration] = []
    for flight in flights():
        considered.append(solved(flight, sensor=with_pos_bias(flight.sensor)[0], observations=control(flight), consider=more))
    return PosErrors(
        judged(ignored.value, ignored.estimate.covariance),
        judged(estimated.value, estimated.estimate.covariance),
        judged(np.array([c.value for c in considered]), np.array([c.posterior.covariance for c in considered])),
        (estimated.value[:, :15] - truth).std(axis=0, ddof=1) / np.sqrt((estimated.estimate.sigma[:, :15] ** 2).mean(axis=0)),
    )


class Honesty(NamedTuple):
    """Monte Carlo spread over predicted sigma of every unknown, NEES of every run, and which runs ended well."""

    spread: Float[np.ndarray, " unknowns"]
    nees: Float[np.ndarray, " runs"]
    is_successful: Bool[np.ndarray, " runs"]


def honest_covariance(runs: int, seed: int = 0) -> Honesty:
    """Truths drawn from the prior, points and image noise as the sigmas say, POS exact: the covariance's own assumptions."""
    flight, draw = simulate(seed, noise=False, drift=False), np.random.default_rng([seed, 4])
    found = flight.observations()
    found = found.take(found.is_control)
    sigma = np.concatenate(PRIOR_SIGMA)
    truth = draw.normal(size=(runs, len(sigma))) * sigma
    # The points are surveyed once, with an error of their own in every run: their part of the noise reaches the image through the
    # derivative by the point, taken here by central differences over a metre.
    steps = [found.point_m + half * axis for axis in np.eye(3) for half in (0.5, -0.5)]
    pixel = [np.asarray(project(flight.sensor, found.shot, point).pixel_px) for point in steps]
    follows = np.stack([pixel[2 * k] - pixel[2 * k + 1] for k in range(3)], -1)
    assert found.point_covariance_m2 is not None
    covariance = follows @ found.point_covariance_m2 @ np.swapaxes(follows, -1, -2) + found.sigma_px[:, :, None] ** 2 * np.eye(2)
    noise = np.einsum("nij,rnj->rni", np.linalg.cholesky(covariance), draw.normal(size=(runs, len(found), 2)))
    images = images_of(flight.sensor, found, flight.unknowns, truth)
    batch = calibrate_redrawn(flight.sensor, found, flight.unknowns, images + noise, steps=8)
    error = batch.value - truth
    return Honesty(
        error.std(axis=0, ddof=1) / np.sqrt((batch.estimate.sigma**2).mean(axis=0)),
        nees(error / sigma, batch.estimate.covariance / np.outer(sigma, sigma)),
        batch.is_successful,
    )
