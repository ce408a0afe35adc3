"""What viewers show of an episode besides its samples: frames, markers and clouds.

Foxglove shows all of it. Rerun shows frames and point clouds, no scenes and no grids.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration

from readygo.common.arrays import BoolArray, Float64Array, RecordArray
from readygo.common.camera.config import CameraConfig
from readygo.common.dataset import labels, schemas
from readygo.common.dataset.columns import Part, constant, doubles, field, field_head, join_columns, nothing
from readygo.common.dataset.packed import Messages, Timed
from readygo.common.dataset.poses import pose_of
from readygo.common.frames import quat_from_matrix
from readygo.common.robot.config import RobotConfig

Rgb = tuple[int, int, int]
START_RGB: Rgb = (0, 158, 115)
GOAL_RGB: Rgb = (213, 94, 0)
PATH_RGB: Rgb = (0, 114, 178)
ROBOT_RGB: Rgb = (86, 180, 233)
BODY_RGB: Rgb = (230, 159, 0)
"""The colours of Okabe and Ito, which all eyes tell apart."""
POINT_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
"""A coloured point [m]."""
BODY_RADIUS_M, BODY_HEIGHT_M = 0.25, 1.7
"""People without labels are drawn as cylinders of this size."""
POST_HEIGHT_M = 1.0
"""Start and goal are posts of this height in point clouds."""
POINT_SPACING_M = 0.05
DISC_HEIGHT_M = 0.02


def camera_frames(robot: RobotConfig) -> tuple[bytes, ...]:
    """The frames of a robot's cameras, see `camera_frame`."""
    return (camera_frame(robot.camera), *(camera_frame(camera, name) for name, camera in robot.cameras.items()))


def camera_frame(camera: CameraConfig, name: str = "") -> bytes:
    """The frame of a camera on the robot, OpenCV axes: a FrameTransform without its time.

    Args:
        camera: Where it is.
        name: Its name; the first one is called "".
    """
    T_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    w, x, y, z = quat_from_matrix(T_robot_camera[:3, :3]).tolist()
    x_m, y_m, z_m = T_robot_camera[:3, 3].tolist()
    return schemas.serialize(
        FrameTransform(
            parent_frame_id=schemas.ROBOT_FRAME,
            child_frame_id=schemas.camera_frame(name),
            translation=Vector3(x=x_m, y=y_m, z=z_m),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )
    )


def frames(position: Part, orientation: Part, cameras: Sequence[bytes]) -> Messages:
    """The messages on /tf: the robot's frame in the world, and its cameras'.

    Args:
        position: Position of the robot on the floor, foxglove.Vector3s.
        orientation: Orientation of the robot, foxglove.Quaternions.
        cameras: Encoded frames of the cameras, from `camera_frames`.
    """
    count = len(position.rows)
    turned = (position, field_head(5, orientation), orientation)
    robot: list[Part] = [constant(_ROBOT_IN_WORLD, count), field_head(4, position), *turned]
    carried: list[list[Part]] = [[constant(camera, count)] for camera in cameras]
    return Messages(channel=schemas.TRANSFORMS, timed=Timed.IN_TRANSFORMS, groups=[robot, *carried])


def markers(poses_xyzyaw: Float64Array, goal_xy_m: Sequence[float], robot: RobotConfig | None, stamp: Any) -> Any:
    """The message on /episode/markers: start, goal, the robot's way, and the robot, which moves with its frame.

    Args:
        poses_xyzyaw: The robot at every sample: x, y, z [m], yaw [rad], shape (S, 4).
        goal_xy_m: The goal [m].
        robot: Its size; None leaves it out.
        stamp: Time of the episode's beginning, a protobuf Timestamp.
    """
    radius_m = 0.25 if robot is None else robot.radius_m
    start, end = poses_xyzyaw[0].tolist(), poses_xyzyaw[-1].tolist()
    points = [Point3(x=x, y=y, z=z + DISC_HEIGHT_M) for x, y, z, _ in poses_xyzyaw.tolist()]
    way = LinePrimitive(type=LinePrimitive.LINE_STRIP, pose=_NO_POSE, thickness=0.05, points=points)
    way.color.CopyFrom(_color(PATH_RGB))
    entities = [
        _entity("start", stamp, cylinders=[_cylinder(start[:3], radius_m, DISC_HEIGHT_M, _color(START_RGB))]),
        _entity("goal", stamp, cylinders=[_cylinder((*goal_xy_m, end[2]), radius_m, DISC_HEIGHT_M, _color(GOAL_RGB))]),
        _entity("path", stamp, lines=[way]),
    ]
    if robot is not None:
        body = _cylinder((0.0, 0.0, 0.0), robot.radius_m, robot.height_m, _color(ROBOT_RGB, 0.6))
        entities.append(_entity("robot", stamp, frame_id=schemas.ROBOT_FRAME, frame_locked=True, cylinders=[body]))
    return SceneUpdate(entities=entities)


def bodies(xyzyaw: Float64Array, there: BoolArray) -> Messages:
    """The messages on /humans/bodies: everybody as a cylinder; viewers drop it when no later sample moves it.

    Args:
        xyzyaw: Where everybody stands: x, y, z [m], yaw [rad], shape (N, H, 4).
        there: Who is there, shape (N, H).
    """
    count = len(xyzyaw)
    groups = []
    for number in range(there.shape[1]):
        x_m, y_m, z_m, _ = xyzyaw[:, number].T
        position = field(1, doubles(1, x_m, y_m, z_m + 0.5 * BODY_HEIGHT_M))
        cylinder = join_columns(field(1, join_columns(position, constant(_UPRIGHT, count))), constant(_BODY, count))
        entity = join_columns(constant(_body_entity(number), count), field(10, cylinder))
        groups.append([entity.where(there[:, number])])
    return Messages(channel=schemas.BODIES, timed=Timed.IN_ENTITIES, groups=groups or [[nothing(count)]])


def path_cloud(poses_xyzyaw: Float64Array, goal_xy_m: Sequence[float], stamp: Any) -> Any:
    """The message on /episode/path: the way of `markers` as points, start and goal as posts."""
    end_m = np.array([*goal_xy_m, poses_xyzyaw[-1, 2]])
    parts = [
        coloured_points(poses_xyzyaw[:, :3], PATH_RGB),
        coloured_points(_post(poses_xyzyaw[0, :3]), START_RGB),
        coloured_points(_post(end_m), GOAL_RGB),
    ]
    return cloud(np.concatenate(parts), stamp)


def robot_outline(robot: RobotConfig, stamp: Any) -> Any:
    """The message on /robot/outline: rings around the robot's body at the floor and on top, in its own frame."""
    count = max(8, round(math.tau * robot.radius_m / POINT_SPACING_M))
    angles = np.arange(count) * (math.tau / count)
    ring = np.stack([robot.radius_m * np.cos(angles), robot.radius_m * np.sin(angles), np.zeros(count)], axis=1)
    points = np.concatenate([ring, ring + np.array([0.0, 0.0, robot.height_m])])
    return cloud(coloured_points(points, ROBOT_RGB), stamp, frame_id=schemas.ROBOT_FRAME)


def coloured_points(points_m: npt.ArrayLike, rgb: Rgb) -> RecordArray:
    """Points [m], shape (N, 3), of one colour, rows of `POINT_DTYPE`."""
    points_m = np.asarray(points_m)
    rows = np.zeros(len(points_m), dtype=POINT_DTYPE)
    for axis, name in enumerate("xyz"):
        rows[name] = points_m[:, axis]
    rows["red"], rows["green"], rows["blue"] = rgb
    return rows


def cloud(points: RecordArray, stamp: Any, frame_id: str = schemas.WORLD_FRAME) -> Any:
    """A point cloud of rows of `POINT_DTYPE`."""
    return PointCloud(
        timestamp=stamp,
        frame_id=frame_id,
        pose=_NO_POSE,
        point_stride=points.dtype.itemsize,
        fields=labels.layout(points.dtype),
        data=points.tobytes(),
    )


def _post(foot_m: Float64Array) -> Float64Array:
    heights_m = np.arange(0.0, POST_HEIGHT_M, POINT_SPACING_M)
    points_m: Float64Array = foot_m + heights_m[:, None] * np.array([0.0, 0.0, 1.0])
    return points_m


def _entity(name: str, stamp: Any, *, frame_id: str = schemas.WORLD_FRAME, **parts: Any) -> Any:
    return SceneEntity(timestamp=stamp, frame_id=frame_id, id=name, **parts)


def _cylinder(foot_m: Sequence[float], radius_m: float, height_m: float, color: Any) -> Any:
    x_m, y_m, z_m = foot_m
    pose = Pose(position=Vector3(x=x_m, y=y_m, z=z_m + 0.5 * height_m), orientation=_NO_POSE.orientation)
    size = Vector3(x=2.0 * radius_m, y=2.0 * radius_m, z=height_m)
    return CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=color)


def _color(rgb: Rgb, alpha: float = 1.0) -> Any:
    red, green, blue = (value / 255 for value in rgb)
    return Color(r=red, g=green, b=blue, a=alpha)


@functools.lru_cache(maxsize=256)
def _body_entity(number: int) -> bytes:
    return schemas.serialize(_entity(str(number), None, lifetime=Duration(nanos=labels.LIFETIME_NS)))


_NO_POSE = pose_of(0.0, 0.0, 0.0, 0.0)
_ROBOT_IN_WORLD = schemas.serialize(
    FrameTransform(parent_frame_id=schemas.WORLD_FRAME, child_frame_id=schemas.ROBOT_FRAME)
)
_UPRIGHT = schemas.serialize(Pose(orientation=_NO_POSE.orientation))
_BODY = schemas.serialize(
    CylinderPrimitive(
        size=Vector3(x=2.0 * BODY_RADIUS_M, y=2.0 * BODY_RADIUS_M, z=BODY_HEIGHT_M),
        bottom_scale=1.0,
        top_scale=1.0,
        color=_color(BODY_RGB, 0.6),
    )
)
"""A human's cylinder without its pose."""
