"""misb_uas: the issue's bands, and lines of sight and calibration against PROJ and scipy."""

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation, Slerp

import whiskjax as wj
from tests.oracles import body_in_ned, ecef, ecef_from_ned, geodetic
from tests.real import convert_misb_uas as misb
from tests.real import reach_misb_uas

SET = reach_misb_uas.SET
FLIGHTS = list(reach_misb_uas.ASKED)


class Telemetry:
    """The packets of a flight, with scipy's rotations."""

    def __init__(self, file):
        rows, _ = misb.packets(file)
        self.time = misb.seconds(rows)
        lat, lon, height = rows.numbers("sensor_lat", "sensor_lon", "sensor_alt_msl").T
        self.sensor = ecef(np.radians(lat), np.radians(lon), height)
        lat_c, lon_c, self.height = rows.numbers("fc_lat", "fc_lon", "fc_elev").T
        self.centre = ecef(np.radians(lat_c), np.radians(lon_c), self.height)
        attitude = np.radians(rows.numbers("platform_roll", "platform_pitch", "platform_heading")).T
        self.attitude = ecef_from_ned(np.radians(lat), np.radians(lon)) * body_in_ned(*attitude)
        self.azimuth, self.elevation = np.unwrap(np.radians(rows.numbers("rel_az", "rel_el")), axis=0).T
        self.focal = 0.5 * misb.COLUMNS / np.tan(np.radians(rows.numbers("hfov")) / 2)

    def frame(self, boresight=(0.0, 0.0, 0.0), attitude_delay=0.0, encoder_delay=0.0, keep=slice(None)):
        """ECEF from gimbal, x along the line of sight, at the packets' times."""
        t = self.time[keep]
        azimuth, elevation = (np.interp(t + encoder_delay, self.time, a) for a in (self.azimuth, self.elevation))
        body = Slerp(self.time, self.attitude)(t + attitude_delay)
        turret = Rotation.from_euler("XYZ", boresight)
        return body * turret * Rotation.from_euler("ZY", np.stack([azimuth, elevation], axis=-1))


@pytest.fixture(scope="module", params=FLIGHTS)
def pair(request, source_of, reached_on):
    """A flight read from its folder, its telemetry, and its source."""
    file, folders = source_of(SET) / f"{request.param}.csv", reached_on(SET).folders
    return wj.read_flight(folders[FLIGHTS.index(request.param)]), Telemetry(file), file


def test_figures(assert_met):
    assert_met(SET)


def test_miss_is_that_of_a_root_finder(pair):
    """Each tenth packet: where along the line of sight does PROJ say that the height is reached?"""
    flight, telemetry, file = pair
    found = reach_misb_uas.look(flight.sensor, flight, file)
    np.testing.assert_allclose(found.range_m, np.linalg.norm(telemetry.centre - telemetry.sensor, axis=1), rtol=0, atol=1e-6)
    sight = telemetry.frame().apply([1.0, 0.0, 0.0])
    for i in range(0, len(sight), 10):
        origin, direction, height = telemetry.sensor[i], sight[i], telemetry.height[i]

        def climb(s, origin=origin, direction=direction, height=height):
            return float(geodetic(origin + s * direction)[2]) - height

        ground = origin + brentq(climb, 10.0, 5e4, xtol=1e-9) * direction
        np.testing.assert_allclose(found.miss_m[i], np.linalg.norm(ground - telemetry.centre[i]), rtol=0, atol=1e-5)


def test_calibration_is_that_of_scipy(pair):
    flight, telemetry, _ = pair
    solved = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    keep = np.flatnonzero(misb.covered(telemetry.time))
    away, focal = telemetry.centre[keep] - telemetry.sensor[keep], telemetry.focal[keep]
    sigma = np.array([x.sigma for x in flight.unknowns])

    def residual(u):
        x, y, z = telemetry.frame(*_split(u * sigma), keep).inv().apply(away).T
        return np.concatenate([focal * y / x / misb.SIGMA_PX, focal * z / x / misb.SIGMA_PX, u])

    expected = sigma * least_squares(residual, np.zeros(5), xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    np.testing.assert_allclose((solved.value - expected) / solved.posterior.sigma, 0, atol=1e-2)
    assert solved.posterior.rank == 5


def _split(v):
    return v[:3], v[3], v[4]


BAND = 3.6  # of chi-square over its five degrees: 99.7 % of clean pairs lie below


def _halves(flight):
    """The rows before and after the middle in time, and the converter's unknowns without priors."""
    seen = flight.observations()
    order = np.argsort(np.asarray(seen.shot.time_s), kind="stable")
    unknowns = [wj.Unknown(x.name, x.where, scale=x.sigma) for x in flight.unknowns]
    return [seen.take(order[: len(order) // 2]), seen.take(order[len(order) // 2 :])], unknowns


def _apart(a, b):
    difference = a.value - b.value
    return float(difference @ np.linalg.solve(a.estimate.covariance + b.estimate.covariance, difference)) / len(difference)


def test_halves_agree_or_say_what_would_cure_them(pair):
    """Calibrated apart they agree within their sigmas, or each half that does not is unsound and states the errors; with these
    given, the halves are sound and agree."""
    flight, *_ = pair
    halves, unknowns = _halves(flight)
    plain = [wj.calibrate(flight.sensor, half, unknowns) for half in halves]
    cures = []
    for answer in plain:
        said = [reason for reason in answer.reasons if reason.kind == "residuals hang together"]
        assert answer.is_sound or (said and said[0].grade == "failure" and said[0].figures["frame"] == "aircraft")
        cures.append([wj.FrameErrors(**stated) for reason in said for stated in reason.figures["errors"]])
        print(flight.name, answer.is_sound, *(reason.text for reason in said))
    assert _apart(*plain) <= BAND or not any(answer.is_sound for answer in plain)
    cured = [wj.calibrate(flight.sensor, half, unknowns, errors=cure) for half, cure in zip(halves, cures, strict=True)]
    print(f"{flight.name}: chi-square / 5 of the halves {_apart(*plain):.3g}, with the errors stated {_apart(*cured):.3g}")
    assert all(answer.is_sound for answer in cured) and _apart(*cured) <= BAND
