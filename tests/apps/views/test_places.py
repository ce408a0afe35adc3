import math

import numpy as np

from readygo.apps.views.places import poses_to_look_from, spread_places
from readygo.common.maps import GridFrame

FRAME = GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.1)


def test_places_are_cells_that_can_be_reached_and_far_from_each_other() -> None:
    reachable = np.zeros((40, 80), np.bool_)
    reachable[10:30, 10:70] = True
    places = spread_places(reachable, FRAME, 12)
    assert places.shape == (12, 2)
    cells = np.floor((places - (-1.0, 2.0)) / 0.1).astype(int)
    assert reachable[cells[:, 1], cells[:, 0]].all()
    distances = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + 9 * np.eye(12)
    # 2 x 6 m for twelve: a metre is the best that there is.
    assert distances.min() > 0.7


def test_places_stand_for_the_area_not_for_its_ends() -> None:
    places = spread_places(np.ones((1, 100), np.bool_), FRAME, 4)
    assert np.allclose(sorted(places[:, 0]), (0.25, 2.75, 5.25, 7.75), atol=0.6)


def test_there_are_no_more_places_than_cells_and_they_are_the_same_each_time() -> None:
    reachable = np.zeros((300, 300), np.bool_)
    reachable[5, 5:8] = True
    assert len(spread_places(reachable, FRAME, 24)) == 3
    reachable[:] = True
    assert np.array_equal(spread_places(reachable, FRAME, 24), spread_places(reachable, FRAME, 24))


def test_views_from_a_place_are_a_quarter_turn_apart() -> None:
    poses = poses_to_look_from(np.ones((20, 20), np.bool_), FRAME, 5)
    assert poses.shape == (5, 4, 3)
    assert np.allclose(poses[..., 2], np.arange(4) * math.pi / 2)
    assert (poses[:, :1, :2] == poses[..., :2]).all()
