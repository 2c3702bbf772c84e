"""Navigation aligned with the shots: one record for each, nothing to interpolate.

A camera that stores its own navigation with every exposure, and Monte Carlo runs that draw errors for every exposure.
"""

import equinox as eqx
import jax
import numpy as np

from ..algebra.angles import Angle
from ..algebra.vectors import Component
from ..rules import RESULTS, WhiskjaxError, is_traced, require_x64
from .link import AbstractLink
from .pose import Pose
from .shot import Shot
from .trajectory import ecef_from_body
from .turn import as_parameter


class Records(AbstractLink):
    """A POS record for each shot: latitude, longitude (WGS-84), roll, pitch, heading in radians, ellipsoidal height in metres.

    ned_from_body = Rz(heading) Ry(pitch) Rx(roll). All of one batch shape, that of the shots; the structural zero costs nothing.
    """

    lat_rad: Component = eqx.field(converter=as_parameter)
    lon_rad: Component = eqx.field(converter=as_parameter)
    height_m: Component = eqx.field(converter=as_parameter)
    roll_rad: Component = eqx.field(default=0, converter=as_parameter)
    pitch_rad: Component = eqx.field(default=0, converter=as_parameter)
    heading_rad: Component = eqx.field(default=0, converter=as_parameter)

    def __check_init__(self):
        require_x64("Records")
        for name in ("lat_rad", "lon_rad", "height_m", "roll_rad", "pitch_rad", "heading_rad"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray | jax.Array) and not is_traced(value) and not np.isfinite(np.asarray(value)).all():
                place = np.argwhere(~np.isfinite(np.asarray(value)))[0].tolist()
                raise WhiskjaxError(f"records: {name} of record {', '.join(map(str, place))} is not a finite number")

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
