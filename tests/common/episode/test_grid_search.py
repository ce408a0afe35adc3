import heapq
import itertools
import math

import numpy as np
import pytest

from readygo.common.episode import GridSearch, shortest_way_m
from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL, UNREACHED
from readygo.common.maps import GridFrame, OccupancyMap


def _plain_dijkstra(factor, source):
    distance = np.full(factor.shape, UNREACHED)
    distance[source] = 0
    queue = [(0, source)]
    while queue:
        cost, (i, j) = heapq.heappop(queue)
        if cost > distance[i, j]:
            continue
        for di in (-1, 0, 1):
            for dj in (-1, 0, 1):
                a, b = i + di, j + dj
                if (di or dj) and 0 <= a < factor.shape[0] and 0 <= b < factor.shape[1] and factor[a, b]:
                    new = cost + (7 if di and dj else 5) * int(factor[a, b])
                    if new < distance[a, b]:
                        distance[a, b] = new
                        heapq.heappush(queue, (new, (a, b)))
    return distance


@pytest.fixture
def ground():
    rng = np.random.default_rng(1)
    factor = rng.integers(FREE, 60, (40, 50)).astype(np.uint8)
    factor[rng.random(factor.shape) < 0.3] = 0
    factor[3, 4] = factor[35, 44] = FREE
    return factor


def test_flood_equals_plain_dijkstra(ground):
    assert np.array_equal(GridSearch(ground.shape).distances(ground, (3, 4)), _plain_dijkstra(ground, (3, 4)))


def test_path_costs_what_dijkstra_says(ground):
    search = GridSearch(ground.shape)
    goal = (35, 44)
    reference = _plain_dijkstra(ground, goal)
    for start in [(3, 4), *map(tuple, np.argwhere(ground)[::97].tolist())]:
        cells = search.path(ground, start, goal)
        if reference[start] >= UNREACHED:
            assert cells is None
            continue
        steps = np.abs(np.diff(cells, axis=0))
        assert steps.max(initial=0) <= 1
        assert tuple(cells[0]) == start
        assert tuple(cells[-1]) == goal
        cost = (np.where(steps.sum(axis=1) == 2, 7, 5) * ground[tuple(cells[:-1].T)].astype(int)).sum()
        assert cost == reference[start]


def test_flood_that_stops_early_is_right_up_to_its_slack(ground):
    target = (20, 20)
    ground[target] = FREE
    reference = _plain_dijkstra(ground, (3, 4))
    slack = 10 * UNITS_PER_CELL
    early = GridSearch(ground.shape).distances(ground, (3, 4), target=target, slack_units=slack)
    near = reference <= reference[target] + slack
    assert np.array_equal(early[near], reference[near])
    assert (early[~near] > reference[target] + slack).all()


def test_source_outside_of_the_grid_is_refused(ground):
    with pytest.raises(ValueError, match="outside"):
        GridSearch(ground.shape).distances(ground, (99, 0))


def test_ways_lead_from_corner_to_corner_of_an_oblong_grid_and_none_beyond():
    frame = GridFrame(origin_x_m=-3.1, origin_y_m=7.2, resolution_m=0.13)
    open_ground = OccupancyMap(frame=frame, occupied=np.zeros((11, 23), np.bool_))
    ends = [frame.centre_m(0, 0), frame.centre_m(10, 22), frame.centre_m(0, 22), frame.centre_m(10, 0)]
    for start, goal in itertools.permutations(ends, 2):
        assert shortest_way_m(open_ground, 0.0, start, goal) == pytest.approx(math.dist(start, goal), rel=0.01)
    for outside in (frame.centre_m(-1, 3), frame.centre_m(3, -1), frame.centre_m(11, 3), frame.centre_m(3, 23)):
        assert shortest_way_m(open_ground, 0.0, outside, ends[0]) == math.inf
        assert shortest_way_m(open_ground, 0.0, ends[0], outside) == math.inf
    search, factor = GridSearch((11, 23)), np.full((11, 23), FREE, np.uint8)
    for source in ((0, 0), (10, 22), (0, 22)):
        assert np.array_equal(search.distances(factor, source), _plain_dijkstra(factor, source))
    for source in ((-1, 0), (0, -1), (11, 0), (0, 23)):
        with pytest.raises(ValueError, match="outside"):
            search.distances(factor, source)


def test_shortest_way_is_straight_where_nothing_stands(hall):
    for goal in ((5.0, 0.0), (6.3, 2.1), (2.2, 2.9)):
        assert shortest_way_m(hall, 0.25, (0.0, 0.0), goal) == pytest.approx(math.hypot(*goal), rel=0.02)


def test_shortest_way_ends_at_the_circle_around_the_goal(hall):
    assert shortest_way_m(hall, 0.25, (0.0, 0.0), (5.0, 0.0), goal_radius_m=1.0) == pytest.approx(4.0, abs=0.05)


def test_shortest_way_goes_around_a_wall(hall):
    hall.occupied[:80, 60] = True
    way = shortest_way_m(hall, 0.25, (0.0, 0.0), (4.0, 0.0))
    expected = math.hypot(1.75, 2.0) + 0.55 + math.hypot(1.7, 2.0)
    assert way == pytest.approx(expected, rel=0.06)
    hall.occupied[:, 60] = True
    assert shortest_way_m(hall, 0.25, (0.0, 0.0), (4.0, 0.0)) == math.inf
