"""The standard atmosphere against its printed tables, and the refractivity of air against Edlen's formula."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import whiskjax as wj
from tests.derivatives import assert_derivatives
from whiskjax.earth.atmosphere import HIGHEST_M, LAYERS_M, LOWEST_M, air, air_in_layer, sea_level_refractivity

# U.S. Standard Atmosphere, 1976, Table I: geometric height, molecular-scale temperature, pressure, density, as printed.
PRINTED = np.array(
    [
        [-5000, 320.676, 1.7776e5, 1.9311e0],
        [0, 288.150, 1.01325e5, 1.2250e0],
        [1000, 281.651, 8.9876e4, 1.1117e0],
        [5000, 255.676, 5.4048e4, 7.3643e-1],
        [10000, 223.252, 2.6499e4, 4.1351e-1],
        [11000, 216.774, 2.2699e4, 3.6480e-1],
        [20000, 216.650, 5.5293e3, 8.8910e-2],
        [30000, 226.509, 1.1970e3, 1.8410e-2],
        [40000, 250.350, 2.8714e2, 3.9957e-3],
        [50000, 270.650, 7.9779e1, 1.0269e-3],
        [60000, 247.021, 2.1958e1, 3.0968e-4],
        [70000, 219.585, 5.2209e0, 8.2829e-5],
    ]
)


@pytest.fixture(scope="module")
def standard():
    return jax.jit(air)


def test_temperature_pressure_and_density_are_those_of_the_printed_table(standard):
    height, *printed = PRINTED.T
    for value, expected, digit in zip(standard(height), printed, (0.001, 1e-4, 1e-4), strict=True):
        allowed = digit if digit == 0.001 else digit * expected
        assert (np.abs(value - expected) <= 0.6 * allowed).all()


def test_the_air_carries_itself(standard):
    """dp = -rho g dz over the geometric height, g from the law of gravitation, integrated from the ground."""

    def falls(z, p):
        return -np.asarray(standard(z).density_kgpm3) * 9.80665 * (6356766 / (6356766 + z)) ** 2 + 0 * p

    # Layer by layer: across the kink between two of them no method keeps its order.
    tops, pressure = [0.0, *LAYERS_M[2:-1]], [101325.0]
    for span in itertools.pairwise(tops):
        pressure.append(solve_ivp(falls, span, pressure[-1:], method="DOP853", rtol=1e-12, atol=1e-12).y[0, -1])
    np.testing.assert_allclose(standard(np.array(tops)).pressure_pa, pressure, rtol=1e-7)


def test_layers_meet(standard):
    for layer, height in enumerate(LAYERS_M[1:-1]):
        below, above = (air_in_layer(jnp.asarray(height), i) for i in (layer, layer + 1))
        np.testing.assert_allclose(below, above, rtol=1e-13)


def test_nothing_is_extrapolated(standard):
    ends = standard(np.array([LOWEST_M, HIGHEST_M, LOWEST_M - 1, HIGHEST_M + 1, -6.4e6, np.inf]))
    for value in ends:
        np.testing.assert_array_equal(np.isfinite(value), [True, True, False, False, False, False])


@pytest.mark.parametrize("shape", [(), (1,), (3, 2)])
def test_shapes(standard, shape):
    for value in standard(np.full(shape, 12e3)):
        assert value.shape == shape and value.dtype == np.float64


def test_derivatives_of_density_with_height():
    assert_derivatives(lambda h: air(h).density_kgpm3, [[300.0], [15e3], [25e3], [60e3]], step=20.0, tolerance=1e-12)


def test_refractivity_is_that_of_edlen():
    """Edlen (1966), Metrologia 2, 71, equation 1, of air with 300 ppm CO2: within a few 1e-8 of Ciddor in the visible."""
    for wavelength in (0.25, 0.4, 0.55, 0.7, 1.0, 1.6):
        square = wavelength**-2
        edlen = 1e-8 * (8342.13 + 2406030 / (130 - square) + 15997 / (38.9 - square))
        assert abs(sea_level_refractivity(wavelength) - edlen) < 5e-8
    # NIST, Engineering Metrology Toolbox, and every textbook: 1.000278 in the green.
    assert abs(sea_level_refractivity(0.55) - 2.778e-4) < 5e-8


@pytest.mark.parametrize("wavelength", [0.2, 10.0, float("nan")])
def test_wavelengths_without_a_dispersion_are_refused(wavelength):
    with pytest.raises(wj.WhiskjaxError, match=r"known from 0\.23 to 1\.69 um"):
        sea_level_refractivity(wavelength)
