import math

import numpy as np
import pytest

from readygo.apps.capture.ground import Ground, walking_ground
from readygo.apps.capture.walk import HEIGHTS_M, SPEED_MAX_MPS, camera_pose, plan_walk
from readygo.apps.run.scene_argument import open_scene


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


@pytest.fixture(scope="module")
def ground() -> Ground:
    return walking_ground(open_scene("embedded"), radius_m=2.5)


def test_camera_that_looks_along_x_has_its_right_along_minus_y() -> None:
    T = camera_pose(np.array([1.0, 2.0, 3.0]), 0.0, 0.0, 0.0)
    np.testing.assert_allclose(T[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    up = camera_pose(np.zeros(3), 0.3, 0.5, 0.1)
    assert up[2, 2] == pytest.approx(math.sin(0.5))
    assert np.linalg.det(up[:3, :3]) == pytest.approx(1.0)


def test_walk_is_smooth_at_a_hands_height_and_ends_where_it_began(ground: Ground) -> None:
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


def test_walk_begins_with_a_look_at_the_marker(ground: Ground) -> None:
    scene = open_scene("embedded")
    walk = plan_walk(scene, ground, 30.0, rng())
    marker = np.array([*walk.marker_xy_m, scene.maps.floor.at(*walk.marker_xy_m)])
    for time_s in (0.0, 1.0, 2.0):
        T = walk.pose_at(time_s)
        x, y, z = (marker - T[:3, 3]) @ T[:3, :3]
        assert math.hypot(x, y) < 0.4 * z


def test_seed_alone_decides(ground: Ground) -> None:
    scene = open_scene("embedded")
    one, same, other = (plan_walk(scene, ground, 10.0, rng(seed)).knots for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.01
