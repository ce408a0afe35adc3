"""Foxglove poses of what stands upright."""

import math
from typing import Any

from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3


def pose_of(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Any:
    """A foxglove.Pose that turns about z only."""
    orientation = Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * yaw_rad), w=math.cos(0.5 * yaw_rad))
    return Pose(position=Vector3(x=x_m, y=y_m, z=z_m), orientation=orientation)


def pose_xyzyaw(pose: Any) -> tuple[float, float, float, float]:
    """x, y, z [m] and yaw [rad] in [-pi, pi] of a foxglove.Pose that turns about z only."""
    position, q = pose.position, pose.orientation
    return position.x, position.y, position.z, _yaw_rad(q.z, q.w)


def stored_yaw_rad(yaw_rad: float) -> float:
    """The yaw [rad] in [-pi, pi] that comes back from the quaternion of one."""
    return _yaw_rad(math.sin(0.5 * yaw_rad), math.cos(0.5 * yaw_rad))


def _yaw_rad(z: float, w: float) -> float:
    return math.remainder(2.0 * math.atan2(z, w), math.tau)
