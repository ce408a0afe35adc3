import itertools

import numpy as np
import pytest

from readygo.services.planner.humans.families import FAMILIES
from tests.services.planner.humans.families.drives import arrival_s, held, meeting, robot_at
from tests.services.planner.worlds import DOORS, FRAME, planner_of, rooms


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


def test_doorway_humans_are_in_a_door_with_the_robot_and_against_it(drawn):
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


def test_groups_have_two_to_four_humans_and_come_only_where_two_are_wanted():
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


@pytest.mark.parametrize("family", ["blind_corner", "doorway", "standing_group", "stop_and_go"])
def test_walks_of_the_first_episodes_are_as_they_were(family, drawn, golden_figures):
    rows = [human.xy_m for scenario, _ in drawn[family] for human in scenario.humans]
    golden_figures(f"humans/{family}", np.concatenate(rows))
    golden_figures(f"humans/{family} ways", np.concatenate([way for _, way in drawn[family]]))
