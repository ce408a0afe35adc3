import itertools
import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, meets_obstacle
from readygo.common.maps import OccupancyMap
from readygo.common.messages import HumanPlanRequest, HumanTrajectory, Outcome, Scenario, encode
from readygo.services.planner import handle_human_plan
from readygo.services.planner.expert.handlers import drive
from readygo.services.planner.humans.handlers import let_react
from readygo.services.planner.humans.reactive import ReactiveHumans
from readygo.services.planner.humans.velocity_choice import Sight
from tests.services.planner.worlds import animate, hall, key, planner_of, rooms

FRONT = np.stack([np.arange(190) * 0.05 - 2.0, np.full(190, 7.0)], axis=1)
"""Along +x at 1 m/s from x = -2."""


def walked(drawn, robot, steps=160, reacts=None, occupancy=None, cone_deg=200.0, range_m=5.0):
    """Where people go beside a robot that `robot(step)` places: x, y, vx, vy, or None."""
    people = ReactiveHumans(
        drawn,
        reacts or [True] * len(drawn),
        occupancy or hall(),
        0.5,
        EpisodeConfig(),
        sight=Sight(cos_half_cone=math.cos(0.5 * math.radians(cone_deg)), range_m=range_m),
    )
    for step in range(steps):
        people.advance(robot(step))
    return np.array(people.xy_m)


def test_alone_humans_walk_as_drawn():
    rows = walked([FRONT], lambda _: None, 250)[:, 0]
    assert np.hypot(*(rows[:190] - FRONT).T).max() < 0.45
    assert rows[-1] == pytest.approx(FRONT[-1], abs=0.05)


def test_somebody_steps_aside_for_a_robot_that_comes_towards_them_and_returns():
    def robot(step):
        return 5.0 - 0.04 * step, 7.02, -0.8, 0.0

    gaps = [np.hypot(*(xy - robot(k)[:2])) for k, xy in enumerate(walked([FRONT], robot)[:, 0])]
    assert min(gaps) > 0.5
    assert min(np.hypot(*(xy - robot(k)[:2])) for k, xy in enumerate(FRONT[:161])) < 0.1
    assert walked([FRONT], robot, 260)[-1, 0] == pytest.approx(FRONT[-1], abs=0.1)


def test_a_robot_behind_a_wall_is_not_seen():
    wall = hall().occupied.copy()
    wall[111:114, 10:230] = True
    hidden = OccupancyMap(frame=hall().frame, occupied=wall)
    far_side = walked([FRONT - (0, 0.2)], lambda step: (6.0 - 0.05 * step, 8.1, -1.0, 0.0), occupancy=hidden)
    assert np.array_equal(far_side, walked([FRONT - (0, 0.2)], lambda _: None, occupancy=hidden))


def test_a_robot_that_comes_up_from_behind_is_seen_by_a_view_all_round_only():
    def robot(step):
        # Twice as fast as the walker, whom it would run into after 40 steps.
        return -1.2 + 0.1 * step, 7.05, 2.0, 0.0

    drawn = [FRONT[60:]]
    alone = walked(drawn, lambda _: None, 40)
    assert np.array_equal(walked(drawn, robot, 40, cone_deg=180.0), alone)
    assert np.array_equal(walked(drawn, robot, 40), alone)
    aware = walked(drawn, robot, 40, cone_deg=360.0)
    assert np.abs(aware - alone)[:, 0].max() > 0.1


def test_a_robot_in_front_is_seen_up_to_the_edge_of_the_view():
    def crossing(step):
        # Stays 60 degrees to the left of the walker until they would meet.
        apart_m = 2.0 - 0.04 * step
        return -2.0 + 0.05 * step + 0.5 * apart_m, 7.0 + 0.87 * apart_m, 0.6, -0.7

    alone = walked([FRONT], lambda _: None, 40)
    assert np.array_equal(walked([FRONT], crossing, 30, cone_deg=90.0), alone[:31])
    assert np.abs(walked([FRONT], crossing, 40, cone_deg=150.0) - alone)[:, 0].max() > 0.1


def test_humans_avoid_each_other_and_whoever_does_not_react_keeps_to_the_rows():
    other = FRONT[::-1].copy() - (3.0, 0.03)
    both = walked([FRONT, other], lambda _: None)
    assert np.hypot(*(both[:, 0] - both[:, 1]).T).min() >= 0.5
    one = walked([FRONT, other], lambda _: None, reacts=[True, False])
    assert np.array_equal(one[:161, 1], other[:161])
    assert np.hypot(*(one[:, 0] - one[:, 1]).T).min() >= 0.45


@pytest.fixture(scope="module")
def reacting():
    return planner_of(reactive=True, people=(2, 2))


@pytest.fixture(scope="module")
def pairs(reacting):
    """Drawn and reacted scenarios of the same episodes."""
    drawing = planner_of(people=(2, 2))
    found = []
    for index in range(16):
        request = HumanPlanRequest(episode=key(index))
        scenarios = [handle_human_plan(planner, request).scenario for planner in (drawing, reacting)]
        if None not in scenarios:
            found.append(scenarios)
    return found


def test_reactive_humans_are_hit_less_often_by_the_expert(robot_planner, pairs):
    hits = [0, 0]
    for pair in pairs:
        for k, scenario in enumerate(pair):
            outcome = drive(robot_planner, scenario, animate(scenario)).outcome
            hits[k] += outcome is Outcome.HUMAN_COLLISION
    assert len(pairs) >= 8
    assert hits[0] >= 3
    assert hits[1] <= hits[0] / 2


def test_reactions_keep_off_walls_and_start_end_and_name_of_the_drawn_humans(pairs):
    occupancy = rooms()
    for drawn, reacted in pairs:
        for a, b in zip(drawn.humans, reacted.humans, strict=True):
            assert (a.avatar, a.encounter) == (b.avatar, b.encounter)
            assert np.array_equal(a.xy_m[0], b.xy_m[0])
            assert np.hypot(*np.diff(b.xy_m, axis=0).T).max() <= 0.05 * 2.3
            assert not any(meets_obstacle(occupancy, x, y, 0.25) for x, y in b.xy_m.tolist())
        for a, b in itertools.combinations(reacted.humans, 2):
            rows = np.arange(max(len(a.xy_m), len(b.xy_m)))
            gap = a.xy_m[np.minimum(rows, len(a.xy_m) - 1)] - b.xy_m[np.minimum(rows, len(b.xy_m) - 1)]
            assert np.hypot(*gap.T).min() >= 0.45
    assert any(len(a.xy_m) != len(b.xy_m) for d, r in pairs for a, b in zip(d.humans, r.humans, strict=True))


def test_reactions_are_the_same_bytes_on_any_planner(reacting, pairs):
    other = planner_of(reactive=True, people=(2, 2))
    for _, reacted in pairs[:3]:
        reply = handle_human_plan(other, HumanPlanRequest(episode=reacted.episode))
        assert encode(reply.scenario) == encode(reacted)


def test_nobody_reacts_in_the_static_task_or_without_humans(reacting):
    scenario = Scenario(
        episode=key(0), start_xyyaw=np.array([-2.0, 4.0, 0.0]), goal_xy_m=np.array([1.5, 5.0]), humans=()
    )
    assert let_react(reacting, scenario, []).humans == ()
    stander = HumanTrajectory(avatar="mia", encounter="x", speed_mps=1.0, xy_m=np.array([[7.0, 10.0]]))
    one = Scenario(episode=key(0), start_xyyaw=scenario.start_xyyaw, goal_xy_m=scenario.goal_xy_m, humans=(stander,))
    assert let_react(reacting, one, [True]).humans[0].xy_m == pytest.approx(np.array([[7.0, 10.0]]), abs=0.01)


def test_people_who_yield_to_a_robot_and_to_each_other_walk_as_they_did(golden_figures):
    def robot(step):
        return (4.4 - 0.03 * step, 6.6 + 0.006 * step, -0.6, 0.12) if step % 7 else None

    against = np.column_stack([4.1 - 0.055 * np.arange(150), 7.4 - 0.004 * np.arange(150)])
    across = np.column_stack([1.2 + 0.006 * np.arange(120), 4.2 + 0.045 * np.arange(120)])
    rows = walked([FRONT, against, across], robot, reacts=[True, False, True], range_m=3.7, cone_deg=170.0)
    golden_figures("humans/reactive", rows.reshape(len(rows), -1))
    golden_figures("humans/in the flat", walked([FRONT - [0.0, 1.3]], robot, 90, occupancy=rooms())[:, 0])
