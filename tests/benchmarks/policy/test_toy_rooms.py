import math

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from readygo.benchmarks.policy.toy_rooms import (
    CELL_M,
    Rooms,
    ToyTask,
    cost_to_go,
    draw_task,
    drive,
    expert_command,
    make_rooms,
    record,
)
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.episodes import read_episodes

ROBOT = RobotConfig(camera=CameraConfig(height_px=8, width_px=10))


@pytest.fixture(scope="module")
def rooms():
    return make_rooms(ROBOT, seed=3)


def test_cost_is_the_way_around_obstacles(rooms):
    row, column = map(int, np.unravel_index(rooms.distance_m.argmax(), rooms.distance_m.shape))
    cost = cost_to_go(rooms, CELL_M * np.array([column + 0.5, row + 0.5]))
    assert cost[row, column] == 0.0
    assert np.isinf(cost[rooms.occupied]).all()
    reached = np.argwhere(np.isfinite(cost))
    straight_m = CELL_M * np.linalg.norm(reached - [row, column], axis=1)
    assert (cost[tuple(reached.T)] >= straight_m - 1e-9).all()


def test_tasks_have_room_a_way_and_look_at_the_goal(rooms):
    for _ in range(3):
        task = draw_task(rooms, np.random.default_rng(1))
        x, y, yaw = task.pose
        assert rooms.clearance_m(x, y) >= 0.5
        assert 3 < math.dist((x, y), task.goal) < 10
        assert yaw == pytest.approx(math.atan2(task.goal[1] - y, task.goal[0] - x))


def test_expert_turns_to_lower_costs():
    cost = np.hypot(*np.ogrid[-10:30, -35:5])
    ahead, left = (expert_command(cost, (1.0, 1.0, yaw), ROBOT) for yaw in (0.0, -math.pi / 2))
    assert ahead[0] > 0.9 * ROBOT.v_max_mps
    assert abs(ahead[1]) < 0.3
    assert left[1] > 2.0
    assert left[0] < 0.1 * ROBOT.v_max_mps


@pytest.fixture
def hall():
    """10 x 10 m without anything in it."""
    occupied = np.zeros((100, 100), np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    return Rooms(occupied, ROBOT, CELL_M * distance_transform_edt(~occupied))


@pytest.mark.parametrize(
    ("command", "goal", "outcome"),
    [
        ((1.0, 0.0), (5.0, 2.0), "success"),
        ((1.0, 0.0), (5.0, 8.0), "static_collision"),
        ((0.0, 0.0), (5.0, 2.0), "timeout"),
    ],
)
def test_drive_ends_at_goal_wall_or_limit(hall, command, goal, outcome):
    task = ToyTask((2.0, 2.0, 0.0), np.array(goal), np.zeros((100, 100)))
    ended, records = drive(hall, task, lambda *_: command, time_limit_s=12.0)
    assert ended == outcome
    image, start_goal, action, pose = records[0]
    assert image.shape == (8, 10, 3)
    assert start_goal == pytest.approx((goal[0] - 2.0, goal[1] - 2.0))
    assert pose == (2.0, 2.0, 0.0, 0.0)
    assert action[0] == pytest.approx(min(command[0], ROBOT.a_max_mps2 * 0.05))


def test_recorded_episodes_can_be_trained_on_and_have_no_humans(rooms):
    (episode,) = read_episodes(record(rooms, 1, seed=0), with_humans=True)
    assert episode.static
    assert episode.risks is None
    assert not episode.humans.any()
