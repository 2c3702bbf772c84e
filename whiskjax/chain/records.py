"""Navigation aligned with the shots: one record for each, nothing to interpolate.

A camera that stores its own navigation with every exposure, and Monte Carlo runs that draw errors for every exposure.
"""

import equinox as eqx
import numpy as np

from ..algebra.angles import Angle
from ..algebra.vectors import Component
from ..earth.ellipsoid import LAT_FIRST
from ..rules import RESULTS, Arrays, is_traced, require_x64
from .link import AbstractLink
from .places import refuse_absent_records
from .pose import Pose
from .samples import ATTITUDE_RAD, TURNS
from .shot import Shot
from .trajectory import ecef_from_body
from .turn import as_parameter, take_component


class Records(AbstractLink):
    """A POS record for each shot: latitude, longitude (WGS-84), roll, pitch, heading in radians, ellipsoidal height in metres.

    ned_from_body = Rz(heading) Ry(pitch) Rx(roll). All of one batch shape, that of the shots; the structural zero costs nothing.
    """

    lat_rad: Component = eqx.field(converter=as_parameter)
    lon_rad: Component = eqx.field(converter=as_parameter)
    height_m: Component = eqx.field(converter=as_parameter)
    roll_rad: Component = eqx.field(converter=as_parameter)
    pitch_rad: Component = eqx.field(converter=as_parameter)
    heading_rad: Component = eqx.field(converter=as_parameter)

    def __init__(
        self,
        lat_rad: Component,
        lon_rad: Component,
        height_m: Component,
        roll_rad: Component = 0,
        pitch_rad: Component = 0,
        heading_rad: Component = 0,
    ):
        """**Raises:** `WhiskjaxError` for float32, shapes that do not broadcast, a latitude beyond a pole, angles in degrees."""
        require_x64("Records")
        arrays = Arrays("Records")
        self.lat_rad = take_component(arrays, "lat_rad", lat_rad, absolute=True, within_rad=np.pi / 2, meaning=LAT_FIRST)
        self.lon_rad = take_component(arrays, "lon_rad", lon_rad, absolute=True, within_rad=2 * np.pi)
        self.height_m = take_component(arrays, "height_m", height_m, absolute=True)
        place = self.lat_rad, self.lon_rad, self.height_m
        if not any(isinstance(number, Angle) or is_traced(number) for number in place):
            refuse_absent_records(arrays, *map(np.asarray, place))
        self.roll_rad = take_component(arrays, "roll_rad", roll_rad, True, ATTITUDE_RAD, TURNS)
        self.pitch_rad = take_component(arrays, "pitch_rad", pitch_rad, True, ATTITUDE_RAD, TURNS)
        self.heading_rad = take_component(arrays, "heading_rad", heading_rad, True, ATTITUDE_RAD, TURNS)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """That of the records."""
        numbers = self.lat_rad, self.lon_rad, self.height_m, self.roll_rad, self.pitch_rad, self.heading_rad
        return np.broadcast_shapes(*(np.shape(n) for n in numbers if not isinstance(n, Angle)))

    def pose(self, shot: Shot) -> Pose:
        """The pose of each record."""
        return ecef_from_body(self.lat_rad, self.lon_rad, self.height_m, self.roll_rad, self.pitch_rad, self.heading_rad)

    def ready(self, shot: Shot) -> "Records":
        """The same records with the sines and cosines of their angles."""
        lat, lon, *attitude = (Angle.of(a) for a in (self.lat_rad, self.lon_rad, self.roll_rad, self.pitch_rad, self.heading_rad))
        return Records(lat, lon, self.height_m, *attitude)

    def check(self, shot: Shot) -> RESULTS:
        """Always known."""
        return RESULTS.successful
