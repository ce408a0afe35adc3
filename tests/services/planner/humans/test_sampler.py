import itertools
import math
from collections import Counter

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, meets_obstacle
from readygo.common.errors import AvatarError, SceneError
from readygo.common.maps import OccupancyMap
from readygo.common.messages import HumanPlanRequest, encode
from readygo.services.planner import HumanPlannerConfig, handle_human_plan
from readygo.services.planner.humans.config import FamilyMix
from readygo.services.planner.humans.sampler import STANDING, drawn_order
from tests.services.planner.worlds import FRAME, hall, key, make_human_planner, maps_of, planner_of


@pytest.fixture(scope="module")
def replies(human_planner):
    return [handle_human_plan(human_planner, HumanPlanRequest(episode=key(index))) for index in range(40)]


@pytest.fixture(scope="module")
def scenarios(replies):
    return [reply.scenario for reply in replies if reply.scenario is not None]


def test_most_draws_are_accepted_and_the_others_say_why(replies):
    assert sum(not reply.rejected for reply in replies) >= 25
    for reply in replies:
        assert (reply.scenario is None) == bool(reply.rejected)
        assert len(reply.rejected) < 60


def test_start_and_goal_keep_the_planning_radius_and_the_distance(human_planner, scenarios):
    for scenario in scenarios:
        x, y, yaw = scenario.start_xyyaw
        goal_x, goal_y = scenario.goal_xy_m
        for point in ((x, y), (goal_x, goal_y)):
            assert not meets_obstacle(human_planner.maps.robot, *point, human_planner.robot.planning_radius_m)
        assert 3.0 <= math.hypot(goal_x - x, goal_y - y) <= 10.0
        assert yaw == pytest.approx(math.atan2(goal_y - y, goal_x - x))


def test_humans_keep_their_clearance_everywhere(human_planner, scenarios):
    for human in itertools.chain.from_iterable(scenario.humans for scenario in scenarios):
        for x, y in human.xy_m:
            # Distances are interpolated between cells, which costs up to a centimetre or two at corners.
            assert not meets_obstacle(human_planner.maps.human, x, y, 0.35 - 0.03)


def test_humans_walk_at_one_speed_in_the_configured_range(scenarios):
    for human in itertools.chain.from_iterable(scenario.humans for scenario in scenarios):
        steps = np.hypot(*np.diff(human.xy_m, axis=0).T)
        assert 0.8 <= human.speed_mps <= 1.4
        assert np.allclose(steps[:-1], 0.05 * human.speed_mps, rtol=0.02)


def test_humans_neither_start_at_the_robot_nor_park_on_the_goal(scenarios):
    for scenario in scenarios:
        for human in scenario.humans:
            assert np.hypot(*(human.xy_m[0] - scenario.start_xyyaw[:2])) >= 1.5
            assert np.hypot(*(human.xy_m[-1] - scenario.goal_xy_m)) >= 1.6
            assert np.hypot(*(human.xy_m[:61] - scenario.start_xyyaw[:2]).T).min() >= 0.75


def test_humans_do_not_run_into_each_other(scenarios):
    pairs = [scenario.humans for scenario in scenarios if len(scenario.humans) == 2]
    assert pairs
    for a, b in pairs:
        rows = np.arange(max(len(a.xy_m), len(b.xy_m)))
        gap = a.xy_m[np.minimum(rows, len(a.xy_m) - 1)] - b.xy_m[np.minimum(rows, len(b.xy_m) - 1)]
        assert np.hypot(*gap.T).min() >= 0.5


def test_crossing_humans_meet_the_robot_in_time(scenarios):
    """On the straight way at the expected speed, the robot would come close to most of them."""
    nearest = []
    for scenario in scenarios:
        way = scenario.goal_xy_m - scenario.start_xyyaw[:2]
        length = float(np.hypot(*way))
        for human in scenario.humans:
            if human.encounter != "crossing":
                continue
            t = np.arange(len(human.xy_m)) * 0.05
            along = np.clip((t - 0.5) * 0.85, 0, length)[:, None] / length
            nearest.append(np.hypot(*(human.xy_m - scenario.start_xyyaw[:2] - along * way).T).min())
    assert len(nearest) >= 8
    assert np.median(nearest) < 0.9


def test_both_encounters_and_all_avatars_occur(scenarios):
    humans = list(itertools.chain.from_iterable(scenario.humans for scenario in scenarios))
    assert {human.encounter for human in humans} == {"crossing", "parallel"}
    assert {human.avatar for human in humans} == {"adam", "mia", "zoe"}
    assert all(a.avatar != b.avatar for a, b in (s.humans for s in scenarios if len(s.humans) == 2))


def test_static_task_has_the_same_start_and_goal_and_no_humans(human_planner, scenarios):
    for scenario in scenarios[:10]:
        static = handle_human_plan(human_planner, HumanPlanRequest(episode=scenario.episode, static=True)).scenario
        assert np.array_equal(static.start_xyyaw, scenario.start_xyyaw)
        assert np.array_equal(static.goal_xy_m, scenario.goal_xy_m)
        assert static.humans == ()


def test_same_key_gives_the_same_bytes_on_any_planner_in_any_order(human_planner, replies):
    other = make_human_planner()
    for index in (7, 3, 5):
        reply = handle_human_plan(other, HumanPlanRequest(episode=key(index)))
        assert encode(reply) == encode(replies[index])


def test_a_map_without_room_is_refused():
    full = np.ones((40, 40), np.bool_)
    full[18:22, 18:22] = False
    with pytest.raises(SceneError, match="no free space"):
        make_human_planner(maps_of(OccupancyMap(frame=FRAME, occupied=full)))


def test_a_room_too_small_for_any_goal_rejects_with_a_reason():
    closet = np.ones((60, 60), np.bool_)
    closet[5:45, 5:45] = False
    reply = handle_human_plan(
        make_human_planner(maps_of(OccupancyMap(frame=FRAME, occupied=closet))), HumanPlanRequest(episode=key(0))
    )
    assert reply.rejected == "no way from start to goal"


def test_humans_without_avatars_are_an_error():
    bare = make_human_planner(avatar_names=())
    with pytest.raises(AvatarError, match="no avatars"):
        handle_human_plan(bare, HumanPlanRequest(episode=key(0)))


def test_a_family_without_a_place_is_replaced_by_another_of_the_mix_or_rejected():
    alone = planner_of("doorway", occupancy=hall())
    assert handle_human_plan(alone, HumanPlanRequest(episode=key(0))).rejected == "no room for a human"
    mixed = planner_of(occupancy=hall(), mix=FamilyMix(doorway=1.0, crossing=0.01))
    scenarios = [handle_human_plan(mixed, HumanPlanRequest(episode=key(index))).scenario for index in range(6)]
    assert {human.encounter for s in scenarios if s is not None for human in s.humans} == {"crossing"}


def test_fewer_humans_come_where_no_more_find_room_if_that_is_asked_for():
    closet = np.ones((200, 240), np.bool_)
    closet[20:100, 20:100] = False
    occupancy = OccupancyMap(frame=FRAME, occupied=closet)
    counts = {}
    for fewer in (False, True):
        planner = planner_of(occupancy=occupancy, people=(0, 4), fewer_humans=fewer, effort="quick")
        replies = [handle_human_plan(planner, HumanPlanRequest(episode=key(index))) for index in range(12)]
        counts[fewer] = [len(reply.scenario.humans) for reply in replies if reply.scenario is not None]
    assert len(counts[False]) < 12
    assert len(counts[True]) == 12
    assert max(counts[True]) < 4


def test_families_are_drawn_by_their_shares_and_none_twice():
    mix = FamilyMix(crossing=2.0, frontal=1.0, doorway=1.0)
    rng = np.random.default_rng(0)
    orders = [tuple(drawn_order(rng, mix)) for _ in range(400)]
    assert {frozenset(order) for order in orders} == {frozenset(("crossing", "frontal", "doorway"))}
    assert Counter(order[0] for order in orders)["crossing"] == pytest.approx(200, abs=40)


def test_scenarios_of_a_seed_are_as_they_were(replies, scenarios, golden_figures):
    golden_figures("humans/accepted", [not reply.rejected for reply in replies])
    golden_figures("humans/tasks", [scenario.start_xyyaw for scenario in scenarios], [s.goal_xy_m for s in scenarios])
    people = list(itertools.chain.from_iterable(scenario.humans for scenario in scenarios))
    golden_figures("humans/walks", np.concatenate([human.xy_m for human in people]))
    golden_figures(
        "humans/people", [[human.speed_mps, len(human.xy_m), *map(ord, human.encounter[:2])] for human in people]
    )


def test_people_who_stand_are_in_the_way_or_beside_it_and_leave_one():
    config = HumanPlannerConfig(standing_min=1, standing_max=3)
    planner, walking = make_human_planner(config=config), make_human_planner()
    counts = Counter()
    for index in range(20):
        reply = handle_human_plan(planner, HumanPlanRequest(episode=key(index)))
        without = handle_human_plan(walking, HumanPlanRequest(episode=key(index)))
        if reply.scenario is None or without.scenario is None:
            continue
        standing = [human for human in reply.scenario.humans if human.encounter == STANDING]
        walkers = [human for human in reply.scenario.humans if human.encounter != STANDING]
        assert [human.xy_m.tolist() for human in walkers] == [h.xy_m.tolist() for h in without.scenario.humans]
        counts[len(standing)] += 1
        for human in standing:
            (place,) = human.xy_m
            assert not meets_obstacle(planner.maps.human, *place, 0.25)
            assert np.hypot(*(place - reply.scenario.start_xyyaw[:2])) >= 1.5
            for other in walkers:
                assert np.hypot(*(other.xy_m - place).T).min() >= 0.5
    assert set(counts) == {1, 2, 3}


def test_obstacles_alone_are_people_who_stand_and_need_room():
    nobody = EpisodeConfig(human_count_min=0, human_count_max=0)
    alone = make_human_planner(episode=nobody, config=HumanPlannerConfig(standing_min=2, standing_max=2))
    scenario = handle_human_plan(alone, HumanPlanRequest(episode=key(1))).scenario
    assert [human.encounter for human in scenario.humans] == [STANDING] * 2
    narrow = np.ones((80, 200), np.bool_)
    narrow[30:50, 10:190] = False
    corridor = make_human_planner(
        maps=maps_of(OccupancyMap(frame=FRAME, occupied=narrow)),
        episode=nobody,
        config=HumanPlannerConfig(standing_min=1, standing_max=1, effort="quick"),
    )
    assert handle_human_plan(corridor, HumanPlanRequest(episode=key(0))).rejected == "no room for a human"


def test_people_who_stand_need_avatars_too():
    alone = make_human_planner(
        avatar_names=(),
        episode=EpisodeConfig(human_count_min=0, human_count_max=0),
        config=HumanPlannerConfig(standing_max=1),
    )
    with pytest.raises(AvatarError, match="Humans are asked for but there are no avatars"):
        handle_human_plan(alone, HumanPlanRequest(episode=key(0)))
