"""Frames, markers and clouds that viewers show."""

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

from readygo.common.camera import CameraConfig
from readygo.common.dataset import columns, markers, schemas
from readygo.common.frames import matrix_from_quat
from readygo.common.robot import RobotConfig

STAMP = schemas.timestamp(1_500_000_000)
POSES = np.array([[0.0, 0.0, 0.1, 0.0], [1.0, 0.0, 0.2, 0.0], [2.0, 0.5, 0.3, 0.4]])


def points_of(cloud) -> np.ndarray:
    assert cloud.point_stride == markers.POINT_DTYPE.itemsize
    return np.frombuffer(cloud.data, dtype=markers.POINT_DTYPE)


@pytest.mark.parametrize("pitch_deg", [0.0, 20.0])
def test_camera_frame_is_where_the_robot_carries_it(pitch_deg) -> None:
    camera = CameraConfig(mount_x_m=0.1, mount_y_m=-0.05, mount_height_m=0.8, mount_pitch_deg=pitch_deg)
    frame = FrameTransform.FromString(markers.camera_frame(camera))
    q, p = frame.rotation, frame.translation
    T_robot_camera = camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(matrix_from_quat([q.w, q.x, q.y, q.z]), T_robot_camera[:3, :3], atol=1e-12)
    assert (p.x, p.y, p.z) == pytest.approx((0.1, -0.05, 0.8))


def test_way_goes_from_start_to_end_and_posts_stand_on_the_floor() -> None:
    points = points_of(markers.path_cloud(POSES, (2.1, 0.6), STAMP))
    rgb = np.stack([points[name] for name in ("red", "green", "blue")], axis=-1)
    start, goal = (points[(rgb == colour).all(axis=1)] for colour in (markers.START_RGB, markers.GOAL_RGB))
    assert (start["x"][0], start["z"].min()) == (0.0, np.float32(0.1))
    assert (goal["x"][0], goal["y"][0], goal["z"].min()) == tuple(np.float32([2.1, 0.6, 0.3]))
    way = points[(rgb == markers.PATH_RGB).all(axis=1)]
    np.testing.assert_array_equal(way["y"], POSES[:, 1].astype(np.float32))


def test_outline_has_the_robots_size_in_its_own_frame() -> None:
    robot = RobotConfig(radius_m=0.3, planning_radius_m=0.4, height_m=1.2)
    cloud = markers.robot_outline(robot, STAMP)
    points = points_of(cloud)
    assert cloud.frame_id == "robot"
    np.testing.assert_allclose(np.hypot(points["x"], points["y"]), 0.3, atol=1e-6)
    assert set(points["z"].tolist()) == {0.0, np.float32(1.2)}


def test_bodies_stand_on_their_poses() -> None:
    somebody, other = (1.0, 2.0, 0.5, 0.0), (3.0, 4.0, 0.0, 0.0)
    bodies = markers.bodies(np.array([[somebody, other], [other, somebody]]), np.array([[True, True], [True, False]]))
    stamps = columns.stamps(np.array([1_500_000_000, 1_550_000_000], dtype=np.uint64))
    both, alone = (bodies.channel.message.FromString(row) for row in columns.rows_of(bodies.at(stamps)))
    assert [[entity.id for entity in update.entities] for update in (both, alone)] == [["0", "1"], ["0"]]
    assert alone.entities[0].timestamp.ToNanoseconds() == 1_550_000_000
    cylinder = both.entities[0].cylinders[0]
    assert cylinder.pose.position.z - 0.5 * cylinder.size.z == pytest.approx(0.5)


def test_way_is_a_line_on_the_floor_narrower_than_the_robot() -> None:
    robot = RobotConfig()
    update = markers.markers(POSES, (2.1, 0.6), robot, STAMP)
    ((line,),) = (entity.lines for entity in update.entities if entity.id == "path")
    assert 0.0 < line.thickness < robot.radius_m
    points = np.array([(point.x, point.y, point.z) for point in line.points])
    np.testing.assert_array_equal(points[:, :2], POSES[:, :2])
    assert ((points[:, 2] >= POSES[:, 2]) & (points[:, 2] < POSES[:, 2] + 0.1)).all()
