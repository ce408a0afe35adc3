import math

import numpy as np
import pytest

from readygo.apps.capture.ground import (
    BODY_RADIUS_M,
    WalkableGround,
    _room,
    closed_way,
    marker_place,
    walking_ground,
)
from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame, clearance_m
from readygo.runs.scene_argument import open_scene

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.05)
WAY = [526.0, 100.0, 1.225, -0.125, -0.059, -1.109, 3.282, -0.9066, 3.159, 0.809]
NARROW_WAY = [176.0, -0.1472, -1.3207, 1.0084, -1.3737]


def rectangle(width_m: float, height_m: float) -> WalkableGround:
    cells = np.zeros((120, 140), np.bool_)
    cells[10 : 10 + round(height_m / 0.05), 10 : 10 + round(width_m / 0.05)] = True
    return WalkableGround(cells=cells, frame=FRAME)


def test_ground_of_a_scene_is_clear_of_everything_and_connected() -> None:
    scene = open_scene("embedded")
    ground = walking_ground(scene, radius_m=2.5)
    assert (clearance_m(scene.maps.human)[ground.cells] > BODY_RADIUS_M).all()
    middle = ground.centres_m.mean(axis=0)
    assert np.hypot(*(ground.centres_m - middle).T).max() < 5.0


def test_rectangle_is_kept() -> None:
    x0, y0, x1, y1 = (1.0, 1.0, 4.0, 4.0)
    ground = walking_ground(open_scene("embedded"), crop=(x0, y0, x1, y1))
    low, high = ground.centres_m.min(axis=0), ground.centres_m.max(axis=0)
    assert (low >= (x0, y0)).all()
    assert (high <= (x1, y1)).all()


@pytest.mark.parametrize("place", [{"crop": (90.0, 90.0, 91.0, 91.0)}, {"start": (90.0, 90.0)}, {"radius_m": 0.3}])
def test_too_little_ground_is_refused_with_advice(place: dict[str, object]) -> None:
    with pytest.raises(SceneError, match=r"m2 of connected ground .* 2 m2 are needed; .*--start X Y"):
        walking_ground(open_scene("embedded"), **place)


def test_way_goes_around_counterclockwise_on_the_ground() -> None:
    ground = rectangle(4.0, 3.0)
    way = closed_way(ground)
    assert ground.holds(way).all()
    steps_m = np.hypot(*(np.roll(way, -1, axis=0) - way).T)
    assert steps_m.max() < 0.03
    assert 9.0 < steps_m.sum() < 12.0
    x, y = way.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0


def test_ground_without_a_way_around_is_refused() -> None:
    with pytest.raises(SceneError, match="too narrow to walk around"):
        closed_way(rectangle(0.5, 0.5))


def test_marker_lies_on_the_ground_where_one_can_film_it() -> None:
    ground = rectangle(4.0, 3.0)
    way = closed_way(ground)
    begin, place = marker_place(ground, way)
    assert ground.holds(np.array([place])).all()
    assert 0.8 < math.dist(way[begin], place) < 1.6


def test_points_lie_on_the_cells_that_hold_them() -> None:
    cells = np.zeros((3, 5), np.bool_)
    cells[1, 3] = cells[2, 0] = True
    ground = WalkableGround(cells=cells, frame=GridFrame(origin_x_m=-1.0, origin_y_m=4.0, resolution_m=0.5))
    np.testing.assert_allclose(ground.centres_m, [(0.75, 4.75), (-0.75, 5.25)])
    assert ground.area_m2 == pytest.approx(2 * 0.25)
    points = [(0.51, 4.51), (0.99, 4.99), (0.49, 4.75), (1.01, 4.75), (-0.99, 5.49), (-1.01, 5.25), (-0.75, 5.51)]
    assert ground.holds(np.array(points)).tolist() == [True, True, False, False, True, False, False]
    full = WalkableGround(cells=np.ones_like(cells), frame=ground.frame)
    edges = [(-1.0, 4.0), (1.49, 5.49), (1.5, 4.2), (1.0, 5.5), (-1.01, 4.2), (0.0, 3.99)]
    assert full.holds(np.array(edges)).tolist() == [True, True, False, False, False, False]


def test_way_and_marker_are_what_they_were() -> None:
    ground = rectangle(4.1, 2.7)
    way = closed_way(ground)
    begin, place = marker_place(ground, way)
    found = [len(way), begin, *place, *way[[0, len(way) // 3, len(way) // 2]].ravel()]
    np.testing.assert_allclose(found, WAY, atol=2e-4)
    narrow = closed_way(rectangle(2.4, 0.4))
    np.testing.assert_allclose([len(narrow), *narrow[[0, len(narrow) // 3]].ravel()], NARROW_WAY, atol=2e-4)


def test_doors_are_passed_only_where_there_is_too_little_room_without() -> None:
    cells = np.ones((60, 100), np.bool_)
    cells[:, 50] = False
    cells[20:32, 50] = True
    squared = (np.arange(100)[None, :] * 0.05 - 1.0) ** 2 + (np.arange(60)[:, None] * 0.05 - 1.5) ** 2
    wide = cells.copy()
    wide[20:32, 47:54] = False
    assert _room(cells, wide, squared, 0.05)[:, 62:].sum() == 0
    assert _room(cells, wide, squared, 0.05)[:, :45].all()
    small = wide.copy()
    small[:, 15:47] = False
    assert _room(cells & ~(np.arange(100) > 70), small & (np.arange(100) < 4), squared, 0.05)[:, 55:70].any()
