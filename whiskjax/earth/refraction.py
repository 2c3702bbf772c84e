"""Atmospheric refraction of a line of sight from a platform to the ground, in both directions.

The atmosphere is layered in spheres about the centre of curvature below the platform (Gaussian mean radius), so that along a ray
n r sin z is constant (Bouguer; Born and Wolf, Principles of Optics, section 3.2). A ray that leaves the platform at the apparent
angle z off nadir and a straight line in the same direction reach the radius of the ground at central angles that differ by

    D sin z = integral of (tan z_straight - tan z_bent) dr / r,

and the bent one at the smaller angle: the ray is bent towards the nadir, and meets the ground nearer. Seen from the platform, the
horizontal part of the way to that point is shorter by a factor that is a function of sin^2 z: nothing is singular at nadir. Where
there is no air it is 1, whatever the sphere and the quadrature.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.implicit import implicit
from ..algebra.vectors import Component, Vec3, dot, scale, vadd, vsub
from ..rules import RESULTS, Arrays, Numbers
from ..rules.results import failure_if
from .atmosphere import HIGHEST_M, LAYERS_M, LOWEST_M, SEA_LEVEL_DENSITY_KGPM3, air, air_in_layer, sea_level_refractivity
from .ellipsoid import ECCENTRICITY2, SEMI_MINOR_M, height_and_up

# Nodes of Gauss and Legendre in each layer, and steps of the fixed point from the true to the apparent ray.
_NODES, _STEPS = 4, 5


class Refraction(eqx.Module):
    """Refraction in the U.S. Standard Atmosphere 1976, for an ECEF world: `Sensor(links, camera, refraction=Refraction())`.

    For looks at least a degree below the horizon. A ground point that is not below the platform is left where it is. Heights
    below -5 km, as those of any point of a local world, are refused: NaN, and a result that is no success.

    `scale`: a factor on n - 1, for air that is denser than the standard's; it may be an unknown, "refraction.scale".
    `wavelength_um`: in micrometres, 0.23 to 1.69.
    """

    scale: Float[Array, ""]
    wavelength_um: float = eqx.field(static=True)

    def __init__(self, scale: Float[Numbers, ""] = 1.0, wavelength_um: float = 0.55):
        """**Raises:** `WhiskjaxError` for a negative scale, or a wavelength at which the dispersion is not known."""
        arrays = Arrays("Refraction")
        self.scale = jnp.asarray(arrays.take("scale", scale, "", finite=True, least=0.0))
        self.wavelength_um = float(arrays.take("wavelength_um", wavelength_um, ""))
        sea_level_refractivity(self.wavelength_um)

    def true_direction(self, origin: Vec3, direction: Vec3, height_m: Component) -> tuple[Vec3, RESULTS]:
        """From the apparent ray to the straight line to the point where the bent one comes down to a height.

        **Arguments:**

        - `origin`: the platform, ECEF, metres.
        - `direction`: apparent direction at the platform, any length.
        - `height_m`: ellipsoidal height of the ground where the ray meets it.

        **Returns:** the direction of the chord, its vertical part that of the apparent one; and `ray_misses_ground` where the
        straight line in the apparent direction does not come down to that height.
        """
        platform_m, *up = height_and_up(*origin)
        climb = dot(direction, up)
        level = vsub(direction, scale(climb, up))
        square = dot(level, level)
        column = self._column(platform_m, up, height_m)
        shorter, reaches = column.shortening(square / (square + climb * climb))
        misses = column.below & ~(reaches & (climb < 0))
        return vsub(direction, scale(shorter, level)), failure_if(misses, RESULTS.ray_misses_ground)

    def apparent_point(self, origin: Vec3, point: Vec3) -> Vec3:
        """From the ground point to the one that a straight chain must image in its place.

        **Arguments:** `origin`: the projection centre; `point`: the ground point; ECEF, metres.

        **Returns:** the point moved away from the platform in the platform's horizontal plane: the two have one apparent ray. NaN
        where no ray of the iteration reaches it, at the horizon.
        """
        platform_m, *up = height_and_up(*origin)
        height_m, *_ = height_and_up(*point)
        line = vsub(point, origin)
        climb = dot(line, up)
        level = vsub(line, scale(climb, up))
        column = self._column(platform_m, up, height_m)
        square = dot(level, level) / jnp.where(column.below, climb * climb, 1.0)  # tangent of the true angle off nadir, squared
        longer, reaches = _lengthening(*jax.lax.stop_gradient((column, square)))
        (longer,) = implicit(_misses, (longer,), column, square)
        return vadd(point, scale(jnp.where(reaches | ~column.below, longer, jnp.nan), level))

    def _column(self, platform_m: Component, up: Sequence[Component], ground_m: Component) -> "_Column":
        """The air between two heights."""
        below = ground_m < platform_m
        known = jnp.minimum(platform_m, ground_m) >= LOWEST_M
        platform = jnp.where(known, platform_m, jnp.nan)
        drop = jnp.where(below, platform - ground_m, 1.0)  # a metre that keeps everything finite
        radius = SEMI_MINOR_M / (1 - ECCENTRICITY2 * up[2] * up[2]) + platform
        # From here on the nodes are the last axis; the height of a node lies in a layer that is known while tracing.
        platform, drop, radius = (a[..., None] for a in jnp.broadcast_arrays(platform, drop, radius))
        layer, node, weight = (table.reshape(*(1,) * (drop.ndim - 1), -1) for table in _quadrature())
        floor, ceiling = LAYERS_M[layer], LAYERS_M[layer + 1]
        low, high = (
            jnp.where(height < floor, floor, jnp.where(height > ceiling, ceiling, height))
            for height in (platform - drop, platform)
        )
        height = low + (high - low) * node
        refractivity = self.scale * (sea_level_refractivity(self.wavelength_um) / SEA_LEVEL_DENSITY_KGPM3)
        in_air = platform < HIGHEST_M
        there = refractivity * jnp.where(in_air, air(jnp.where(in_air, platform, 0.0)).density_kgpm3, 0.0)
        more = (refractivity * air_in_layer(height, layer).density_kgpm3 - there) / (1 + there)
        fall = (platform - height) / radius
        thick = (high - low) * weight / ((1 - fall) * radius)
        return _Column(fall, more * (2 + more), thick, (drop / radius)[..., 0], below)


def _apart(longer: Component, column: "_Column", square: Component) -> tuple[Component, Array]:
    """By which part the apparent ray's horizontal part is longer than the chord's, if it is by `longer`; and if it gets there."""
    tangent2 = (1 + longer) * (1 + longer) * square
    shorter, reaches = column.shortening(tangent2 / (1 + tangent2))
    return shorter / (1 - shorter), reaches


def _lengthening(column: "_Column", square: Component) -> tuple[Component, Array]:
    """The fixed point, and whether the rays of all steps get to the ground; `square`: tangent of the chord off nadir, squared."""

    def step(_, state):
        longer, reaches = state
        longer, gets_there = _apart(longer, column, square)
        return longer, reaches & gets_there

    return jax.lax.fori_loop(0, _STEPS, step, (jnp.zeros_like(square), jnp.ones(square.shape, dtype=bool)))


def _misses(longer: tuple[Component], column: "_Column", square: Component) -> tuple[Component]:
    """What vanishes at the fixed point."""
    return (longer[0] - _apart(longer[0], column, square)[0],)


def _quadrature() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Layer, place from 0 to 1 in it, and weight of each node."""
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    layers = len(LAYERS_M) - 1
    return np.repeat(np.arange(layers), _NODES), np.tile((node + 1) / 2, layers), np.tile(weight / 2, layers)


class _Column(NamedTuple):
    """The air along a ray; lengths over the distance of the platform from the centre.

    At the nodes (..., nodes): `fall`, the depth below the platform; `excess`, n^2 over that of the platform, less 1; `thick`, the
    weight dr / r. One each (...): `drop`, the depth of the ground; `below`, whether it has one.
    """

    fall: Array
    excess: Array
    thick: Array
    drop: Array
    below: Array

    def shortening(self, sine2: Component) -> tuple[Component, Array]:
        """By which part the horizontal part of the chord is shorter than that of the apparent ray; and whether it gets there.

        **Arguments:** `sine2`: squared sine of the apparent angle off nadir.
        """
        sunk = self.drop * (2 - self.drop)  # 1 - r0^2 of the radius of the ground
        reaches = self.below & (1 - sine2 > sunk)
        sine2 = jnp.where(reaches, sine2, 0.0)  # nadir keeps the roots and their gradients finite
        cosine2 = 1 - sine2
        # (r cos z)^2 along the straight line, and by how much it is more along the bent one.
        straight2 = cosine2[..., None] - self.fall * (2 - self.fall)
        more = (1 - self.fall) * (1 - self.fall) * self.excess
        straight, bent = jnp.sqrt(straight2), jnp.sqrt(straight2 + more)
        d = jnp.sum(self.thick * more / (straight * bent * (straight + bent)), axis=-1)
        # The straight line ends after t at t (sin z, cos z); turned back by the angle d sin z about the centre that point is the
        # end of the bent ray. Its direction is asked. The sine and 1 - cosine of d sin z are their series.
        angle2 = sine2 * d * d
        turn, versine = d * (1 - angle2 / 6), angle2 / 2 * (1 - angle2 / 12)
        cosine, end = jnp.sqrt(cosine2), jnp.sqrt(cosine2 - sunk)
        t = sunk / (cosine + end)
        depth = t * cosine * (1 - versine) + versine - t * sine2 * turn
        return jnp.where(reaches, (turn * end + versine) / depth, 0.0), reaches
