"""`[ranges]` of `robot.toml`: what differs between the robots that one policy drives."""

from dataclasses import dataclass

from readygo.common.ranges import Range, Ranges

OF_CAMERA = ("mount_height_m", "horizontal_fov_deg", "mount_pitch_deg")
"""Ranges of the robot's camera; the others are of the robot itself."""


@dataclass(frozen=True, kw_only=True)
class RobotRanges(Ranges):
    """Ranges (lowest, highest) from which each episode draws values of the robot, uniformly.

    () keeps the robot's own value. The names are those of `RobotConfig` and `CameraConfig`.
    """

    mount_height_m: Range = ()
    """Height of the camera above the local floor [m]."""
    horizontal_fov_deg: Range = ()
    """Horizontal field of view of the camera [deg]."""
    mount_pitch_deg: Range = ()
    """Inclination of the camera [deg]: positive looks down."""
    radius_m: Range = ()
    """The planning radius stays as much larger as the robot's own is."""
    v_max_mps: Range = ()
    """The largest speed backwards stays the same share of it."""
    w_max_radps: Range = ()
    """Largest turn rate [rad/s]."""
