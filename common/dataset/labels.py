"""Labels of humans as Foxglove messages, and back as arrays.

Joints and ground points are point clouds, packed as `JOINT_DTYPE` and `GROUND_DTYPE` say, with the number of the human
beside every point; boxes are one scene entity with a cube per human. Foxglove shows all three, Rerun the clouds.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration

from readygo.common.arrays import Float32Array, Float64Array, RecordArray
from readygo.common.dataset.poses import pose_of, pose_xyzyaw
from readygo.common.errors import DatasetError
from readygo.common.messages.samples import HumanLabels

JOINT_COUNT = 24
JOINT_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("human", "u1")])
"""A joint in the world [m] and whose it is, by the order of /humans."""
GROUND_DTYPE = np.dtype([("x", "<f4"), ("y", "<f4"), ("human", "u1")])
"""A point on the ground [m] and below whom it is."""
LIFETIME_NS = 100_000_000
"""Viewers drop a human whom no later sample moves: the next episode may have fewer."""
_TYPES = {"<f4": PackedElementField.FLOAT32, "|u1": PackedElementField.UINT8}


def messages(labels: Sequence[HumanLabels], stamp: Any, frame_id: str, *, floor_m: float) -> list[Any]:
    """The messages of one sample: joints, boxes, footprints.

    Args:
        labels: Labels of every human, in order.
        stamp: Time of the sample, a protobuf Timestamp.
        frame_id: Name of the world's frame.
        floor_m: Height at which viewers show the ground points.
    """
    joints = _pack_points([label.joints_m for label in labels], JOINT_DTYPE)
    ground = _pack_points([label.footprint_xy_m for label in labels], GROUND_DTYPE)
    return [
        _cloud(joints, stamp, frame_id, 0.0),
        SceneUpdate(entities=[_entity(k, label.box, stamp, frame_id) for k, label in enumerate(labels)]),
        _cloud(ground, stamp, frame_id, floor_m),
    ]


def joints_of(message: Any) -> Float32Array:
    """Joints [m] in a message on /humans/joints, shape (H, 24, 3).

    Raises:
        DatasetError: If it is packed in another way, or a human does not have 24 joints.
    """
    points = _unpack_points(message, JOINT_DTYPE)
    count = len(points) // JOINT_COUNT
    if not np.array_equal(points["human"], np.repeat(np.arange(count), JOINT_COUNT)):
        raise DatasetError("a message on /humans/joints has not 24 joints for everybody")
    return np.stack([points[axis] for axis in "xyz"], axis=-1).reshape(count, JOINT_COUNT, 3)


def boxes_of(message: Any) -> Float64Array:
    """Boxes in a message on /humans/boxes, as in `HumanLabels.box`, shape (H, 7).

    Raises:
        DatasetError: If an entity is no single cube, or they are out of order.
    """
    boxes = np.empty((len(message.entities), 7))
    for k, entity in enumerate(message.entities):
        if entity.id != str(k) or len(entity.cubes) != 1:
            raise DatasetError("a message on /humans/boxes has not one cube for everybody")
        cube = entity.cubes[0]
        x_m, y_m, z_m, yaw_rad = pose_xyzyaw(cube.pose)
        boxes[k] = (x_m, y_m, z_m, cube.size.x, cube.size.y, cube.size.z, yaw_rad)
    return boxes


def footprints_of(message: Any) -> tuple[Float32Array, ...]:
    """Ground points [m] of every human in a message on /humans/footprints, shape (P, 2) each.

    Raises:
        DatasetError: If it is packed in another way.
    """
    points = _unpack_points(message, GROUND_DTYPE)
    count = int(points["human"].max()) + 1 if len(points) else 0
    xy_m = np.stack([points["x"], points["y"]], axis=-1)
    return tuple(xy_m[points["human"] == k] for k in range(count))


def _pack_points(points_m: Sequence[Float32Array], dtype: np.dtype[np.void]) -> RecordArray:
    packed = np.zeros(sum(map(len, points_m)), dtype=dtype)
    first = 0
    for human, points in enumerate(points_m):
        rows = packed[first : first + len(points)]
        for axis in range(points.shape[1]):
            rows["xyz"[axis]] = points[:, axis]
        rows["human"] = human
        first += len(points)
    return packed


def _cloud(points: RecordArray, stamp: Any, frame_id: str, z_m: float) -> Any:
    return PointCloud(
        timestamp=stamp,
        frame_id=frame_id,
        pose=pose_of(0.0, 0.0, z_m, 0.0),
        point_stride=points.dtype.itemsize,
        fields=layout(points.dtype),
        data=points.tobytes(),
    )


def layout(dtype: np.dtype[np.void]) -> list[Any]:
    """The fields of a packed dtype."""
    fields: Mapping[str, Any] = dtype.fields or {}
    return [
        PackedElementField(name=name, offset=offset, type=_TYPES[kind.str])
        for name, (kind, offset, *_) in fields.items()
    ]


def _unpack_points(message: Any, dtype: np.dtype[np.void]) -> RecordArray:
    same = message.point_stride == dtype.itemsize and list(message.fields) == layout(dtype)
    if not same or len(message.data) % dtype.itemsize:
        raise DatasetError(f"a point cloud is not packed as {dtype}")
    return np.frombuffer(message.data, dtype=dtype)


def _entity(number: int, box: Float64Array, stamp: Any, frame_id: str) -> Any:
    x_m, y_m, z_m, length_m, width_m, height_m, yaw_rad = box.tolist()
    cube = CubePrimitive(
        pose=pose_of(x_m, y_m, z_m, yaw_rad),
        size=Vector3(x=length_m, y=width_m, z=height_m),
        color=Color(r=1.0, g=0.5, b=0.0, a=0.25),
    )
    lifetime = Duration(nanos=LIFETIME_NS)
    return SceneEntity(timestamp=stamp, frame_id=frame_id, id=str(number), lifetime=lifetime, cubes=[cube])
