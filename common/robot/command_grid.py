"""A grid of commands that a policy weighs against each other."""

import numpy as np
import numpy.typing as npt

SPEED_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Speeds of the grid, in units of the robot's largest one."""
TURN_SHARES = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
"""Yaw rates of the grid, in units of the robot's largest one."""
OBSTACLE, HUMAN, UNKNOWN_RISK = 1, 2, 255
"""What a command may lead to: a collision with an obstacle, or with a human; 0 is neither. Or nobody looked."""
COMMAND_COUNT = len(SPEED_SHARES) * len(TURN_SHARES)


def command_grid() -> npt.NDArray[np.float64]:
    """All commands, by speed and within a speed by yaw rate.

    Returns:
        Shares of the robot's largest speed (0..1) and yaw rate (-1..1), shape (COMMAND_COUNT, 2).
    """
    speeds, turns = np.meshgrid(SPEED_SHARES, TURN_SHARES, indexing="ij")
    return np.stack([speeds.ravel(), turns.ravel()], axis=1)


def mirrored() -> npt.NDArray[np.int64]:
    """Number of the command that is each one's mirror image, left for right, shape (COMMAND_COUNT,)."""
    numbers = np.arange(COMMAND_COUNT).reshape(len(SPEED_SHARES), len(TURN_SHARES))
    return numbers[:, ::-1].ravel()
