"""Which chunks a camera sees."""

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.cpu.tiles import unpack_box
from readygo.common.rasterizer.cpu.view import VisibleChunks, cull_human, cull_scene, make_view
from readygo.common.rasterizer.packed.scene import pack_cloud
from tests.common.rasterizer.drawing import human, numbered, rgb_of


def test_humans_outside_of_the_view_change_nothing(make_cloud, camera, avatar: Avatar) -> None:
    T, K = camera(0.0, 0.0, 0.0, 96, 64)
    rasterizer = CpuRasterizer(pack_cloud(make_cloud(900)), numbered([avatar]), K, 64, 96)
    alone = rgb_of(rasterizer, T)
    assert np.array_equal(alone, rgb_of(rasterizer, T, [human(-3.0, 0.0), human(1.0, 9.0)]))


K_PX = np.array([[50.0, 0.0, 48.0], [0.0, 50.0, 32.0], [0.0, 0.0, 1.0]])
VIEW = make_view(np.eye(4), K_PX, 64, 96)
"""Looks along z."""
NO_LEAD = np.zeros(5, dtype=np.float32)


def room_for(count: int) -> VisibleChunks:
    return VisibleChunks(np.empty(count, np.int64), np.empty(count), np.empty(count, np.int64), np.empty((2, 3)))


def test_camera_pose_is_turned_round_for_the_kernels(camera) -> None:
    T, K = camera(1.0, 2.0, 0.3, 96, 64)
    view = make_view(T, K, 64, 96)
    point = np.array([0.3, -0.2, 1.5])
    assert view.R_CW @ (point - view.p_WC) == pytest.approx(np.linalg.inv(T)[:3] @ [*point, 1.0])
    assert (view.fx, view.fy, view.cx, view.cy) == (K[0, 0], K[1, 1], K[0, 2], K[1, 2])


def test_chunks_in_view_are_listed_with_their_nearest_depth_and_the_blocks_that_they_cover() -> None:
    centre_m = np.array([[0, 0, -3], [0, 0, 4], [9, 0, 4], [0, 9, 4], [-9, 0, 4], [0, -9, 4], [1, 0, 4]], np.float64)
    half_m, reach_m = np.full((7, 3), 0.25, np.float32), np.full(7, 0.1, np.float32)
    out = room_for(7)
    count = cull_scene(VIEW, centre_m, half_m, reach_m, out)
    assert out.number[:count].tolist() == [1, 6]
    assert out.depth_m[:count] == pytest.approx([3.75, 3.75], abs=1e-4)
    # 0.25 m and the reach of 0.1 m at 3.75 m are 4.7 px, the dilation reaches 2 px further.
    boxes = [unpack_box(box) for box in out.box[:count].tolist()]
    assert boxes[0] == ((48 - 7) // 4, (48 + 7) // 4, (32 - 7) // 4, (32 + 7) // 4)
    assert boxes[1][0] > boxes[0][0]
    assert boxes[1][2:] == boxes[0][2:]


def test_chunk_beside_the_image_is_seen_if_its_gaussians_reach_in() -> None:
    centre_m, half_m = np.array([[5.0, 0.0, 4.0]]), np.zeros((1, 3), np.float32)
    counts = [cull_scene(VIEW, centre_m, half_m, np.float32([reach_m]), room_for(1)) for reach_m in (0.1, 2.0)]
    assert counts == [0, 1]


def test_joints_carry_the_boxes_of_a_human() -> None:
    A_CS = np.tile(np.eye(3, 4, dtype=np.float32), (24, 1, 1))
    A_CS[3, :, 3] = (0.0, 0.0, 5.0)
    A_CS[4, :, 3] = (20.0, 0.0, 3.0)
    joints, reach_m = np.array([4, 3, 4]), np.full(2, 0.1, np.float32)
    centre_m, half_m = np.zeros((3, 3), np.float32), np.full((3, 3), 0.2, np.float32)
    out = room_for(2)
    count = cull_human(VIEW, NO_LEAD, A_CS, np.array([0, 2, 3]), joints, centre_m, half_m, reach_m, out)
    # A mean of the first chunk may be anywhere between its two joints, one of the second at the second joint only.
    assert out.number[:count].tolist() == [0]
    assert out.depth_m[0] == pytest.approx(2.8, abs=1e-4)
    assert unpack_box(out.box[0])[1] == 95 // 4


def test_chunks_near_the_ground_are_listed_as_nearer_by_the_largest_lead_within_their_box() -> None:
    A_CS = np.tile(np.eye(3, 4, dtype=np.float32), (24, 1, 1))
    A_CS[:, 2, 3] = 5.0
    centre_m = np.array([[0, -1, 0], [0, 0.6, 0], [0, 1.2, 0]], np.float32)
    boxes = np.arange(4), np.full(3, 7), centre_m, np.full((3, 3), 0.1, np.float32), np.full(3, 0.1, np.float32)
    # 0.4 m at y = 1, nothing above y = 0.6.
    lead, out = np.array([0.0, 1.0, 0.0, -0.6, 0.4], dtype=np.float32), room_for(3)
    assert cull_human(VIEW, lead, A_CS, *boxes, out) == 3
    assert out.depth_m == pytest.approx([4.9, 4.8, 4.5], abs=1e-4)
