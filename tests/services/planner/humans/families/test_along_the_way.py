import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.services.planner.humans.families.along_the_way import overtaking
from tests.services.planner.humans.families.drives import ROBOT_MPS, arrival_s, held, meeting, robot_at
from tests.services.planner.worlds import hall, make_human_planner, maps_of


def test_frontal_humans_come_against_the_robot_on_its_way(drawn):
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


def test_goalward_humans_pass_the_goal_near_the_robots_arrival(drawn):
    for scenario, way in drawn["goalward"]:
        xy = scenario.humans[0].xy_m
        away = np.hypot(*(xy - scenario.goal_xy_m).T)
        assert away[0] >= 2.0
        assert away.min() <= 0.7
        assert -3.0 <= int(np.argmin(away)) * 0.05 - arrival_s(way) <= 1.05
        assert away[-1] >= 1.6


@pytest.mark.parametrize(
    "family", ["crossing", "parallel", "frontal", "overtaking", "crossing_left", "crossing_right", "goalward"]
)
def test_walks_of_the_first_episodes_are_as_they_were(family, drawn, golden_figures):
    rows = [human.xy_m for scenario, _ in drawn[family] for human in scenario.humans]
    golden_figures(f"humans/{family}", np.concatenate(rows))
    golden_figures(f"humans/{family} ways", np.concatenate([way for _, way in drawn[family]]))


@pytest.mark.parametrize(
    ("low_mps", "high_mps", "slower", "faster"),
    [(0.5, 1.0, True, False), (0.7, 1.6, False, True), (0.4, 1.6, True, True), (0.7, 1.0, False, False)],
)
def test_who_overtakes_or_is_overtaken_is_clearly_faster_or_slower_than_the_robot(low_mps, high_mps, slower, faster):
    """The robot is expected at 0.85 m/s: slower is up to 0.64 m/s, faster from 1.1 m/s on."""
    episode = EpisodeConfig(human_speed_min_mps=low_mps, human_speed_max_mps=high_mps)
    sampler = make_human_planner(maps_of(hall()), episode=episode).sampler
    rng, found = np.random.default_rng(1), []
    for _ in range(150):
        found += [walk.speed_mps for walk in overtaking(sampler.site, rng, sampler.draw_task(rng), 1)]
    slow, fast = [v for v in found if v <= 0.75 * ROBOT_MPS], [v for v in found if v >= 1.3 * ROBOT_MPS]
    assert len(slow) + len(fast) == len(found)
    assert (len(slow) > 0, len(fast) > 0) == (slower, faster)
    assert all(low_mps <= v <= high_mps for v in found)
