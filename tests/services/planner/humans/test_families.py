import dataclasses
import itertools
import math
from collections import Counter

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, Purpose, episode_rng, meets_obstacle
from readygo.common.maps import OccupancyMap
from readygo.common.messages import HumanPlanRequest, encode
from readygo.services.planner import FamilyMix, HumanPlannerConfig, handle_human_plan
from readygo.services.planner.humans.families import FAMILIES
from readygo.services.planner.humans.mixes import MIXES
from readygo.services.planner.humans.passages import find_passages
from readygo.services.planner.humans.sampler import drawn_order
from tests.services.planner.worlds import FRAME, hall, key, make_human_planner, planner_of, rooms

DOORS = ((0.1, 6.98), (6.1, 6.98), (2.98, 4.6), (2.98, 9.6))
ROBOT_MPS, GETTING_GOING_S = 0.85, 0.5


@pytest.fixture(scope="module")
def drawn():
    """By family: (scenario, the robot's way) of the first indices that have one."""
    found = {}
    for family in FAMILIES:
        # Three: a group of two would leave one over who finds no group.
        planner = planner_of(family, people=(3, 3) if family == "standing_group" else (1, 1))
        rows = []
        for index in range(24):
            scenario = handle_human_plan(planner, HumanPlanRequest(episode=key(index))).scenario
            if scenario is not None:
                task = planner.sampler.draw_task(episode_rng(key(index), Purpose.SCENARIO))
                rows.append((scenario, task.way_m))
        found[family] = rows[:8]
    return found


def robot_at(way, count):
    """Where the robot is expected at each step, and which way it goes."""
    along = np.r_[0, np.cumsum(np.hypot(*np.diff(way, axis=0).T))]
    metres = np.clip((np.arange(count) * 0.05 - GETTING_GOING_S) * ROBOT_MPS, 0, along[-1])

    def at(s):
        return np.stack([np.interp(s, along, way[:, k]) for k in range(2)], axis=1)

    return at(metres), at(np.minimum(metres + 0.25, along[-1])) - at(np.maximum(metres - 0.25, 0)), along[-1]


def held(xy, count):
    return xy[np.minimum(np.arange(count), len(xy) - 1)]


def arrival_s(way):
    return robot_at(way, 2)[2] / ROBOT_MPS + GETTING_GOING_S


def meeting(xy, way):
    """Step of the nearest approach, gap [m], angle between the headings [deg]."""
    count = max(len(xy), int(arrival_s(way) / 0.05) + 2)
    robot, ahead, _ = robot_at(way, count)
    person = held(xy, count)
    step = int(np.argmin(np.hypot(*(person - robot).T)))
    walk = person[min(step + 5, count - 1)] - person[max(step - 5, 0)]
    turn = math.degrees(math.atan2(*walk[::-1]) - math.atan2(*ahead[step][::-1]))
    return step, float(np.hypot(*(person - robot)[step])), abs((turn + 180) % 360 - 180)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_finds_room_in_a_flat_and_says_its_name(drawn, family):
    assert len(drawn[family]) >= 3
    for scenario, _ in drawn[family]:
        assert {human.encounter for human in scenario.humans} == {family}


@pytest.mark.parametrize("family", FAMILIES)
def test_nobody_touches_a_wall_runs_or_creeps(drawn, family):
    occupancy = rooms()
    for human in itertools.chain.from_iterable(scenario.humans for scenario, _ in drawn[family]):
        assert not any(meets_obstacle(occupancy, x, y, 0.25) for x, y in human.xy_m.tolist())
        assert 0.5 <= human.speed_mps <= 2.0
        assert np.hypot(*np.diff(human.xy_m, axis=0).T).max() <= 0.05 * human.speed_mps + 1e-6


def test_frontal_people_come_against_the_robot_on_its_way(drawn):
    for scenario, way in drawn["frontal"]:
        _, gap_m, turn_deg = meeting(scenario.humans[0].xy_m, way)
        assert gap_m <= 0.61
        assert turn_deg >= 134


def test_crossing_left_and_right_are_the_robots(drawn):
    for family, side in (("crossing_left", 1), ("crossing_right", -1)):
        for scenario, way in drawn[family]:
            xy = scenario.humans[0].xy_m
            k = int(np.argmin(np.hypot(*(way[:, None] - xy[None]).transpose(2, 0, 1)).min(axis=1)))
            ahead = way[min(k + 5, len(way) - 1)] - way[max(k - 5, 0)]
            walk = xy[-1] - xy[0]
            # From the left means to the right: a negative turn from the robot's heading.
            assert side * (ahead[0] * walk[1] - ahead[1] * walk[0]) < 0


def test_overtaking_changes_the_order_side_by_side_with_one_heading(drawn):
    both = set()
    for scenario, way in drawn["overtaking"]:
        human = scenario.humans[0]
        count = int(arrival_s(way) / 0.05)
        robot, ahead, _ = robot_at(way, count)
        gap = held(human.xy_m, count) - robot
        side = np.sum(gap * ahead, axis=1) > 0
        (step,) = np.flatnonzero(side[1:] != side[:-1])[:1]
        both.add(bool(side[0]))
        assert (human.speed_mps < ROBOT_MPS) == bool(side[0])
        assert abs(human.speed_mps - ROBOT_MPS) >= 0.2
        assert np.hypot(*gap[step]) <= 1.55
        if not side[0]:
            assert np.hypot(*gap[step]) >= 0.7
        walk = held(human.xy_m, count)[step + 5] - held(human.xy_m, count)[max(step - 5, 0)]
        assert np.dot(walk, ahead[step]) > 0.7 * np.hypot(*walk) * np.hypot(*ahead[step])
    assert both == {True, False}


def test_whoever_comes_round_a_blind_corner_is_hidden_until_two_seconds_before(drawn):
    occupancy = rooms()
    for scenario, way in drawn["blind_corner"]:
        xy = scenario.humans[0].xy_m
        step, gap_m, _ = meeting(xy, way)
        assert gap_m <= 0.71
        robot, person = robot_at(way, step)[0], held(xy, step)
        for k in range(max(step - 40, 0)):
            line = robot[k] + np.linspace(0, 1, 400)[:, None] * (person[k] - robot[k])
            cells = [occupancy.occupied[FRAME.cell(x, y)] for x, y in line.tolist()]
            assert any(cells)


def test_doorway_people_are_in_a_door_with_the_robot_and_against_it(drawn):
    for scenario, way in drawn["doorway"]:
        xy = scenario.humans[0].xy_m
        count = max(len(xy), int(arrival_s(way) / 0.05) + 2)
        robot, ahead, _ = robot_at(way, count)
        meets = []
        for door in DOORS:
            to_robot, to_person = (np.hypot(*(rows - door).T) for rows in (robot, held(xy, count)))
            a, b = int(np.argmin(to_robot)), int(np.argmin(to_person))
            walk = held(xy, count)[min(b + 5, count - 1)] - held(xy, count)[max(b - 5, 0)]
            meets.append(to_robot[a] < 0.6 and to_person[b] < 0.5 and abs(a - b) <= 21 and np.dot(walk, ahead[a]) < 0)
        assert any(meets)


def test_groups_stand_in_a_circle_near_the_way_after_a_step_towards_its_middle(drawn):
    for scenario, way in drawn["standing_group"]:
        ends = np.array([human.xy_m[-1] for human in scenario.humans])
        gaps = [np.hypot(*(a - b)) for a, b in itertools.combinations(ends, 2)]
        assert min(gaps) >= 0.7
        assert max(gaps) <= 1.7
        assert np.hypot(*(way[:, None] - ends[None]).transpose(2, 0, 1)).min() <= 1.6
        # The middle of the circle that all ends lie on.
        steps = np.array([human.xy_m[-1] - human.xy_m[0] for human in scenario.humans])
        inward = steps / np.hypot(*steps.T)[:, None]
        spread = np.linalg.lstsq(
            np.concatenate([np.eye(2) - np.outer(u, u) for u in inward]),
            np.concatenate([(np.eye(2) - np.outer(u, u)) @ e for u, e in zip(inward, ends, strict=True)]),
            rcond=None,
        )[0]
        for human, end, u in zip(scenario.humans, ends, inward, strict=True):
            assert len(human.xy_m) <= 50
            assert np.dot(spread - end, u) > 0.9 * np.hypot(*(spread - end))


def test_groups_have_two_to_four_people_and_come_only_where_two_are_wanted():
    group, rng = FAMILIES["standing_group"], np.random.default_rng(0)
    sampler = planner_of("standing_group").sampler
    tasks = [sampler.draw_task(rng) for _ in range(5)]
    for wanted, sizes in ((1, {0}), (2, {0, 2}), (4, {0, 2, 3, 4})):
        assert {len(group(sampler.site, rng, task, wanted)) for task in tasks for _ in range(100)} == sizes


def test_stop_and_go_pauses_once_between_two_walks(drawn):
    for scenario, _ in drawn["stop_and_go"]:
        speed = np.hypot(*np.diff(scenario.humans[0].xy_m, axis=0).T) / 0.05
        runs = [(still, len(list(rows))) for still, rows in itertools.groupby(speed < 0.01)]
        assert [still for still, _ in runs if still] == [True]
        assert [still for still, _ in runs] == [False, True, False]
        assert 30 <= runs[1][1] <= 81


def test_goalward_people_pass_the_goal_near_the_robots_arrival(drawn):
    for scenario, way in drawn["goalward"]:
        xy = scenario.humans[0].xy_m
        away = np.hypot(*(xy - scenario.goal_xy_m).T)
        assert away[0] >= 2.0
        assert away.min() <= 0.7
        assert -3.0 <= int(np.argmin(away)) * 0.05 - arrival_s(way) <= 1.05
        assert away[-1] >= 1.6


def test_passages_of_a_flat_are_its_doors():
    planner = planner_of("doorway")
    passages = planner.sampler.site.passages
    wide = [passage for passage in passages if passage.width_m > 1.1]
    assert len(wide) >= len(DOORS)
    for door in DOORS:
        nearest = min(passages, key=lambda passage: math.dist(passage.middle_m, door))
        assert math.dist(nearest.middle_m, door) < 0.15
        assert nearest.width_m == pytest.approx(1.2, abs=0.06)


def test_an_empty_hall_has_no_passages():
    clearance = np.minimum.outer(np.r_[0:50, 50:0:-1], np.r_[0:80, 80:0:-1]) * 0.05
    assert find_passages(clearance, FRAME, walkable_m=0.375, width_max_m=1.6, wider_m=0.5) == ()


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
        planner = planner_of(occupancy=occupancy, people=(0, 4), fewer_humans=fewer, attempts=20)
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


@pytest.mark.parametrize("shares", [{"crossing": -1.0}, {"frontal": math.nan}, {}])
def test_mixes_that_cannot_be_drawn_are_refused(shares):
    with pytest.raises(ValueError, match=r"must be a number|share above 0"):
        FamilyMix(**shares)


@pytest.mark.parametrize("name", MIXES)
def test_recipes_give_the_same_bytes_on_any_planner_and_keep_other_settings(name):
    episode, config = MIXES[name](EpisodeConfig(time_limit_s=33.0), HumanPlannerConfig(start_margin_m=0.12))
    assert episode.time_limit_s == 33.0
    assert config.start_margin_m == 0.12
    one, other = (
        dataclasses.replace(config, mix=dataclasses.replace(config.mix)) if again else config for again in (0, 1)
    )
    replies = []
    for human_config in (one, other):
        planner = make_human_planner(avatar_names=("zoe", "adam"), episode=episode, config=human_config)
        order = (1, 0, 2) if human_config is one else (2, 1, 0)
        drawn = {k: encode(handle_human_plan(planner, HumanPlanRequest(episode=key(k)))) for k in order}
        replies.append([drawn[k] for k in range(3)])
    assert replies[0] == replies[1]


def test_nobody_walks_over_a_step_or_a_steep_slope_if_floors_are_looked_at():
    height = np.zeros((200, 240), np.float32)
    height[:, 120:] = 0.2
    free = planner_of("parallel", occupancy=hall(), height_m=height, people=(1, 1))
    careful = planner_of("parallel", occupancy=hall(), height_m=height, people=(1, 1), slope_max=0.35)
    over = {}
    for name, planner in (("free", free), ("careful", careful)):
        replies = [handle_human_plan(planner, HumanPlanRequest(episode=key(index))) for index in range(20)]
        walks = [reply.scenario.humans[0].xy_m for reply in replies if reply.scenario is not None]
        over[name] = [float(xy[:, 0].min()) < 3.0 < float(xy[:, 0].max()) for xy in walks]
    assert any(over["free"])
    assert over["careful"]
    assert not any(over["careful"])


def test_gentle_ramps_are_walked():
    height = np.tile(np.arange(240, dtype=np.float32) * 0.05 * 0.1, (200, 1))
    planner = planner_of("parallel", occupancy=hall(), height_m=height, slope_max=0.35)
    assert np.array_equal(planner.human_map.occupied, hall().occupied)
