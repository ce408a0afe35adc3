import math

import numpy as np
import pytest

from readygo.common.episode import GridSearch
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL
from readygo.common.maps import GridFrame, clearance_m
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


@pytest.mark.parametrize("rate_hz", [10, 20, 25, 60])
@pytest.mark.parametrize("turn_radps", [0.0, 0.9, -0.7])
def test_turn_of_the_last_moments_fades_within_a_second_at_every_clock(rate_hz, turn_radps):
    """Someone on a circle from a heading of 2.5 rad: positions from the definition, in an open place off the origin."""
    dt_s, speed_mps, frame = 1 / rate_hz, 1.3, GridFrame(origin_x_m=-8.0, origin_y_m=3.0, resolution_m=0.5)
    window = max(1, round(0.2 / dt_s))
    headings = 2.5 + turn_radps * dt_s * np.arange(2 * window)
    strides = speed_mps * dt_s * np.column_stack([np.cos(headings), np.sin(headings)])
    views = np.array([1.0, 7.0]) + np.vstack([np.zeros(2), np.cumsum(strides, axis=0)])
    ahead = predict_walk(views, np.full((17, 33), 9.0), frame, round(1.5 / dt_s), dt_s)
    # Half a window on from the middle of the latest one, then on with what is left of the turn.
    newer, older = views[-1] - views[-1 - window], views[-1 - window] - views[-1 - 2 * window]
    turn = math.atan2(older[0] * newer[1] - older[1] * newer[0], older @ newer) / window
    steps = np.arange(len(ahead))
    left = turn * (1 - dt_s) ** steps
    heading = math.atan2(newer[1], newer[0]) + 0.5 * turn * window + np.cumsum(left)
    stride_m = np.hypot(*newer) / window
    expected = views[-1] + np.cumsum(stride_m * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    np.testing.assert_allclose(ahead, expected, atol=1e-9)
    assert turn == pytest.approx(turn_radps * dt_s)


@pytest.mark.parametrize("rate_hz", [10, 20, 40])
def test_wall_and_route_turn_somebody_as_fast_at_every_clock(rate_hz):
    dt_s = 1 / rate_hz
    frame, place_m = GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.1), 0.05 + 0.1 * np.arange(60)
    x_m, y_m = -1.0 + place_m[None, :], -2.0 + place_m[:, None]
    views = np.column_stack([-1.3 * dt_s * np.arange(30, -1, -1), np.zeros(31)])
    to_wall = np.maximum(1.0 - x_m, 0.0) + 0.0 * y_m
    walked = predict_walk(views, np.ascontiguousarray(to_wall), frame, 3, dt_s)
    assert abs(_headings(np.vstack([[0.0, 0.0], walked]))[0]) == pytest.approx(3.0 * dt_s)
    to_place = np.round(UNITS_PER_CELL * np.hypot(x_m + 0.5, y_m - 3.0) / 0.1).astype(np.int32)
    route, explained = follow_route(views, to_place, frame, 3, dt_s)
    assert _headings(np.vstack([[0.0, 0.0], route])) == pytest.approx(2.4 * dt_s * np.arange(1, 4), abs=1e-6)
    back_m = 1.3 * 2 * round(0.2 / dt_s) * dt_s
    nearer_m = math.hypot(-back_m + 0.5, 3.0) - math.hypot(0.5, 3.0)
    assert explained == pytest.approx(nearer_m / back_m, abs=0.2)


def _headings(points):
    return np.arctan2(*np.diff(points, axis=0).T[::-1])


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
