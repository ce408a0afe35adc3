import math

import numpy as np
import pytest

from readygo.common.episode.grid_search import FREE, UNITS_PER_CELL
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.expert.delay import LAYER_S, Delays, delay_at, fill_delays, nearness_cost
from readygo.services.planner.expert.records import CostGrid, HumansAhead

RESOLUTION_M, LAYERS, STEPS = 0.05, 9, 40
LAYER_STEPS = round(LAYER_S / DT_S)
CENTRE = (4.0, 4.0, 0.0)
NOBODY = HumansAhead(np.empty((0, STEPS, 2)), np.empty(0), 0.5, np.empty((0, STEPS)), 30.0)


def grid(blocked=False):
    """8 x 8 m with the goal to the right: ways are straight."""
    factor = np.full((160, 160), FREE, np.uint8)
    if blocked:
        factor[:] = 0
    to_goal = np.tile((UNITS_PER_CELL * (159 - np.arange(160))).astype(np.int32), (160, 1))
    return CostGrid(factor, to_goal, RESOLUTION_M)


def filled(humans, cost_grid=None, arrived_m=0.5):
    size = 2 * LAYERS + 3
    delays = Delays(0.25, 1.0, arrived_m, np.empty((size, size)), np.zeros((LAYERS, size, size)), LAYER_STEPS)
    fill_delays(cost_grid or grid(), CENTRE, humans, delays)
    return delays


def standing(x, y, chance=1.0):
    return HumansAhead(np.full((1, STEPS, 2), (x, y)), np.array([chance]), 0.5, np.full((1, STEPS), 0.4), 30.0)


def test_nearness_costs_nothing_beyond_the_width_and_more_the_nearer():
    costs = [nearness_cost(d * d, 0.5, 0.4, 30.0) for d in (0.95, 0.9, 0.8, 0.6, 0.501)]
    assert costs[:2] == [0.0, 0.0]
    assert 0 < costs[2] < costs[3] < costs[4] < 30.0
    assert costs[3] == pytest.approx(30.0 * 0.75**2)


def test_contact_is_dearer_the_deeper_and_always_dearer_than_nearness():
    deep, shallow = (nearness_cost(d * d, 0.5, 0.4, 30.0) for d in (0.1, 0.49))
    assert deep > shallow > 30.0 + 99.0


def test_nobody_delays_nobody():
    delays = filled(NOBODY)
    near = [delay_at(delays, CENTRE, 4.0 + dx, 4.0, 2) for dx in (-0.25, 0.0, 0.25)]
    assert near == pytest.approx([0.0] * 3, abs=1e-9)


def test_who_stands_on_the_way_delays_those_behind_and_not_those_past():
    delays = filled(standing(4.75, 4.0))
    behind, beside, past = (delay_at(delays, CENTRE, *place, 3) for place in ((4.5, 4.0), (4.0, 3.25), (4.0, 4.75)))
    assert behind > 1.0
    assert 0 <= beside < 0.5 * behind
    assert 0 <= past < 0.5 * behind


def test_delays_grow_with_the_chance():
    likely, unlikely = (delay_at(filled(standing(4.25, 4.0, chance)), CENTRE, 4.25, 4.0, 3) for chance in (1.0, 0.1))
    assert likely > 2 * unlikely > 0


def test_closed_ground_is_infinitely_far_and_places_beyond_reach_are_not_judged():
    closed = filled(NOBODY, grid(blocked=True))
    assert delay_at(closed, CENTRE, 4.0, 4.0, 2) == math.inf
    assert delay_at(closed, CENTRE, 6.0, 4.0, 1) == 0.0
    assert delay_at(closed, CENTRE, 4.0, 4.0, LAYERS) == 0.0


def test_who_has_arrived_may_stay_at_no_cost():
    delays = filled(standing(4.0, 4.0), arrived_m=100.0)
    assert delay_at(delays, CENTRE, 4.0, 4.0, 3) == 0.0


def test_a_layer_lasts_as_long_as_full_speed_takes_for_a_cell():
    assert pytest.approx(0.25) == LAYER_STEPS * DT_S


def test_delays_of_people_on_patchy_ground_are_as_they_were(golden_figures):
    rng = np.random.default_rng(6)
    factor = np.repeat(np.repeat(rng.integers(FREE, 4 * FREE, (20, 20)), 8, 0), 8, 1).astype(np.uint8)
    factor[40:60, 70:76] = 0
    k = np.arange(STEPS)[:, None]
    walks = np.stack([[3.2, 4.9] + [0.02, -0.03] * k, [4.6, 3.5] + [-0.03, 0.01] * k])
    widths = np.tile(0.3 + 0.01 * np.arange(STEPS), (2, 1))
    humans = HumansAhead(walks, np.array([0.8, 0.35]), 0.47, widths, 21.0)
    delays = filled(humans, CostGrid(factor, grid().to_goal, RESOLUTION_M))
    places = [(3.1 + 0.23 * a, 3.0 + 0.19 * b, layer) for a in range(9) for b in range(9) for layer in range(LAYERS)]
    rows = np.array([delay_at(delays, CENTRE, *place) for place in places])
    golden_figures("expert/delays", np.minimum(rows, 50.0))
