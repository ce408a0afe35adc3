import math

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.maps import FloorMap, GridFrame, SightMap
from readygo.common.scenes.filmed import FILMED_MIN, filmed_share

FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)
SIDE = 80
"""Cells of a hall of 8 x 8 m: walls around, and one across at x = 4 m with an opening at its upper end."""


def hall() -> np.ndarray:
    walls = np.zeros((SIDE, SIDE), np.bool_)
    walls[:2] = walls[-2:] = True
    walls[:, :2] = walls[:, -2:] = True
    walls[:60, 39:41] = True
    return walls


def filmed_from(places: list[tuple[float, float]], yaws: list[float], height_m: float = 1.5) -> CapturedViews:
    poses = []
    for x, y in places:
        for yaw in yaws:
            T = np.eye(4)
            T[:3, 0] = (math.sin(yaw), -math.cos(yaw), 0.0)
            T[:3, 1] = (0.0, 0.0, -1.0)
            T[:3, 2] = (math.cos(yaw), math.sin(yaw), 0.0)
            T[:3, 3] = (x, y, height_m)
            poses.append(T)
    count = len(poses)
    K = np.array([[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]])
    return CapturedViews(
        images=tuple(map(str, range(count))),
        sizes_px=np.tile([640, 480], (count, 1)),
        K_px=np.tile(K, (count, 1, 1)),
        T_world_camera=np.array(poses),
    )


def share(views: CapturedViews) -> np.ndarray:
    walls = hall()
    sight = SightMap(frame=FRAME, opaque=np.where(walls, np.uint32(0xFFFFFFFF), np.uint32(0)), layer_m=1.5 / 32)
    floor = FloorMap(frame=FRAME, height_m=np.zeros((SIDE, SIDE), np.float32))
    return filmed_share(views, sight, floor, ~walls)


ALL_AROUND = [k * math.tau / 8 for k in range(8)]


def test_room_that_was_filmed_is_known_and_the_one_behind_the_wall_is_not() -> None:
    found = share(filmed_from([(1.0, 1.5), (2.0, 3.0), (3.0, 1.5), (2.0, 5.0)], ALL_AROUND))
    assert found[20:40, 10:30].min() > FILMED_MIN
    assert found[5:30, 55:75].max() < FILMED_MIN
    assert (found[hall()] == 0.0).all()


def test_what_was_seen_from_one_side_only_is_not_known_from_the_other() -> None:
    one_way = share(filmed_from([(1.0, 2.0), (1.0, 4.0)], [0.0]))
    around = share(filmed_from([(1.0, 2.0), (1.0, 4.0), (3.0, 3.0)], ALL_AROUND))
    assert one_way[30, 25] < around[30, 25]
    assert one_way[30, 25] < FILMED_MIN


def test_cameras_elsewhere_tell_nothing() -> None:
    assert share(filmed_from([(50.0, 50.0)], ALL_AROUND)).max() == 0.0


def test_many_cameras_are_thinned_and_tell_the_same() -> None:
    few = filmed_from([(1.0 + 0.5 * k, 2.0) for k in range(4)], ALL_AROUND)
    many = filmed_from([(1.0 + 0.5 * k, 2.0) for k in np.linspace(0, 3, 120)], ALL_AROUND)
    assert np.mean((share(few) > FILMED_MIN) == (share(many) > FILMED_MIN)) == pytest.approx(1.0, abs=0.1)


def test_share_of_a_crooked_place_is_as_it_was(golden_figures) -> None:
    """Things of several heights on an oblong map off the origin, filmed by tilted cameras on uneven ground."""
    rng, shape = np.random.default_rng(3), (53, 71)
    frame = GridFrame(origin_x_m=-3.1, origin_y_m=2.2, resolution_m=0.13)
    heights = rng.integers(1, 2**32, shape, dtype=np.uint64).astype(np.uint32)
    opaque = np.where(rng.random(shape) < 0.05, heights, np.uint32(0))
    sight = SightMap(frame=frame, opaque=opaque, layer_m=0.047)
    floor = FloorMap(frame=frame, height_m=rng.uniform(0.0, 0.2, shape).astype(np.float32))
    views = filmed_from([(-1.2, 4.3), (1.1, 6.7), (3.2, 3.9)], [0.4, 2.5, 4.1], height_m=1.37)
    tilt = matrix_from_axis_angle([0.2, 0.1, -0.15])
    views.T_world_camera[:, :3, :3] = views.T_world_camera[:, :3, :3] @ tilt
    share = filmed_share(views, sight, floor, opaque == 0)
    assert 0.05 < (share > FILMED_MIN).mean() < 0.95
    golden_figures("scenes/filmed", share.reshape(-1), np.arange(share.size) % 67)
