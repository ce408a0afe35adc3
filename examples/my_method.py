"""A custom method in an evaluation, to compare with the policy and the expert.

    readygo evaluate embedded --methods examples/my_method.py:KeepsAway straight-line social-force --episodes 20

The class is constructed once, with the robot that it drives. `start` returns the memory of an episode; `act` is called
every 0.05 s and gets the same observation as a policy. If the method raises, returns anything but two finite numbers or
takes too long, only that episode fails.
"""

import math

import numpy as np

from readygo import Observation, RobotConfig


class KeepsAway:
    """Steers to the goal, and away from the darker half of the image."""

    trained_on = ""
    """What it has learned from, for the table of `readygo benchmark`: here nothing."""

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot

    def start(self) -> list[float]:
        """The memory of an episode: the latest turn rates, for smoothing."""
        return []

    def act(self, memory: list[float], observation: Observation) -> tuple[float, float]:
        """Speed v [m/s] and turn rate w [rad/s]."""
        left, right = (float(half.mean()) for half in np.array_split(observation.rgb, 2, axis=1))
        to_goal = math.atan2(observation.goal_xy_m[1], observation.goal_xy_m[0])
        memory.append(to_goal + 0.3 * (left - right) / max(left + right, 1.0))
        turn = sum(memory[-5:]) / len(memory[-5:])
        return self._robot.v_max_mps * max(0.0, math.cos(turn)), 2.0 * turn
