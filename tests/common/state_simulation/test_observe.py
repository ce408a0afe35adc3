import math

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig
from readygo.common.maps import sight_of_occupancy
from readygo.common.perception.noise import EXACT
from readygo.common.robot import RobotConfig
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.observe import (
    ARC_COUNT,
    GOAL,
    PATH,
    PEOPLE,
    PERSON_COUNT,
    SPEED,
    free_distance_m,
    know,
    observe,
    told_count,
    truth_count,
)
from readygo.common.state_simulation.tracks import begin_tracks, look, make_tracks, tracker_numbers
from readygo.common.state_simulation.world import ObservationConfig, make_world

ARCS = PEOPLE + 3 * PERSON_COUNT
NUMBERS = tracker_numbers(EXACT, RobotConfig().clock)


def make(hall, **observation):
    return make_world(hall, sight_of_occupancy(hall), RobotConfig(), EpisodeConfig(), ObservationConfig(**observation))


def tell(hall, world, state, goal, humans=()):
    """What a robot is told that has looked for half a second, with people who stand."""
    tracks, human_xy_m = make_tracks(1, max(len(humans), 1)), np.array(humans, np.float64).reshape(-1, 2)
    begin_tracks(tracks, 0, 0)
    for step in range(0, 11, 2):
        look(world, NUMBERS, tracks, 0, step, state[:3], human_xy_m, len(humans))
    out = np.empty(told_count(world), np.float32)
    observe(world, NUMBERS, tracks, 0, 10, state, goal, GoalDistances(hall, 0.3).to_goal_cm(goal), out)
    return out


def test_free_distances_end_at_walls_and_pillars(hall) -> None:
    world = make(hall)
    assert free_distance_m(world, 0.0, 0.0, 0.0, 20.0) == pytest.approx(8.95, abs=0.06)
    assert free_distance_m(world, 2.0, 1.02, 0.0, 20.0) == pytest.approx(2.0, abs=0.06)
    assert free_distance_m(world, 0.0, 0.0, math.pi / 2, 2.0) == 2.0


def test_goal_and_speeds_are_in_the_robots_frame(hall) -> None:
    told = tell(hall, make(hall), (1.0, 0.0, math.pi / 2, 0.5, -0.25), (1.0, 3.0))
    assert told[GOAL : GOAL + 5] == pytest.approx([0.3, 0.0, 1.0, 0.0, math.exp(-1.5)], abs=1e-6)
    assert told[SPEED : SPEED + 2].tolist() == [0.5, -0.25]
    assert told[0] == pytest.approx(math.exp(-0.5 * 3.95), rel=0.05)


def test_path_is_told_to_robots_that_know_their_map(hall) -> None:
    state, goal = (0.0, 0.0, 0.0, 0.0, 0.0), (5.0, 0.0)
    told = tell(hall, make(hall), state, goal)
    assert told[PATH] == pytest.approx(0.5, abs=0.02)
    assert told[PATH + 2 : PATH + 4] == pytest.approx([1.0, 0.0], abs=0.15)
    assert not tell(hall, make(hall, path=False), state, goal)[PATH:PEOPLE].any()


def test_nearest_people_come_first_in_the_robots_frame(hall) -> None:
    state = (0.0, 0.0, 0.0, 0.8, 0.0)
    told = tell(hall, make(hall), state, (6.0, 0.0), [(4.0, 1.0), (2.0, -1.0)])
    first, second = told[PEOPLE:][:PERSON_COUNT], told[PEOPLE + PERSON_COUNT :][:PERSON_COUNT]
    assert first[:3] == pytest.approx([1.0, 0.5, -0.25], abs=0.02)
    assert second[:3] == pytest.approx([1.0, 1.0, 0.25], abs=0.02)
    assert first[3:5] == pytest.approx([0.0, 0.0], abs=0.05)
    assert first[11] == 1.0
    assert not told[PEOPLE + 2 * PERSON_COUNT : ARCS].any()
    # The robot passes the first person at a distance of 1 m, in 2.5 s.
    assert first[15:18] == pytest.approx([math.exp(-2.5 / 1.5), math.exp(-1.0), -0.25], abs=0.05)


def test_arcs_tell_where_held_commands_lead(hall) -> None:
    """15 commands: standing, half and full speed with seven yaw rates each, straight ahead in the middle."""
    still, straight, left = 0, 11, 14
    told = tell(hall, make(hall), (0.0, 0.0, 0.0, 0.0, 0.0), (6.0, 0.0), [(2.5, 0.0)])[ARCS:].reshape(15, ARC_COUNT)
    assert told[still] == pytest.approx([0.0, math.exp(-2.0 / 0.5), 1 / 12], abs=0.01)
    assert told[straight, 1] > 1.0, "it would run into the person"
    assert told[straight, 2] > 0.7
    assert told[left, 1] < 0.2
    at_wall = tell(hall, make(hall), (8.3, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0))[ARCS:].reshape(15, ARC_COUNT)
    assert at_wall[still, 0] == 0.0
    assert at_wall[straight, 0] > 0.5
    assert at_wall[:, 1].max() == 0.0
    assert len(tell(hall, make(hall, arcs=False), (0.0,) * 5, (6.0, 0.0))) == ARCS


def test_truth_has_where_people_will_be(hall) -> None:
    world = make(hall)
    walks = np.zeros((200, 2, 2), np.float32)
    walks[:, 0, 0] = 1.0 + 0.05 * np.arange(200)
    told, out = np.ones(told_count(world), np.float32), np.empty(truth_count(world, 2), np.float32)
    know(world, 20, (0.0, 0.0, 0.0, 0.0, 0.0), 5.0, walks, 1, told, out)
    rest = out[told_count(world) :]
    assert rest[:3] == pytest.approx([0.5, math.exp(-2.5), 0.02])
    assert rest[3::3][:5] * 4.0 == pytest.approx([2.0, 2.5, 3.0, 4.0, 5.0])
    assert not rest[18:].any()
