import dataclasses
import math

import numpy as np
import pytest

from readygo.services.evaluator.network_driver import NetworkDriver, NetworkState, steer
from tests.services.evaluator.baselines.driving import drive
from tests.services.evaluator.conftest import ROBOT

torch = pytest.importorskip("torch", reason="torch is not installed")


def test_controller_reaches_the_waypoint_in_a_quarter_second():
    assert steer((0.2, 0.0), ROBOT) == (pytest.approx(0.8), 0.0)
    v, w = steer((0.2, 0.02), ROBOT)
    assert (v, w) == (pytest.approx(0.8), pytest.approx(4 * math.atan(0.1)))
    assert steer((9.0, -9.0), ROBOT) == (ROBOT.v_max_mps, -ROBOT.w_max_radps)


def test_waypoint_beside_or_behind_or_nowhere_turns_the_robot():
    assert steer((0.0, 0.1), ROBOT) == (0.0, ROBOT.w_max_radps)
    assert steer((-0.2, 0.01), ROBOT)[0] == 0.0
    assert steer((0.0, 0.0, math.cos(-0.1), math.sin(-0.1)), ROBOT) == (0.0, pytest.approx(-0.4))


class Ahead:
    """A network that goes straight on, and notes what it sees."""

    frames, width_px, height_px = 3, 8, 6

    def __init__(self):
        self.seen = []

    def waypoints(self, images, goal, generator):
        self.seen.append((images[0, :, 0, 0, 0].clone(), goal[0, 0, 0, 0].clone()))
        return torch.tensor([[[0.2, 0.0], [0.5, 0.0], [0.8, 0.0]]])


class Eyes:
    def look(self, simulations):
        return np.array([np.full((6, 16, 3), simulation.step, np.uint8) for simulation in simulations])

    def goal_image(self, simulation):
        return np.full((6, 16, 3), 200, np.uint8)


def test_network_looks_four_times_a_second_at_the_latest_images_and_the_goal():
    network, eyes = Ahead(), Eyes()
    simulation, _ = drive(NetworkDriver(network, eyes), (1.0, 1.0, 0.0), (4.0, 1.0))
    steps = [(torch.round(frames * 0.229 * 255 + 0.485 * 255)).int().tolist() for frames, _ in network.seen]
    assert steps[:4] == [[0, 0, 0], [0, 0, 5], [0, 5, 10], [5, 10, 15]]
    assert network.seen[0][1].item() == pytest.approx((200 / 255 - 0.485) / 0.229, abs=1e-4)
    # The third waypoint, 0.8 units of 0.25 m, in 0.25 s.
    assert simulation.v_mps == pytest.approx(0.8)


def test_places_are_in_units_of_the_way_of_a_quarter_second_at_full_speed():
    class Left(Ahead):
        def waypoints(self, images, goal, generator):
            return torch.tensor([[[9.0, 9.0], [9.0, 9.0], [0.6, 0.05]]])

    robot = dataclasses.replace(ROBOT, v_max_mps=0.85, w_max_radps=0.95)
    driver = NetworkDriver(Left(), Eyes())
    state = NetworkState(goal=torch.zeros(3, 6, 8), generator=None)
    driver._decide(state, np.zeros((6, 16, 3), np.uint8), robot)
    assert state.command == pytest.approx((0.6 * 0.85, 4 * math.atan(0.05 / 0.6)))


def test_heading_counts_where_the_robot_is_already():
    robot = dataclasses.replace(ROBOT, w_max_radps=9.0)
    assert steer((0.0, 0.0, math.cos(0.3), math.sin(0.3)), robot) == (0.0, pytest.approx(1.2))
    assert steer((0.0, -0.1, 1.0, 0.0), robot) == (0.0, pytest.approx(-4 * math.pi / 2))
    v, w = steer((-0.1, 0.1), robot)
    assert (v, w) == (0.0, pytest.approx(-math.pi))
