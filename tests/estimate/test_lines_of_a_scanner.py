"""Lines that a scan mirror sweeps: pixels to a line against the textbook's loop, and a calibration from sigmas in lines."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.estimate.textbooks import Textbook
from tests.oracles import geodetic

PX = 6  # the simulation has one line a pixel; here one line is as long as six of them


@pytest.fixture(scope="module")
def coarse(flight):
    """The same flight with lines six times as long, measured as well as before, which is now said in lines."""

    def longer(image):
        return dataclasses.replace(image, lines=wj.LineTimes(image.lines.line / PX, image.lines.time_s))

    m = flight.measurements
    sigma = {"sigma_line_px": np.full(len(m), np.nan), "sigma_lines": m.sigma_line_px / PX}
    measured = dataclasses.replace(m, line_px=m.line_px / PX, **sigma)
    return dataclasses.replace(flight, images=[longer(image) for image in flight.images], measurements=measured)


def moved(flight, lines):
    """The flight with all lines measured so much later."""
    m = flight.measurements
    return dataclasses.replace(flight, measurements=dataclasses.replace(m, line_px=m.line_px + lines))


def test_pixels_to_a_line_are_those_of_the_textbook(coarse):
    """Central differences of its residuals over a thousandth of a line, so short that few of them straddle a POS sample."""
    step = 5e-4
    late, early = (Textbook(moved(coarse, s), check_too=True).residuals_px(np.zeros(15)) for s in (step, -step))
    expected = (late - early) / (2 * step)
    seen = coarse.observations()
    line = np.asarray(wj.px_per_line(coarse.sensor, seen.shot, seen.point_m, coarse.images[0].lines.s_per_line(np.array(1.0))))
    # Where POS samples are straddled the rate jumps by their jitter.
    assert np.median(np.abs(line - expected)) < 1e-4 and np.quantile(np.abs(line - expected), 0.9) < 1e-3
    assert 5.0 < np.abs(line[:, 1]).min() < np.abs(line[:, 1]).max() < 7.0
    m = coarse.measurements
    sample = np.stack([m.sigma_sample_px, np.zeros(len(m))], axis=-1)
    np.testing.assert_allclose(seen.sigma_px, np.hypot(sample, line * np.asarray(m.sigma_lines)[:, None]), rtol=1e-12)


def test_sigmas_in_lines_are_believed(coarse, calibration):
    """The errors are those of the flight in pixels, so is the variance factor; said in pixels they would be 6 times too small."""
    found = wj.calibrate(coarse.sensor, coarse.observations(), coarse.unknowns)
    assert found.fit.variance_factor == pytest.approx(calibration.fit.variance_factor, rel=0.1) and found.is_sound
    m = coarse.measurements
    wrong = dataclasses.replace(m, sigma_line_px=m.sigma_lines, sigma_lines=None)
    said = dataclasses.replace(coarse, measurements=wrong).observations()
    assert wj.calibrate(coarse.sensor, said, coarse.unknowns).fit.variance_factor > 10


def test_metres_to_a_pixel_on_level_ground(flight):
    """Up to 50 deg off nadir: how far apart rays a pixel apart meet the height of the point, which PROJ knows."""
    seen = flight.observations()
    projected = np.asarray(wj.project(flight.sensor, seen.shot, seen.point_m).pixel_px)
    level = wj.HeightSurface(geodetic(seen.point_m)[2])
    found = wj.m_per_px(flight.sensor, seen.shot, seen.point_m, wj.HeightSurface(0.0))
    for k, half in enumerate(0.5 * np.eye(2)):
        ends = [wj.image_to_ground(flight.sensor, seen.shot, projected + s * half, level).point_m for s in (1, -1)]
        # A pixel of the range is not quite even, and the Earth is round.
        np.testing.assert_allclose(found[:, k], np.linalg.norm(ends[0] - ends[1], axis=-1), rtol=1e-6)
