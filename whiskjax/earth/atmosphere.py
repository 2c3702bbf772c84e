"""The U.S. Standard Atmosphere 1976 up to 86 km, and how much slower light is in it.

Heights are above mean sea level. An ellipsoidal height serves as well: a geoid 50 m off changes the density by 0.5 %, the day's
weather by several per cent.

Sources: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), Table 4 and equations 18, 23, 33 and 42; Ciddor (1996), Applied Optics
35, 1566-1573, equation 1.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ..algebra.vectors import Component
from ..rules import WhiskjaxError

SEA_LEVEL_DENSITY_KGPM3 = 101325.0 * 28.9644e-3 / (8.31432 * 288.15)
# The lowest height of the standard's tables, and the highest one at which air is still mixed.
LOWEST_M, HIGHEST_M = -5000.0, 86000.0
_EFFECTIVE_RADIUS_M = 6356766.0
_HYDROSTATIC_KPM = 9.80665 * 28.9644e-3 / 8.31432  # g M / R
# Base of each layer in geopotential metres, and its lapse rate in K/m.
_BASE_M = np.array([0.0, 11000.0, 20000.0, 32000.0, 47000.0, 51000.0, 71000.0])
_LAPSE_KPM = np.array([-6.5, 0.0, 1.0, 2.8, 0.0, -2.8, -2.0]) / 1000


class Air(NamedTuple):
    """Dry air at some height: (molecular-scale) temperature, pressure and density."""

    temperature_k: Float[Array, "..."]
    pressure_pa: Float[Array, "..."]
    density_kgpm3: Float[Array, "..."]


def _bases() -> tuple[np.ndarray, np.ndarray]:
    """Temperature and pressure at the base of every layer, from the ground up."""
    temperature, pressure = [288.15], [101325.0]
    for base, top, lapse in zip(_BASE_M, _BASE_M[1:], _LAPSE_KPM, strict=False):
        t, rise = temperature[-1], lapse * (top - base)
        exponent = (top - base) / t if lapse == 0 else math.log1p(rise / t) / lapse
        temperature.append(t + rise)
        pressure.append(pressure[-1] * math.exp(-_HYDROSTATIC_KPM * exponent))
    return np.array(temperature), np.array(pressure)


_BASE_K, _BASE_PA = _bases()
# Heights in metres where one layer ends and the next one begins; between them the density is smooth.
LAYERS_M = np.array([LOWEST_M, *(_EFFECTIVE_RADIUS_M * _BASE_M / (_EFFECTIVE_RADIUS_M - _BASE_M))[1:], HIGHEST_M])


def air_in_layer(height_m: Component, layer: ArrayLike) -> Air:
    """Air at a height that lies in the layer of this index; `layer` broadcasts against the height."""
    base, base_k, base_pa, lapse = (jnp.asarray(table)[layer] for table in (_BASE_M, _BASE_K, _BASE_PA, _LAPSE_KPM))
    above = _EFFECTIVE_RADIUS_M * height_m / (_EFFECTIVE_RADIUS_M + height_m) - base
    isothermal = lapse == 0
    warming = jnp.log1p(lapse * above / base_k) / jnp.where(isothermal, 1.0, lapse)
    pressure = base_pa * jnp.exp(-_HYDROSTATIC_KPM * jnp.where(isothermal, above / base_k, warming))
    temperature = base_k + lapse * above
    return Air(temperature, pressure, pressure * _HYDROSTATIC_KPM / (9.80665 * temperature))


def air(height_m: Component) -> Air:
    """Air at a height from -5 to 86 km; beyond, NaN."""
    height = jnp.asarray(height_m, dtype=float)
    layer = sum((height >= base).astype(int) for base in LAYERS_M[1:-1])
    known = (height >= LOWEST_M) & (height <= HIGHEST_M)
    found = air_in_layer(jnp.where(known, height, 0.0), jnp.where(known, layer, 0))
    return Air(*(jnp.where(known, value, jnp.nan) for value in found))


def sea_level_refractivity(wavelength_um: float) -> float:
    """n - 1 of dry air (450 ppm CO2) at 15 C and 1013.25 hPa; elsewhere it is proportional to the density.

    **Arguments:** `wavelength_um`: in vacuum, in micrometres.

    **Raises:** `WhiskjaxError` outside 0.23 to 1.69 um, where Ciddor's dispersion was fitted.
    """
    if not 0.23 <= wavelength_um <= 1.69:
        raise WhiskjaxError(
            f"the dispersion of air is known from 0.23 to 1.69 um, not at {wavelength_um} um; give the nearer end, and a scale"
        )
    square = wavelength_um**-2
    return 1e-8 * (5792105 / (238.0185 - square) + 167917 / (57.362 - square))
