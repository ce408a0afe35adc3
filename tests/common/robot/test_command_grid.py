"""The grid of commands."""

import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import COMMAND_COUNT, command_grid, mirror_indices, speed_shares


def test_grid_holds_every_pair_of_speed_and_turn_once():
    grid = command_grid()
    assert grid.shape == (COMMAND_COUNT, 2)
    assert len(np.unique(grid, axis=0)) == COMMAND_COUNT
    assert grid[:, 0].min() == 0
    assert grid[:, 1].min() == -1
    assert grid.max(axis=0).tolist() == [1, 1]


def test_mirror_image_turns_the_other_way_at_the_same_speed():
    grid = command_grid()
    np.testing.assert_array_equal(grid[mirror_indices()], grid * [1, -1])


def test_grid_of_a_robot_that_reverses_has_further_speeds_as_far_apart() -> None:
    robot = RobotConfig(v_max_mps=0.8, v_min_mps=-0.3)
    assert speed_shares(robot) == (-0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
    grid = command_grid(robot)
    assert grid.shape == (63, 2)
    np.testing.assert_array_equal(grid[18:], command_grid())
    np.testing.assert_array_equal(grid[mirror_indices(robot)], grid * [1, -1])


@pytest.mark.parametrize(
    ("v_max_mps", "v_min_mps", "backward"), [(1.0, 0.0, 0), (0.8, -0.2, 1), (0.8, -0.21, 2), (0.9, -0.9, 4)]
)
def test_speeds_backwards_reach_the_lowest_one(v_max_mps: float, v_min_mps: float, backward: int) -> None:
    robot = RobotConfig(v_max_mps=v_max_mps, v_min_mps=v_min_mps)
    shares = speed_shares(robot)
    assert len(shares) == 5 + backward
    np.testing.assert_allclose(np.diff(shares), 0.25)
    assert shares[0] * v_max_mps <= v_min_mps + 1e-12 < (shares[1] if backward else 1.0) * v_max_mps
    grid = command_grid(robot)
    assert grid.tolist() == [[v, w] for v in shares for w in np.linspace(-1, 1, 9)]
