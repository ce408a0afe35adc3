import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from readygo.common.maps import FloorMap, GridFrame
from readygo.common.messages import HumanMotion, Motion
from readygo.common.robot import CameraConfig, step_unicycle
from readygo.services.renderer.sensor.motion import Timeline, arc, posed


@given(st.floats(-3, 3), st.floats(-0.99, 0.99), st.floats(-1.5, 1.5), st.floats(0, 1), st.floats(-3.0, 3.0))
def test_robot_drives_the_unicycles_arc_between_rows(x: float, v: float, w: float, share: float, yaw: float) -> None:
    first = np.array([x, 0.4, yaw])
    last = np.array(step_unicycle(*first, v, w, 0.05))
    expected = step_unicycle(*first, v, w, 0.05 * share)
    # The ends of arcs of many kilometres cancel.
    assert arc(first, last, share) == pytest.approx(expected, abs=1e-9 if abs(w) > 1e-6 else 1e-6)


def human(count: int = 3) -> HumanMotion:
    rng = np.random.default_rng(0)
    rotations = Rotation.random(24 * count, rng).as_rotvec().reshape(count, 24, 3).astype(np.float32)
    root = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    return HumanMotion(avatar="a", motion=Motion(root_m=root, pose_axis_angle=rotations))


def test_joints_turn_about_one_axis_and_the_root_moves_straight() -> None:
    moving = human()
    for share in (0.1, 0.5, 0.93):
        (between,) = posed([moving], 1 + share)
        assert between.root_m == pytest.approx((1 - share) * moving.motion.root_m[1] + share * moving.motion.root_m[2])
        for joint in range(24):
            ends = Rotation.from_rotvec(moving.motion.pose_axis_angle[1:, joint])
            expected = Slerp([0, 1], ends)(share)
            assert (expected.inv() * Rotation.from_rotvec(between.pose_axis_angle[joint])).magnitude() < 1e-5
        assert np.linalg.norm(between.pose_axis_angle, axis=1).max() <= np.pi + 1e-6


def test_pose_of_a_row_is_that_row_and_the_ends_are_held() -> None:
    moving = human()
    for step, row in ((-3, 0), (-0.5, 0), (0, 0), (1, 1), (2, 2), (2.7, 2), (9, 2)):
        (one,) = posed([moving], step)
        assert np.array_equal(one.pose_axis_angle, moving.motion.pose_axis_angle[row])
        assert np.array_equal(one.root_m, moving.motion.root_m[row])


def test_small_and_resting_rotations_stay_exact() -> None:
    pose = np.zeros((2, 24, 3), dtype=np.float32)
    pose[1, 3] = (1e-8, 0, 0)
    pose[:, 4] = (0.2, -0.1, 3.0)
    still = HumanMotion(avatar="a", motion=Motion(root_m=np.zeros((2, 3), np.float32), pose_axis_angle=pose))
    (one,) = posed([still], 0.5)
    assert np.abs(one.pose_axis_angle[[0, 3]]).max() < 1e-7
    assert one.pose_axis_angle[4] == pytest.approx(pose[0, 4], abs=1e-6)


def test_camera_follows_the_floor() -> None:
    heights = np.array([[0.0, 1.0], [0.0, 1.0]], dtype=np.float32)
    floor = FloorMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=1.0), height_m=heights)
    rows = np.array([[0.5, 0.5, 0.0], [1.5, 0.5, 0.0]])
    timeline = Timeline(xyyaw=rows, humans=(), floor=floor, camera=CameraConfig())
    assert timeline.at(0.25).T_world_camera[:3, 3] == pytest.approx((0.75, 0.5, 0.75))
    assert timeline.at(-1.0).equals(timeline.at(0.0))
    assert timeline.at(7.0).equals(timeline.at(1.0))
    assert not timeline.at(0.5).equals(timeline.at(1.0))


def test_timeline_that_begins_later_is_the_same_from_there_on() -> None:
    floor = FloorMap(
        frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=1.0), height_m=np.zeros((1, 1), np.float32)
    )
    rows = np.random.default_rng(0).uniform(0, 1, (9, 3))
    whole = Timeline(xyyaw=rows, humans=(human(9),), floor=floor, camera=CameraConfig())
    part = Timeline(xyyaw=rows[5:8], humans=(human(9),), floor=floor, camera=CameraConfig(), first_step=5)
    for step in (5.0, 5.3, 6.99, 7.0):
        assert part.at(step).equals(whole.at(step))
    assert np.array_equal(part.at(4.7).T_world_camera, whole.at(5.0).T_world_camera)
    assert part.at(7.5).step == 7.5
