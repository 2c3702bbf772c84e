"""One calibration, made once, and what people would see of it."""

import dataclasses

import numpy as np
import pytest

import whiskjax as wj
from tests.show.invented import invented
from whiskjax.flights.flight import Image
from whiskjax.show.calibration.figures import draw_all
from whiskjax.show.calibration.residuals import gather
from whiskjax.show.calibration.summary import summarise


@pytest.fixture(scope="session")
def flight():
    return wj.flights.haian.simulate(5)


@pytest.fixture(scope="session")
def calibration(flight):
    return wj.calibrate(flight.sensor, flight.observations(), flight.unknowns)


@pytest.fixture(scope="session")
def summary(calibration, flight):
    return summarise(calibration, flight, "whiskjax calibrate somewhere --out there")


@pytest.fixture(scope="session")
def residuals(calibration, flight):
    return gather(calibration, flight)


@pytest.fixture(scope="session")
def drawings(summary, residuals):
    return draw_all(summary, residuals)


def made_up(n_images, per_image, *, spread=True, columns=4000, rows=3000, time=False):
    """Residuals of a frame camera: so many images with so many points each, at one place of the image unless `spread`."""
    from whiskjax.estimate.reliability import Reliability
    from whiskjax.show.calibration.residuals import Residuals
    from whiskjax.show.scales import Scales

    rng = np.random.default_rng(1)
    n = n_images * per_image
    after = rng.normal(0, 0.3, (n, 2))
    place = rng.uniform(0, 1, (n, 2)) * [columns - 1, rows - 1] if spread else np.full((n, 2), [320.0, 180.0])
    return Residuals(
        images=tuple(Image(f"frame_{i:04d}", columns=columns, rows=rows) for i in range(n_images)),
        image=np.repeat(np.arange(n_images), per_image),
        points=tuple(f"p{i}" for i in range(n)),
        is_control=np.arange(n) % 5 > 0,
        place=place,
        time_s=np.sort(rng.uniform(0, 60, n)) if time else None,
        before_px=after + [40.0, -25.0],
        after_px=after,
        sigma_px=np.full((n, 2), 0.3),
        weight=np.ones(n),
        reliability=Reliability(np.full((n, 2), 0.9), after / 0.3, np.full((n, 2), 1.3), (after**2).sum(1) / 0.09),
        scales=Scales(np.broadcast_to(0.1 * np.eye(2), (n, 2, 2)), None),
        is_line=False,
    )


@pytest.fixture(scope="session")
def undetermined(calibration, flight):
    """What `calibrate` returns with throw=False where nothing determines one unknown, which has no prior: omega_sen."""
    k = [x.name for x in flight.unknowns].index("omega_sen")
    lost = np.arange(len(flight.unknowns)) == k
    either = lost[:, None] | lost
    unknowns = tuple(
        dataclasses.replace(x, mean=None, sigma=None, scale=0.01) if x.name == "omega_sen" else x for x in flight.unknowns
    )
    posterior = dataclasses.replace(
        calibration.posterior,
        sigma=np.where(lost, np.inf, calibration.posterior.sigma),
        covariance=np.where(either, np.nan, calibration.posterior.covariance),
        correlation=np.where(either, np.nan, calibration.posterior.correlation),
        data_share=np.where(lost, np.nan, calibration.posterior.data_share),
        rank=14,
        null_space=({"omega_sen": 1.0, "omega_pos_left": -0.5},),
        condition=np.inf,
    )
    covariance = np.where(either, np.where(lost[:, None] & lost, np.inf, np.nan), calibration.estimate.covariance)
    fields = {"unknowns": unknowns, "estimate": dataclasses.replace(calibration.estimate, covariance=covariance)}
    failed = invented(calibration, fields=fields, posterior=posterior, result=wj.RESULTS.rank_deficient)
    return failed, flight
