"""whiskjax: differentiable sensor models for airborne scanners and cameras.

One imaging chain (trajectory -> mounts -> scan mirror or gimbal -> camera -> ground) in pure JAX functions, and what follows from
it: calibration, location, sensitivity. This file re-exports the public names and does nothing else.
"""

from . import flights as flights
from .chain.bake import bake as bake
from .chain.by import By as By
from .chain.camera import AbstractCamera as AbstractCamera
from .chain.camera import FrameCamera as FrameCamera
from .chain.correction import AbstractBasis as AbstractBasis
from .chain.correction import Bias as Bias
from .chain.correction import Correction as Correction
from .chain.correction import Drift as Drift
from .chain.correction import OrientationImages as OrientationImages
from .chain.correction import Spline as Spline
from .chain.image_scale import m_per_px as m_per_px
from .chain.image_scale import px_per_line as px_per_line
from .chain.imaging import image_to_ground as image_to_ground
from .chain.imaging import project as project
from .chain.imaging import ray as ray
from .chain.joints import joint_derivatives as joint_derivatives
from .chain.line_camera import LineCamera as LineCamera
from .chain.lines import LineTimes as LineTimes
from .chain.link import AbstractLink as AbstractLink
from .chain.look_table import LookTable as LookTable
from .chain.mounts import Axes as Axes
from .chain.mounts import Mount as Mount
from .chain.pose import Motion as Motion
from .chain.pose import Pose as Pose
from .chain.process import Process as Process
from .chain.records import Records as Records
from .chain.search import ground_to_image as ground_to_image
from .chain.sensor import Sensor as Sensor
from .chain.shot import Shot as Shot
from .chain.stations import AbstractStations as AbstractStations
from .chain.trajectory import PosePerImage as PosePerImage
from .chain.trajectory import Trajectory as Trajectory
from .chain.turn import Encoder as Encoder
from .chain.turn import Readings as Readings
from .chain.turn import Turn as Turn
from .doctor.diagnosis import Diagnosis as Diagnosis
from .doctor.diagnosis import Finding as Finding
from .doctor.examine import examine as examine
from .earth.ellipsoid import ecef_to_geodetic as ecef_to_geodetic
from .earth.ellipsoid import geodetic_to_ecef as geodetic_to_ecef
from .earth.frames import enu_rotation as enu_rotation
from .earth.frames import ned_rotation as ned_rotation
from .earth.refraction import Refraction as Refraction
from .earth.surface import AbstractSurface as AbstractSurface
from .earth.surface import HeightSurface as HeightSurface
from .earth.surface import Plane as Plane
from .estimate.accuracy import Accuracy as Accuracy
from .estimate.accuracy import accuracy as accuracy
from .estimate.accuracy import error_radius as error_radius
from .estimate.block.adjust import adjust as adjust
from .estimate.block.adjustment import Adjustment as Adjustment
from .estimate.block.block import Block as Block
from .estimate.block.direct import direct_positioning as direct_positioning
from .estimate.block.two_step import TwoStep as TwoStep
from .estimate.block.two_step import two_step as two_step
from .estimate.blunders import Blunders as Blunders
from .estimate.calibrate import calibrate as calibrate
from .estimate.calibration import Calibration as Calibration
from .estimate.consistency import nees as nees
from .estimate.consistency import nees_band as nees_band
from .estimate.errors import FrameErrors as FrameErrors
from .estimate.errors import draw_errors as draw_errors
from .estimate.estimate import Estimate as Estimate
from .estimate.intersection import intersect as intersect
from .estimate.losses import AbstractLoss as AbstractLoss
from .estimate.losses import Cauchy as Cauchy
from .estimate.losses import Huber as Huber
from .estimate.many import Batch as Batch
from .estimate.many import calibrate_batch as calibrate_batch
from .estimate.many import calibrate_redrawn as calibrate_redrawn
from .estimate.many import images_of as images_of
from .estimate.motions import motion_unknowns as motion_unknowns
from .estimate.observations import Observations as Observations
from .estimate.reason import Reason as Reason
from .estimate.selection import Comparison as Comparison
from .estimate.selection import compare as compare
from .estimate.unknown import Unknown as Unknown
from .estimate.unknown import assign as assign
from .estimate.variance_components import Reweigh as Reweigh
from .files.read import read_flight as read_flight
from .files.write import write_flight as write_flight
from .flights.flight import Flight as Flight
from .locate.guess import Guess as Guess
from .locate.guess import first_guess as first_guess
from .locate.locate import locate as locate
from .locate.location import Location as Location
from .locate.looks import Looks as Looks
from .locate.motion import ConstantVelocity as ConstantVelocity
from .rules import RESULTS as RESULTS
from .rules import FlightError as FlightError
from .rules import SensorError as SensorError
from .rules import WhiskjaxError as WhiskjaxError
from .rules import first_failure as first_failure
from .rules.progress import telling as telling
from .rules.results import failure_if as failure_if
from .rules.version import installed_version as _installed_version

__version__ = _installed_version("whiskjax")

# In the order of the rooms.
__all__ = [
    "__version__",
    "FlightError",
    "RESULTS",
    "SensorError",
    "WhiskjaxError",
    "first_failure",
    "telling",
    "failure_if",
    "ecef_to_geodetic",
    "geodetic_to_ecef",
    "enu_rotation",
    "ned_rotation",
    "Refraction",
    "AbstractSurface",
    "HeightSurface",
    "Plane",
    "bake",
    "By",
    "AbstractCamera",
    "FrameCamera",
    "AbstractBasis",
    "Bias",
    "Correction",
    "Drift",
    "OrientationImages",
    "Spline",
    "image_to_ground",
    "project",
    "ray",
    "LineCamera",
    "LookTable",
    "LineTimes",
    "AbstractLink",
    "Axes",
    "Mount",
    "Motion",
    "Pose",
    "Process",
    "Records",
    "ground_to_image",
    "Sensor",
    "Shot",
    "AbstractStations",
    "joint_derivatives",
    "PosePerImage",
    "Trajectory",
    "Encoder",
    "Readings",
    "Turn",
    "Accuracy",
    "accuracy",
    "error_radius",
    "Batch",
    "calibrate_batch",
    "calibrate_redrawn",
    "images_of",
    "adjust",
    "Adjustment",
    "Block",
    "direct_positioning",
    "TwoStep",
    "two_step",
    "Blunders",
    "Calibration",
    "calibrate",
    "nees",
    "nees_band",
    "intersect",
    "AbstractLoss",
    "Cauchy",
    "Huber",
    "draw_errors",
    "Estimate",
    "Reason",
    "FrameErrors",
    "motion_unknowns",
    "Observations",
    "Comparison",
    "compare",
    "Unknown",
    "assign",
    "Reweigh",
    "Guess",
    "first_guess",
    "locate",
    "Location",
    "Looks",
    "ConstantVelocity",
    "flights",
    "Flight",
    "read_flight",
    "write_flight",
    "examine",
    "Diagnosis",
    "Finding",
]
