"""Lines of 6 m over pixels of 1 m, measured to half a line: said in lines it is believed, said in pixels it is 6 times wrong.

The textbook's simulation knows nothing of whiskjax; chi-square bands leave out one in a million on either side.
"""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

import whiskjax as wj
from tests.files import made_up
from tests.files.folder import Folder
from tests.flights import pushbroom
from whiskjax.flights.flight import Measurements, Points
from whiskjax.show.calibration.residuals import gather

CRABS = {"straight": 0.0, "drift of 10 deg": np.radians(10.0)}


@pytest.fixture(scope="module", params=CRABS)
def made(request):
    """(flight, where each measurement's point truly lies, drift angle)."""
    crab = CRABS[request.param]
    return *pushbroom.flight(5, crab), crab


def in_band(factor, freedom):
    return chi2.ppf(1e-6, freedom) < factor * freedom < chi2.ppf(1 - 1e-6, freedom)


def test_observations_have_the_sigmas_of_the_textbook(made):
    """Half a line across the detector, and what of it goes along the detector beside the sample's own half pixel."""
    flight, point, crab = made
    line = pushbroom.LINES * pushbroom.px_per_line(point, crab)
    control = np.asarray(flight.points.roles)[flight.measurements.point] == "control"
    expected = np.hypot([pushbroom.SAMPLE_PX, 0.0], line)
    np.testing.assert_allclose(flight.observations().sigma_px, expected[control], rtol=1e-9)
    assert 3.0 < expected[:, 1].min() / np.cos(crab) < expected[:, 1].max() < 4.6


def test_rays_have_them_across_the_line(made):
    """Ties lie where their rays meet: 0.3 m of noise in 1200 m. Control points lie where they are given."""
    flight, point, crab = made
    block = flight.block()
    across = pushbroom.LINES * pushbroom.px_per_line(point, crab)[:, 1]
    assert (block.sigma_px[:, 0] == pushbroom.SAMPLE_PX).all()
    np.testing.assert_allclose(block.sigma_px[:, 1], across, rtol=0.03)
    control = block.role[block.point] == "control"
    np.testing.assert_allclose(block.sigma_px[control, 1], across[control], rtol=1e-9)


def test_the_same_in_python(made):
    """As docs/conventions.md says, and what a solver then has is what the flight would have given it."""
    flight, _, _ = made
    given = flight.observations()
    line = np.asarray(wj.px_per_line(flight.sensor, given.shot, given.point_m, pushbroom.LINE_S))
    sigma = np.hypot([pushbroom.SAMPLE_PX, 0.0], pushbroom.LINES * line)
    np.testing.assert_allclose(sigma, given.sigma_px, rtol=1e-9)


def test_half_a_line_is_believed(made, tmp_path):
    """Read from files: the variance factor of a calibration and of an adjustment is one; said in pixels it is not."""
    flight, _, crab = made
    back = wj.read_flight(wj.write_flight(flight, tmp_path / "flight"))
    solved = wj.calibrate(back.sensor, back.observations(), back.unknowns)
    assert solved.fit.degrees_of_freedom == 2 * 120 - 3
    assert in_band(solved.fit.variance_factor, solved.fit.degrees_of_freedom) and solved.is_sound
    adjusted = wj.adjust(back.sensor, back.block(), back.unknowns)
    assert in_band(adjusted.variance_factor, adjusted.freedom) and adjusted.is_sound
    wrong, _ = pushbroom.flight(5, crab, sigmas="px")
    assert wj.calibrate(wrong.sensor, wrong.observations(), wrong.unknowns).fit.variance_factor > 15
    assert wj.adjust(wrong.sensor, wrong.block(), wrong.unknowns).variance_factor > 15


def test_residuals_in_lines_and_metres(made):
    """From the textbook's own projection at the same instant: it knows neither G nor a rate."""
    flight, point, crab = made
    solved = wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)
    found = gather(solved, flight)
    control = np.asarray(flight.points.roles)[flight.measurements.point] == "control"
    line = pushbroom.px_per_line(point[control], crab)[:, 1]
    depth = (pushbroom.HEIGHT_M - point[control, 2]) / pushbroom.FOCAL_PX
    # The solution has turned the camera by some 1e-4 rad.
    np.testing.assert_allclose(found.scales.px_per_line, line, rtol=1e-3)
    np.testing.assert_allclose(found.scales.m_per_px, np.stack([depth, depth], axis=-1), rtol=1e-3)
    np.testing.assert_allclose(found.scales.lines(found.after_px), found.after_px[:, 1] / line, rtol=1e-3)
    assert 0.4 < np.std(found.scales.lines(found.after_px)) < 0.6  # half a line
    length = np.hypot(*found.after_px.T) * depth
    np.testing.assert_allclose(found.scales.length(found.after_px), length, rtol=1e-3)


def test_a_folder_keeps_the_unit_of_every_sigma(tmp_path):
    """Lines where all are in lines; both columns, with blanks, where some are in pixels; and numbers to the last digit."""
    flight, _ = pushbroom.flight(5)
    folder = Folder(wj.write_flight(flight, tmp_path / "lines"))
    assert folder.rows("observations.csv")[0] == ["image", "point", "line", "sample", "sigma_lines", "sigma_sample_px"]
    m = flight.measurements
    some = np.arange(len(m)) % 2 == 0
    px, lines = np.where(some, 0.7, np.nan), np.where(some, np.nan, np.linspace(0.3, 0.4, len(m)))
    mixed = dataclasses.replace(flight, measurements=dataclasses.replace(m, sigma_line_px=px, sigma_lines=lines))
    folder = Folder(wj.write_flight(mixed, tmp_path / "mixed"))
    assert {"sigma_line_px", "sigma_lines"} < set(folder.rows("observations.csv")[0])
    back = wj.read_flight(folder.path).measurements
    np.testing.assert_array_equal(back.sigma_line_px, px)
    np.testing.assert_array_equal(back.sigma_lines, lines)
    np.testing.assert_array_equal(wj.read_flight(folder.path).block().sigma_px[some, 1], 0.7)


@pytest.mark.parametrize(
    ("column", "value", "parts"),
    [
        ("sigma_lines", "", ("line 3", "sigma_lines", "is blank, and a value is needed")),
        ("sigma_lines", "0", ("line 3", "sigma_lines", "not positive")),
        ("sigma_lines", "-0.5", ("line 3", "sigma_lines", "not positive")),
        ("sigma_lines", "half", ("line 3", "sigma_lines", "not a number")),
    ],
)
def test_a_wrong_sigma_is_refused(tmp_path, column, value, parts):
    folder = Folder(wj.write_flight(pushbroom.flight(5)[0], tmp_path / "flight"))
    folder.cell("observations.csv", 3, column, value).refused("observations.csv", *parts)


def test_said_twice_or_not_at_all_is_refused(tmp_path):
    folder = Folder(wj.write_flight(pushbroom.flight(5)[0], tmp_path / "flight"))
    folder.add_column("observations.csv", "sigma_line_px", "")
    wj.read_flight(folder.path)
    folder.cell("observations.csv", 4, "sigma_line_px", "3")
    folder.refused("observations.csv, line 4, column sigma_lines", "0.5, but sigma_line_px is 3", "said once")
    folder.cell("observations.csv", 4, "sigma_line_px", "").cell("observations.csv", 5, "sigma_lines", "")
    folder.refused("observations.csv, line 5, column sigma_lines", "is blank, and so is sigma_line_px", "in focal-plane pixels")
    folder.drop_column("observations.csv", "sigma_lines").drop_column("observations.csv", "sigma_line_px")
    folder.refused("observations.csv, line 1", "sigma_line_px is missing")
    m = pushbroom.flight(5)[0].measurements
    for change, match in (
        ({"sigma_line_px": np.full(len(m), 3.0)}, "one of them"),
        ({"sigma_lines": None}, "one of them"),
        ({"sigma_lines": np.full(len(m), -0.5)}, "must be positive, not -0.5"),
    ):
        with pytest.raises(wj.FlightError, match=f"measurement 0: .*{match}"):
            dataclasses.replace(m, **change)


def test_a_line_that_stands_still_is_named():
    """As where a scan mirror turns back: here the lines are so short that nothing moves from one to the next."""
    flight, _ = pushbroom.flight(5)
    lines = wj.LineTimes([0.0, 4e6], [pushbroom.FIRST_S, pushbroom.LAST_S])
    images = [dataclasses.replace(image, lines=lines) for image in flight.images]
    m = dataclasses.replace(flight.measurements, line_px=flight.measurements.line_px * 1e4)
    still = dataclasses.replace(flight, images=images, measurements=m)
    for ask in (still.observations, still.block):
        with pytest.raises(wj.FlightError, match="observation 0, image fore, point P0: sigma_lines: from line to line the image"):
            ask()


def test_a_frame_has_no_lines(tmp_path):
    flight = made_up.frames()
    m = dataclasses.replace(flight.measurements, sigma_line_px=np.full(5, np.nan), sigma_lines=np.full(5, 0.5))
    wrong = dataclasses.replace(flight, measurements=m)
    for ask in (wrong.observations, wrong.block, lambda: wrong.looks([0]), lambda: wj.write_flight(wrong, tmp_path / "wrong")):
        with pytest.raises(wj.FlightError, match=r"\b0.*sigma_line"):
            ask()
    assert not (tmp_path / "wrong").exists()


def alone(flight, keep):
    """The flight with some of its measurements only."""
    m = flight.measurements
    return dataclasses.replace(flight, measurements=Measurements(**{name: v[keep] for name, v in vars(m).items()}))


def test_a_point_without_place_is_taken_at_the_mean_height_of_the_others():
    """A tie that one view sees, in a world whose control points lie 200 m high on the average: 6 px over 1000 m of 1200."""
    flight, _ = pushbroom.flight(5, ties=21)  # less one, sizes are those of the other tests: nothing is compiled anew
    m = flight.measurements
    tie = int(np.flatnonzero(np.asarray(flight.points.roles) == "tie")[0])
    once = alone(flight, (m.point != tie) | (m.image == 1))
    ray = int(np.flatnonzero(once.measurements.point == tie)[0])
    mean = np.mean(flight.points.position_m[:40, 2])
    expected = 0.5 * 6.0 * 1200.0 / (1200.0 - mean)
    assert once.block().sigma_px[ray, 1] == pytest.approx(expected, rel=1e-9)
    looks, index = once.looks([tie])
    assert index.tolist() == [ray] and float(looks.sigma_px[0, 1]) == pytest.approx(expected, rel=1e-9)
    high, _ = once.looks([tie], 600.0)
    assert float(high.sigma_px[0, 1]) == pytest.approx(6.0, rel=1e-9)
    nobody = Points(flight.points.names, np.full((61, 3), np.nan), flight.points.sigma_enu_m, ["tie"] * 61)
    with pytest.raises(wj.FlightError, match=f"point P{tie}: sigma_lines: .*give sigma_line_px"):
        dataclasses.replace(once, points=nobody).looks([tie])


def test_looks_have_the_sigmas_of_the_textbook(made):
    """A target that nobody has surveyed lies where its looks meet; locate then believes them."""
    flight, point, crab = made
    scores = []
    for target in range(40, 60):
        looks, index = flight.looks([target])
        line = pushbroom.LINES * pushbroom.px_per_line(point[index], crab)
        np.testing.assert_allclose(looks.sigma_px, np.hypot([pushbroom.SAMPLE_PX, 0.0], line), rtol=0.03)
        guess = wj.Guess.around(np.array([2400.0, 0.0, 200.0]), np.array([3000.0, 3000.0, 3000.0]))
        up = wj.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
        scores.append(float(wj.locate(flight.sensor, looks, guess=guess, surface=up, method="batch").chi_square))
    assert in_band(np.sum(scores) / 60, 60)  # 20 targets, three of six measurements left over
