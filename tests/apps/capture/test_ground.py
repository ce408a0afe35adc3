import math

import numpy as np
import pytest

from readygo.apps.capture.ground import BODY_RADIUS_M, Ground, closed_way, marker_place, walking_ground
from readygo.apps.run.scene_argument import open_scene
from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame, clearance_m

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.05)


def rectangle(width_m: float, height_m: float) -> Ground:
    cells = np.zeros((120, 140), np.bool_)
    cells[10 : 10 + round(height_m / 0.05), 10 : 10 + round(width_m / 0.05)] = True
    return Ground(cells=cells, frame=FRAME)


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
