import dataclasses
import math

import numpy as np
import pytest

from readygo.apps.capture.ground import WalkableGround, walking_ground
from readygo.apps.capture.walk import HEIGHTS_M, SPEED_MAX_MPS, Sway, _until, camera_pose, plan_walk
from readygo.runs.scene_argument import open_scene

WALK = [
    9.8181, 8.3181, -1.875, -0.075,
    -0.5746, -0.0804, 1.5144, 3.1416, -0.7336, 0.0185,
    -1.0783, 0.011, 1.512, 3.2466, -0.9282, 0.0086,
    -2.025, 1.0469, 1.4484, 4.3084, -0.2856, -0.0192,
    -2.7981, -0.5222, 1.5363, 6.983, -0.2421, -0.0074,
    -0.092, -0.1453, 1.5045, 9.4559, -0.3319, -0.0079,
    -1.5213, 0.8178, 1.5188, 9.084, -0.5286, 0.0047,
]  # fmt: skip
"""Way, loop and marker of a walk, and some of its knots."""


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


@pytest.fixture(scope="module")
def ground() -> WalkableGround:
    return walking_ground(open_scene("embedded"), radius_m=2.5)


def test_camera_that_looks_along_x_has_its_right_along_minus_y() -> None:
    T = camera_pose(np.array([1.0, 2.0, 3.0]), 0.0, 0.0, 0.0)
    np.testing.assert_allclose(T[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    up = camera_pose(np.zeros(3), 0.3, 0.5, 0.1)
    assert up[2, 2] == pytest.approx(math.sin(0.5))
    assert np.linalg.det(up[:3, :3]) == pytest.approx(1.0)


def test_walk_is_smooth_at_a_hands_height_and_ends_where_it_began(ground: WalkableGround) -> None:
    scene = open_scene("embedded")
    walk = plan_walk(scene, ground, 30.0, rng())
    times_s = np.arange(0.0, 30.0, 1 / 60)
    places = np.array([walk.pose_at(time_s)[:3, 3] for time_s in times_s])
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) * 60
    assert speed.max() < 1.6 * SPEED_MAX_MPS
    above = places[:, 2] - scene.maps.floor.at_many(places[:, :2])
    assert HEIGHTS_M[0] - 0.02 < above.min() < above.max() < HEIGHTS_M[1] + 0.02
    assert walk.way_m >= walk.loop_m
    assert np.hypot(*(places[-400:, :2] - places[0, :2]).T).min() < 0.2


def test_walk_begins_with_a_look_at_the_marker(ground: WalkableGround) -> None:
    scene = open_scene("embedded")
    walk = plan_walk(scene, ground, 30.0, rng())
    marker = np.array([*walk.marker_xy_m, scene.maps.floor.at(*walk.marker_xy_m)])
    for time_s in (0.0, 1.0, 2.0):
        T = walk.pose_at(time_s)
        x, y, z = (marker - T[:3, 3]) @ T[:3, :3]
        assert math.hypot(x, y) < 0.4 * z


def test_seed_alone_decides(ground: WalkableGround) -> None:
    scene = open_scene("embedded")
    one, same, other = (plan_walk(scene, ground, 10.0, rng(seed)).knots for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.01


def test_walk_is_what_it_was(ground: WalkableGround) -> None:
    walk = plan_walk(open_scene("embedded"), ground, 20.0, rng(3))
    assert len(walk.knots) == 401
    found = [walk.way_m, walk.loop_m, *walk.marker_xy_m, *walk.knots[[0, 55, 130, 211, 333, 400]].ravel()]
    np.testing.assert_allclose(found, WALK, atol=2e-4)


def test_camera_rests_before_and_after_the_walk_and_passes_every_knot(ground: WalkableGround) -> None:
    walk = plan_walk(open_scene("embedded"), ground, 4.0, rng())
    np.testing.assert_array_equal(walk.pose_at(-3.0), walk.pose_at(0.0))
    np.testing.assert_array_equal(walk.pose_at(99.0), walk.pose_at(4.0))
    for number in (0, 1, 33, 79, 80):
        place, (yaw, pitch, roll) = walk.knots[number, :3], walk.knots[number, 3:]
        np.testing.assert_allclose(walk.pose_at(number / 20), camera_pose(place, yaw, pitch, roll), atol=1e-12)
    line = dataclasses.replace(walk, knots=np.outer(np.arange(81.0), [0.1, -0.2, 0.3, 0.01, 0.0, 0.0]))
    np.testing.assert_allclose(line.pose_at(1.2345)[:3, 3], 20 * 1.2345 * np.array([0.1, -0.2, 0.3]), atol=1e-12)


def test_rolled_camera_has_its_right_below_the_horizon() -> None:
    yaw, pitch, roll = 2.5, -0.3, 0.2
    right, down, forward = camera_pose(np.zeros(3), yaw, pitch, roll)[:3, :3].T
    level_right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    np.testing.assert_allclose(
        forward, [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    assert right[2] == pytest.approx(-math.sin(roll) * math.cos(pitch))
    assert right @ level_right == pytest.approx(math.cos(roll))
    np.testing.assert_allclose(np.cross(right, down), forward, atol=1e-12)


def test_sway_stays_within_its_amplitude_and_comes_close_to_it() -> None:
    swings = Sway(rng(4)).slow(np.arange(0.0, 400.0, 0.05), 0.3, 7.0)
    assert 0.27 < np.abs(swings).max() <= 0.3
    crossings = np.count_nonzero(np.diff(np.sign(swings)) > 0)
    assert 400 / 7.0 * 0.9 < crossings < 400 / 7.0 * 2.5


def test_weight_of_the_first_look_falls_within_the_last_second() -> None:
    times_s = np.array([0.0, 2.0, 3.0, 3.5, 4.0, 9.0])
    np.testing.assert_allclose(_until(times_s, 4.0), [1, 1, 1, 0.5, 0, 0], atol=1e-12)
