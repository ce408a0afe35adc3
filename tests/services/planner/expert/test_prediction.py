import math

import numpy as np
import pytest

from readygo.common.episode import GridSearch
from readygo.common.episode.grid_search import FREE
from readygo.common.maps import clearance_m
from readygo.services.planner.expert.prediction import follow_route, predict_walk
from tests.services.planner.worlds import FRAME, rooms

CLEARANCE = clearance_m(rooms()).astype(np.float64)


def _views(heading_rad, turn_rad, count=9, start=(-1.5, 5.2)):
    points = [start]
    for _ in range(count - 1):
        x, y = points[-1]
        points.append((x + 0.05 * math.cos(heading_rad), y + 0.05 * math.sin(heading_rad)))
        heading_rad += turn_rad
    return np.array(points)


def test_straight_walk_goes_on():
    ahead = predict_walk(_views(0.0, 0.0), CLEARANCE, FRAME, 20)
    assert np.allclose(ahead, [(-1.1 + 0.05 * k, 5.2) for k in range(1, 21)])


def test_turn_goes_on_and_fades():
    ahead = predict_walk(_views(0.0, 0.03), CLEARANCE, FRAME, 30)
    headings = np.unwrap(np.arctan2(*np.diff(ahead, axis=0).T[::-1]))
    assert np.diff(headings)[0] == pytest.approx(0.03, rel=0.15)
    assert 0 < np.diff(headings)[-1] < 0.01


def test_walls_deflect_and_are_not_walked_through():
    ahead = predict_walk(_views(math.radians(75), 0.0, start=(1.6, 5.0)), CLEARANCE, FRAME, 60)
    cells = np.floor((ahead - (FRAME.origin_x_m, FRAME.origin_y_m)) / FRAME.resolution_m).astype(int)
    assert (CLEARANCE[cells[:, 1], cells[:, 0]] > 0.1).all()
    assert np.hypot(*(ahead[-1] - ahead[0])) > 1.0


def test_somebody_seen_once_stands():
    assert np.ptp(predict_walk(np.array([[0.0, 5.0]]), CLEARANCE, FRAME, 10), axis=0).tolist() == [0.0, 0.0]


def test_route_leads_through_the_door_to_its_place():
    factor = np.where(CLEARANCE > 0.3, FREE, 0).astype(np.uint8)
    to_place = GridSearch(factor.shape).distances(factor, FRAME.cell(0.0, 9.0))
    views = _views(math.radians(60), 0.0, start=(-1.2, 4.6))
    route, explained = follow_route(views, to_place, FRAME, 80)
    assert explained > 0.9
    assert np.hypot(*(route[-1] - (0.0, 9.0))) < 0.8
    _, away = follow_route(views[::-1].copy(), to_place, FRAME, 80)
    assert away < -0.9


def test_standing_explains_no_route():
    to_place = np.zeros(CLEARANCE.shape, np.int32)
    route, explained = follow_route(np.tile([[0.0, 5.0]], (9, 1)), to_place, FRAME, 5)
    assert explained == 0.0
    assert (route == (0.0, 5.0)).all()
