"""The flight that imaging and calibration are measured on, for whiskjax and for the C++ peers: `flights.haian`."""

from functools import cache

import jax.numpy as jnp
import numpy as np

import whiskjax as wj
from whiskjax.flights import haian

from . import peers

LEFT = 0  # index of the left swing
SWING_SIGN = (1, -1)


@cache
def recorded() -> wj.Flight:
    """One simulated flight; its sensor starts from zero parameters."""
    return haian.simulate(1)


@cache
def calibrated() -> wj.Sensor:
    """The flight's sensor with the true parameters."""
    start = recorded().sensor
    return haian.sensor(start["body"], start["scan"].encoder, start["pitch"].encoder, haian.TABLE_4)


def for_peer(swing: int) -> peers.Flight:
    """The same instrument as the arrays that C++ reads."""
    sensor = calibrated()
    body, scan, pitch = sensor["body"], sensor["scan"].encoder, sensor["pitch"].encoder
    truth = haian.TABLE_4
    return peers.Flight(
        pos_time_s=np.array(body.knots.time_s),
        position_m=np.stack(body.position_m, -1),
        quaternion_xyzw=np.stack(body.quaternion, -1),
        scan_time_s=np.array(scan.knots.time_s),
        scan_rad=np.array(scan.angle_rad),
        pitch_time_s=np.array(pitch.knots.time_s),
        pitch_rad=np.array(pitch.angle_rad),
        u_gps_m=truth.gps_arm_m,
        angles_pos_rad=truth.left_rad if swing == LEFT else truth.right_rad,
        u_sen_m=truth.sensor_arm_m,
        angles_sen_rad=truth.sensor_rad,
        focal_px=haian.FOCAL_PX,
        swing=SWING_SIGN[swing],
        max_gap_s=haian.MAX_GAP_S,
    )


def control_points() -> wj.Observations:
    """The 130 control points of the first pair of swings, their coordinates taken as exact."""
    everything = recorded().observations()
    observed = everything.take(everything.is_control)
    return wj.Observations(observed.shot, observed.point_m, observed.pixel_px, observed.sigma_px, observed.is_control)


def baked_for_peer(observed: wj.Observations) -> peers.Baked:
    """Observations with POS attitude and encoder angles already evaluated, by the links themselves."""
    sensor, shot = recorded().sensor, observed.shot
    platform = sensor.pose(shot, "flu")
    angles = [jnp.asarray(sensor[name].encoder.at(shot.time_s)) for name in ("scan", "pitch")]
    scan, pitch = (np.stack([np.sin(a), np.cos(a)], -1) for a in angles)
    return peers.Baked(
        ecef_from_platform=np.ascontiguousarray(platform.matrix),
        antenna_m=np.ascontiguousarray(platform.origin_m),
        scan_sin_cos=scan,
        pitch_sin_cos=pitch,
        right=np.asarray(observed.key("swing"), np.int32),
        point_m=np.ascontiguousarray(observed.point_m),
        pixel_px=np.ascontiguousarray(observed.pixel_px),
        sigma_px=np.ascontiguousarray(observed.sigma_px),
        focal_px=haian.FOCAL_PX,
    )
