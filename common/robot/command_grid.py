"""A grid of commands that a policy weighs against each other: which it is follows from the robot.

Shards and policies name their robot, and so their grid; that of a robot that does not reverse has no command backwards.
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.robot.config import RobotConfig

SPEED_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Speeds of the grid, in units of the robot's largest one; one that reverses has further ones below, as far apart."""
TURN_SHARES = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Yaw rates of the grid, in units of the robot's largest one."""
OBSTACLE, HUMAN, UNKNOWN_RISK = 1, 2, 255
"""What a command may lead to: a collision with an obstacle, or with a human; 0 is neither. 255: not computed."""
COMMAND_COUNT = len(SPEED_SHARES) * len(TURN_SHARES)
"""Commands of a robot that does not reverse."""


def backward_rows(robot: RobotConfig, speed_count: int) -> int:
    """Speeds backwards that a grid has besides `speed_count` from rest to full speed: the last one reaches v_min."""
    return math.ceil(-robot.v_min_mps / robot.v_max_mps * (speed_count - 1) - 1e-9)


def speed_shares(robot: RobotConfig) -> tuple[float, ...]:
    """Speeds of a robot's grid, in units of its largest one, rising; the lowest may be a little below v_min."""
    step = SPEED_SHARES[1]
    return (*(-step * k for k in range(backward_rows(robot, len(SPEED_SHARES)), 0, -1)), *SPEED_SHARES)


def command_grid(robot: RobotConfig | None = None) -> Float64Array:
    """All commands, by speed and within a speed by yaw rate.

    Args:
        robot: Whose commands; a robot that does not reverse by default.

    Returns:
        Shares of the robot's largest speed (up to 1, negative backwards) and yaw rate (-1..1), shape (C, 2);
        `COMMAND_COUNT` rows for a robot that does not reverse.
    """
    speeds, turns = np.meshgrid(speed_shares(robot) if robot else SPEED_SHARES, TURN_SHARES, indexing="ij")
    return np.stack([speeds.ravel(), turns.ravel()], axis=1)


def mirror_indices(robot: RobotConfig | None = None) -> Int64Array:
    """Number of the command of a robot's grid that is each one's mirror image, left for right, shape (C,)."""
    count = len(command_grid(robot))
    return np.arange(count).reshape(-1, len(TURN_SHARES))[:, ::-1].ravel()
