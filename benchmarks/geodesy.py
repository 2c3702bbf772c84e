"""Geodetic <-> ECEF against pyproj and pymap3d: a million points."""

import importlib
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np

import whiskjax as wj

from .peers import MissingPeer
from .suite import benchmark
from .timing import Measured, compiled, race

POINTS = 1_000_000
OURS_M = 1e-8  # two roundings of an ECEF coordinate are 2e-9 m
PEERS_M = 1e-5  # PROJ's one step of Bowring's formula leaves 2e-6 m at 15 km (and 2 mm at 500 km)
EARTH_RADIUS_M = 6.4e6


def _peer(name: str):
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingPeer(f"{name} is not installed: pip install 'whiskjax[bench]'") from error


@cache
def _points() -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """Latitude, longitude (rad) and height (m) over the whole Earth, sea floor to aircraft, and their ECEF (n, 3) by PROJ."""
    rng = np.random.default_rng(20240)
    lat, lon = np.arcsin(rng.uniform(-1, 1, POINTS)), rng.uniform(-np.pi, np.pi, POINTS)
    geodetic = lat, lon, rng.uniform(-11e3, 15e3, POINTS)
    x, y, z = _pyproj().transform(np.degrees(lon), np.degrees(lat), geodetic[2])
    return geodetic, np.stack([x, y, z], -1)


def _pyproj(back: bool = False):
    crs = ("EPSG:4978", "EPSG:4979") if back else ("EPSG:4979", "EPSG:4978")
    return _peer("pyproj").Transformer.from_crs(*crs, always_xy=True)


def _to_ecef(peer, peer_result) -> Measured:
    geodetic, ecef = _points()
    args = [jnp.asarray(v) for v in geodetic]
    ours, compile_s = compiled(jax.vmap(wj.geodetic_to_ecef), *args)
    for result in (ours(*args), np.stack(peer_result, -1)):
        np.testing.assert_allclose(result, ecef, rtol=0, atol=OURS_M)
    return race(lambda: ours(*args), peer, items=POINTS, compile_s=compile_s)


def _to_geodetic(peer, peer_result) -> Measured:
    geodetic, ecef = _points()
    point = jnp.asarray(ecef)
    ours, compile_s = compiled(jax.vmap(wj.ecef_to_geodetic), point)
    metres = EARTH_RADIUS_M, EARTH_RADIUS_M * np.cos(geodetic[0]), 1.0
    for result, atol in ((ours(point), OURS_M), (peer_result, PEERS_M)):
        for got, true, metre in zip(result, geodetic, metres, strict=True):
            np.testing.assert_allclose(metre * (got - true), 0, rtol=0, atol=atol)
    return race(lambda: ours(point), peer, items=POINTS, compile_s=compile_s)


# Each peer gets the units and the memory layout that it takes without converting: pyproj degrees, both separate arrays.


@benchmark("geodetic_to_ecef.pyproj", what="geodetic to ECEF", peer="pyproj", asked=1.0)
def to_ecef_pyproj() -> Measured:
    (lat, lon, height), _ = _points()
    transform, lon_deg, lat_deg = _pyproj().transform, np.degrees(lon), np.degrees(lat)
    return _to_ecef(lambda: transform(lon_deg, lat_deg, height), transform(lon_deg, lat_deg, height))


@benchmark("geodetic_to_ecef.pymap3d", what="geodetic to ECEF", peer="pymap3d", asked=1.0)
def to_ecef_pymap3d() -> Measured:
    geodetic, _ = _points()
    convert = _peer("pymap3d").geodetic2ecef
    return _to_ecef(lambda: convert(*geodetic, deg=False), convert(*geodetic, deg=False))


@benchmark("ecef_to_geodetic.pyproj", what="ECEF to geodetic", peer="pyproj", asked=1.0)
def to_geodetic_pyproj() -> Measured:
    x, y, z = (np.ascontiguousarray(c) for c in _points()[1].T)
    transform = _pyproj(back=True).transform
    lon_deg, lat_deg, height = transform(x, y, z)
    return _to_geodetic(lambda: transform(x, y, z), (np.radians(lat_deg), np.radians(lon_deg), height))


@benchmark("ecef_to_geodetic.pymap3d", what="ECEF to geodetic", peer="pymap3d", asked=1.0)
def to_geodetic_pymap3d() -> Measured:
    x, y, z = (np.ascontiguousarray(c) for c in _points()[1].T)
    convert = _peer("pymap3d").ecef2geodetic
    return _to_geodetic(lambda: convert(x, y, z, deg=False), convert(x, y, z, deg=False))
