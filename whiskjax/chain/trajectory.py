"""Where the platform is: POS samples in time, or one pose for each image."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..algebra.vectors import ZERO, Component, Vec3, add, is_structural, matmul, norm, unstack
from ..earth.ellipsoid import ecef_from_geodetic
from ..earth.frames import ecef_from_ned
from ..rules import RESULTS, Arrays, Numbers, WhiskjaxError, first_failure, is_traced, plain, require_x64
from ..rules.results import choose
from .attitudes import Slerp, TurnSpline
from .camera import parameter
from .knots import Knots, take
from .link import AbstractLink, Moves, Recorded
from .places import refuse_lone_positions
from .pose import Pose
from .possible import ImpossibleMotion, refuse_impossible_motion
from .rotations import (
    Quaternion,
    quaternion_product,
    rotation_from_angles,
    rotation_from_quaternion,
    rotation_from_vector,
)
from .samples import ecef_samples, sign_continuous, unit_quaternions
from .shot import Shot
from .spline import Interpolation, check_interpolation, hermite, spline_slopes
from .stations import AbstractStations, motion
from .turn import as_parameter, take_component
from .wraps import unclear_turn


class Trajectory(AbstractLink):
    """POS samples -> pose world_from_body at time + delay.

    `interpolation` says what happens between samples:

    - "linear", as in the papers: positions are linear (cubic Hermite where velocities exist: value and velocity are met at both
      samples), attitudes slerp. The slope jumps at every sample, of the attitude at least: a cost that is a function of a delay
      has a kink there.
    - "cubic": one spline through the positions and one of the rotation, for each piece between gaps, with continuous velocity,
      acceleration, angular rate and angular acceleration. The error falls with the fourth power of the spacing, up to the ends
      (positions: not a knot, as in scipy's `CubicSpline`; attitudes: the rate there is that of the cubic through four samples).
      Pieces of three samples are met by a parabola, pieces of two are as with "linear".

    `delay_s` shifts the whole POS, `attitude_delay_s` the attitude alone, relative to it: positive where the value valid at the
    shot was stamped later. Quaternions are made sign-continuous; times outside the record or in a gap longer than `max_gap_s`
    are refused.
    """

    knots: Knots
    position_m: Vec3  # components, each (n,)
    velocity_mps: Vec3 | None  # as recorded, or of the spline
    quaternion: Quaternion
    turning: Slerp | TurnSpline
    interpolation: Interpolation = eqx.field(static=True)
    delay_s: Component = eqx.field(converter=as_parameter)
    attitude_delay_s: Component = eqx.field(converter=as_parameter)

    def __init__(
        self,
        time_s: Float[Numbers, " n"],
        position_m: Float[Numbers, "n 3"],
        quaternion_xyzw: Float[Numbers, "n 4"],
        *,
        max_gap_s: float,
        velocity_mps: Float[Numbers, "n 3"] | None = None,
        delay_s: Component = 0,
        attitude_delay_s: Component = 0,
        interpolation: Interpolation = "linear",
    ):
        """**Arguments:**

        - `time_s`: strictly increasing, seconds; never traced, as all else may be: then what it says is not looked at.
        - `position_m`: of the POS reference point, in the world frame (ECEF or local Cartesian).
        - `quaternion_xyzw`: world_from_body, any sign, normalised here.
        - `max_gap_s`: longer intervals are not bridged.
        - `velocity_mps`: world frame; then linear positions are cubic Hermite. "cubic" has its own, and takes none.
        - `interpolation`: "linear" or "cubic".

        **Raises:** `WhiskjaxError` for times that do not increase, values that are not finite, lengths that differ; for two
        attitudes half a turn apart, between which no way round is the short one.
        """
        require_x64("Trajectory")
        arrays = Arrays("Trajectory")
        recorded_s = arrays.take("time_s", time_s, "n", absolute=True)
        position = plain(arrays.take("position_m", position_m, "n 3", absolute=True, finite=True))
        quaternion = plain(arrays.take("quaternion_xyzw", quaternion_xyzw, "n 4", absolute=True, finite=True))
        velocity = arrays.take("velocity_mps", velocity_mps, "n 3", optional=True, absolute=True, finite=True)
        self.knots = Knots(recorded_s, max_gap_s, "Trajectory")
        quaternion = sign_continuous(unit_quaternions(quaternion, "Trajectory: the quaternion of sample"))
        velocity = None if velocity is None else plain(velocity)
        time = np.asarray(recorded_s)  # not the knots', which are traced where the trajectory is made inside jit
        is_gap, traced = np.diff(time) > max_gap_s, any(map(is_traced, (position, quaternion, velocity)))
        if not traced:
            refuse_impossible_motion(time, position, quaternion, velocity, max_gap_s)
            if unclear := unclear_turn(time, quaternion, is_gap):
                raise ImpossibleMotion(unclear.sample, "attitude", lambda name: unclear.what)
        self.interpolation = check_interpolation("Trajectory", interpolation)
        if self.interpolation == "linear":
            self.turning = Slerp(quaternion)
        elif velocity is None:
            velocity = spline_slopes(time, position, is_gap)
            self.turning = TurnSpline(time, quaternion, is_gap)
        else:
            raise WhiskjaxError(
                "Trajectory: a cubic spline takes its velocities from the positions; leave velocity_mps out, or take "
                "interpolation='linear', which meets position and velocity at every sample"
            )
        self.position_m = unstack(position)
        self.velocity_mps = None if velocity is None else unstack(velocity)
        self.quaternion = unstack(quaternion)
        self.delay_s = take_component(arrays, "delay_s", delay_s, absolute=True)
        self.attitude_delay_s = take_component(arrays, "attitude_delay_s", attitude_delay_s, absolute=True)

    @classmethod
    def from_geodetic(
        cls,
        time_s: Float[Numbers, " n"],
        lat_rad: Float[Numbers, " n"],
        lon_rad: Float[Numbers, " n"],
        height_m: Float[Numbers, " n"],
        roll_rad: Float[Numbers, " n"],
        pitch_rad: Float[Numbers, " n"],
        heading_rad: Float[Numbers, " n"],
        *,
        max_gap_s: float,
        velocity_ned_mps: Float[Numbers, "n 3"] | None = None,
        delay_s: Component = 0,
        attitude_delay_s: Component = 0,
        interpolation: Interpolation = "linear",
    ) -> "Trajectory":
        """A trajectory in ECEF from POS records as they are usually written.

        **Arguments:** latitude, longitude (WGS-84), roll (right wing down +), pitch (nose up +), heading (clockwise from true
        north) in radians, ellipsoidal height in metres; ned_from_body = Rz(heading) Ry(pitch) Rx(roll).
        """
        samples = ecef_samples(lat_rad, lon_rad, height_m, roll_rad, pitch_rad, heading_rad, velocity_ned_mps)
        position, quaternion, velocity = samples
        return cls(
            time_s,
            position,
            quaternion,
            max_gap_s=max_gap_s,
            velocity_mps=velocity,
            delay_s=delay_s,
            attitude_delay_s=attitude_delay_s,
            interpolation=interpolation,
        )

    def pose(self, shot: Shot) -> Pose:
        """The interpolated pose at each shot's time."""
        t = add(shot.need("time_s", "which a trajectory needs"), self.delay_s)
        i, w, length = self.knots.locate(t)
        translation = self._position(i, w, length)
        if not is_structural(self.attitude_delay_s, 0):
            i, w, _ = self.knots.locate(t + self.attitude_delay_s)
        start: Quaternion = tuple(take(q, i) for q in self.quaternion)
        part = self.turning.since(i, w)
        return Pose(rotation_from_quaternion(quaternion_product(start, part)), translation)

    def _position(self, i, w, length) -> Vec3:
        before, after = (tuple(take(p, i + k) for p in self.position_m) for k in (0, 1))
        if self.velocity_mps is None:
            return tuple(a + w * (b - a) for a, b in zip(before, after, strict=True))
        leave, arrive = (tuple(length * take(v, i + k) for v in self.velocity_mps) for k in (0, 1))
        return tuple(hermite(w, *ends) for ends in zip(before, after, leave, arrive, strict=True))

    @property
    def kinks(self) -> tuple[str, ...]:
        """The delays, unless the record is interpolated by splines."""
        return () if self.interpolation == "cubic" else ("delay_s", "attitude_delay_s")

    @property
    def recorded(self) -> tuple[Recorded, ...]:
        """The POS, and once more where its attitude has a delay of its own."""
        position = Recorded(self.knots, self.delay_s)
        if is_structural(self.attitude_delay_s, 0):
            return (position,)
        return position, Recorded(self.knots, add(self.delay_s, self.attitude_delay_s))

    def moves(self, shot: Shot) -> Moves:
        """Between the POS samples; the angle between unit quaternions follows from their distance, 2 sin(angle / 4)."""
        spacing = jnp.diff(self.knots.time_s)
        turn = 4 * jnp.arcsin(jnp.minimum(norm(tuple(map(jnp.diff, self.quaternion))) / 2, 1.0))
        way = norm(tuple(map(jnp.diff, self.position_m)))
        return Moves(self.recorded, jnp.max(turn / spacing), jnp.max(way / spacing))

    def check(self, shot: Shot) -> RESULTS:
        """Whether the POS was recorded at the shot's time."""
        t = add(shot.need("time_s", "which a trajectory needs"), self.delay_s)
        result = self.knots.check(t)
        if is_structural(self.attitude_delay_s, 0):
            return result
        return first_failure(result, self.knots.check(t + self.attitude_delay_s))


class PosePerImage(AbstractStations):
    """One pose world_from_body for each image: frame cameras.

    `turn_rad` and `shift_m`, both (n, 3) in the body frame, are small motions of the given poses; they are where unknown poses
    live: p_world = R exp([turn]x) p_body + t + R shift.
    """

    position_m: Vec3  # components, each (n,)
    quaternion: Quaternion
    turn_rad: Float[Array, "n 3"] | None = eqx.field(converter=parameter)
    shift_m: Float[Array, "n 3"] | None = eqx.field(converter=parameter)

    def __init__(
        self,
        position_m: Float[Numbers, "n 3"],
        quaternion_xyzw: Float[Numbers, "n 4"],
        turn_rad: Float[Numbers, "n 3"] | None = None,
        shift_m: Float[Numbers, "n 3"] | None = None,
    ):
        """**Arguments:** positions in the world frame in metres, quaternions world_from_body, and the small motions or None."""
        require_x64("PosePerImage")
        arrays = Arrays("PosePerImage")
        position = plain(arrays.take("position_m", position_m, "images 3", absolute=True, finite=True))
        quaternion = plain(arrays.take("quaternion_xyzw", quaternion_xyzw, "images 4", absolute=True, finite=True))
        quaternion = unit_quaternions(quaternion, "PosePerImage: the quaternion of image")
        if not is_traced(position):
            refuse_lone_positions(arrays, position, "image")
        self.position_m = unstack(position)
        self.quaternion = unstack(quaternion)
        self.turn_rad = arrays.take("turn_rad", turn_rad, "images 3", optional=True, finite=True, within_rad=2 * np.pi)
        self.shift_m = arrays.take("shift_m", shift_m, "images 3", optional=True, finite=True)

    @property
    def stations(self) -> int:
        """Number of images."""
        return self.position_m[0].shape[0]

    @property
    def motions(self) -> tuple[Float[Array, "stations 3"] | None, Float[Array, "stations 3"] | None]:
        """`turn_rad` and `shift_m`."""
        return self.turn_rad, self.shift_m

    def acting(self, shot: Shot) -> list[tuple[Component, Component]]:
        """The shot's image, alone."""
        return [(shot.need("image", "which a pose per image needs"), 1)]

    def moved(self, shot: Shot, turn: Vec3, shift: Vec3) -> Pose:
        """The given pose of each shot's image, moved."""
        i = shot.need("image", "which a pose per image needs")
        given = Pose(rotation_from_quaternion(tuple(q[i] for q in self.quaternion)), tuple(p[i] for p in self.position_m))
        return given @ Pose(Pose().rotation if turn is ZERO else rotation_from_vector(turn), shift)

    def pose(self, shot: Shot) -> Pose:
        """The pose of each shot's image."""
        return self.moved(shot, *motion(self, shot))

    def check(self, shot: Shot) -> RESULTS:
        """Whether each image has a pose."""
        image = jnp.asarray(shot.need("image", "which a pose per image needs"))
        known = (image >= 0) & (image < self.stations)
        return choose(known, RESULTS.successful, RESULTS.unknown_key)


def ecef_from_body(
    lat_rad: Component,
    lon_rad: Component,
    height_m: Component,
    roll_rad: Component,
    pitch_rad: Component,
    heading_rad: Component,
) -> Pose:
    """Pose ecef_from_body of one navigation record, as components; ned_from_body = Rz(heading) Ry(pitch) Rx(roll)."""
    attitude = rotation_from_angles((heading_rad, pitch_rad, roll_rad), "zyx")
    return Pose(matmul(ecef_from_ned(lat_rad, lon_rad), attitude), ecef_from_geodetic(lat_rad, lon_rad, height_m))
