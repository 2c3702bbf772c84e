"""Adjusted blocks for figures and tables, made up and not solved: what stands in them is known to the last digit."""

import dataclasses
import functools
from typing import Any, cast

import numpy as np

import whiskjax as wj
from tests.files import made_up
from whiskjax.estimate.block.adjustment import Adjustment, Trust
from whiskjax.estimate.block.direct import Direct
from whiskjax.estimate.block.station_errors import StationErrors, at_stations, has_stations
from whiskjax.estimate.check_points import UNTESTED, CheckTest
from whiskjax.estimate.map_limits import Standard
from whiskjax.estimate.reason import Reason, is_sound
from whiskjax.estimate.variance_components import Components
from whiskjax.flights import songshan
from whiskjax.flights.flight import Flight
from whiskjax.show.block.adjusted import Adjusted

SIGMA_M = np.array([0.02, 0.03, 0.07])  # of adjusted points: east, north, up
NOT_DETERMINED = Reason("solution", "failure", "nothing determines u_gps", {"unknowns": ["u_gps"]})
TOO_LARGE = Reason("consistency", "failure", "the residuals are 2 times as large as their sigmas say", {"sigma_factor": 2.0})
LIMITS = Standard("our maps", 0.5, 0.4)


@functools.cache
def strips() -> Flight:
    """Two strips of three views, 54 surveyed points and 300 ties."""
    return songshan.simulate(songshan.Scene("B", ties=300, pos_hz=20.0), 1)


@dataclasses.dataclass(frozen=True)
class MadeUp:
    """What tables and figures read of an `Adjustment`, each number as it is said here."""

    sensor: wj.Sensor
    unknowns: tuple[wj.Unknown, ...]
    value: np.ndarray
    start: np.ndarray
    trust: Trust
    block: wj.Block
    errors: tuple[wj.FrameErrors, ...]
    motions: StationErrors | None
    point_m: np.ndarray
    covariance_m2: np.ndarray
    residual_px: np.ndarray
    used: np.ndarray
    components: Components | None
    cost: float
    freedom: int
    variance_factor: float
    tail_probability: float
    is_consistent: bool
    steps: int
    result: wj.RESULTS
    reasons: tuple[Reason, ...]
    check: CheckTest = UNTESTED
    left_out: tuple[str, ...] = ()

    @property
    def is_sound(self):
        return is_sound(self.reasons)

    def errors_m(self, role):
        return Adjustment.errors_m(cast(Any, self), role)

    def statistics(self, role="check"):
        return Adjustment.statistics(cast(Any, self), role)


def adjusted(flight: Flight, **more) -> Adjusted:
    """What `whiskjax adjust` would hand on; `more` replaces fields of the adjustment."""
    rng = np.random.default_rng(2)
    block, axes = flight.block(), flight.world.from_enu(flight.points.position_m)
    given = np.where(np.isfinite(flight.points.position_m), flight.points.position_m, block_middle(flight))
    error = rng.normal(0, 1, given.shape) * SIGMA_M
    errors = tuple(one for one in flight.errors if has_stations(one, flight.sensor))
    motions, q = at_stations("adjust", errors, flight.sensor), len(flight.unknowns)
    assert motions is not None
    stations = motions.stations(flight.sensor).stations
    sigma = np.array([x.size for x in flight.unknowns]) / 10
    fields = {
        "sensor": flight.sensor,
        "unknowns": tuple(flight.unknowns),
        "value": sigma * 3,
        "start": sigma * 0,
        "trust": Trust(np.diag(sigma**2), sigma, np.abs(rng.normal(1e-4, 1e-5, (stations, 6))), np.full(q, 0.99)),
        "block": block,
        "errors": errors,
        "motions": motions,
        "point_m": given + np.einsum("nij,nj->ni", axes, error),
        "covariance_m2": np.einsum("nij,j,nkj->nik", axes, SIGMA_M**2, axes),
        "residual_px": rng.normal(0, 1, block.pixel_px.shape) * block.sigma_px,
        "used": np.ones(len(block), dtype=bool),
        "components": None,
        "cost": 500.0,
        "freedom": 505,
        "variance_factor": 500 / 505,
        "tail_probability": 0.55,
        "is_consistent": True,
        "steps": 5,
        "result": wj.RESULTS.successful,
        "reasons": (Reason("parts", "caution", "no point ties strip west to the other images", {"images": ["strip west"]}),),
    }
    return Adjusted(flight, cast(Any, MadeUp(**(fields | more))))


def block_middle(flight: Flight) -> np.ndarray:
    """Some place in the block, for ties."""
    rng = np.random.default_rng(3)
    around = rng.uniform(-1, 1, (len(flight.points.names), 3)) * [1500, 1500, 50]
    return np.nanmean(flight.points.position_m, axis=0) + around


def with_roles(flight: Flight, **roles: str) -> Flight:
    """The flight with other roles: control="tie" makes tie points of control points."""
    points = dataclasses.replace(flight.points, roles=[roles.get(role, role) for role in flight.points.roles])
    return dataclasses.replace(flight, points=points)


def _direct() -> Adjusted:
    block = strips().block()
    known = np.flatnonzero(block.role != "tie")
    error = np.random.default_rng(4).normal(0, 2, (len(known), 3))
    one = Direct(known, np.zeros(len(known), dtype=int), block.position_m[known] + error, error, 3, 1)
    two = dataclasses.replace(one, position_m=block.position_m[known] + error / 100, error_m=error / 100)
    return dataclasses.replace(adjusted(strips()), direct=(one, two), standard=LIMITS)


def _left_out() -> Adjusted:
    """Ray 200 is 50 px wrong; weights were estimated."""
    found = adjusted(strips())
    residual, used = found.adjustment.residual_px.copy(), found.adjustment.used.copy()
    residual[200], used[200] = (50.0, -1.0), False
    parts = Components(("tie rays",), np.array([False]), np.array([400]), np.array([1.3]), np.array([[0.05**2]]))
    return adjusted(strips(), residual_px=residual, used=used, components=parts)


def _failed() -> Adjusted:
    nan = np.full((len(strips().points.names), 3, 3), np.nan)
    stations = strips().sensor["pos_error"].stations
    q = len(strips().unknowns)
    trust = Trust(np.full((q, q), np.nan), np.full(q, np.nan), np.full((stations, 6), np.nan), np.full(q, np.nan))
    return adjusted(strips(), covariance_m2=nan, trust=trust, result=wj.RESULTS.rank_deficient, reasons=(NOT_DETERMINED,))


def _not_consistent() -> Adjusted:
    return adjusted(strips(), variance_factor=4.0, tail_probability=0.0, is_consistent=False, reasons=(TOO_LARGE,))


def _unseen() -> Adjusted:
    flight = strips()
    keep = flight.measurements.point != 3
    picked = {f.name: getattr(flight.measurements, f.name)[keep] for f in dataclasses.fields(flight.measurements)}
    found = adjusted(dataclasses.replace(flight, measurements=type(flight.measurements)(**picked)))
    point, covariance = found.adjustment.point_m.copy(), found.adjustment.covariance_m2.copy()
    point[3], covariance[3] = np.nan, np.nan
    return dataclasses.replace(found, adjustment=dataclasses.replace(found.adjustment, point_m=point, covariance_m2=covariance))


def _over_the_earth() -> Flight:
    """The scanner with one correction: seven of them take XLA long, and nobody looks at them here."""
    flight = made_up.scanner()
    links = dict(zip(flight.sensor.names, flight.sensor.links, strict=True))
    for name in ("drift", "smooth", "walk", "forget", "warm", "bias"):
        del links[name]
    return dataclasses.replace(flight, sensor=wj.Sensor(links, flight.sensor.camera))


CASES = {
    "sound": lambda: dataclasses.replace(adjusted(strips()), standard=LIMITS),
    "direct": _direct,
    "left out": _left_out,
    "failed": _failed,
    "a point unseen": _unseen,
    "no check": lambda: dataclasses.replace(adjusted(with_roles(strips(), check="tie")), standard=LIMITS),
    "no control": lambda: adjusted(with_roles(strips(), control="tie")),
    "ties only": lambda: adjusted(with_roles(strips(), control="tie", check="tie")),
    "trajectory kept": lambda: adjusted(strips(), errors=(), motions=None),
    "limits missed": lambda: dataclasses.replace(adjusted(strips()), standard=Standard("strict", 0.001, 10.0)),
    "not consistent": _not_consistent,
    "lines over the Earth": lambda: adjusted(_over_the_earth()),
    "frames": lambda: adjusted(made_up.frames()),
}


@functools.cache
def made(case: str) -> Adjusted:
    """One of CASES; not to be changed."""
    return CASES[case]()
