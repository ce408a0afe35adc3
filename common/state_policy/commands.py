"""The commands of a state policy over an episode: the best one, or the best that moves where the robot stands still."""

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.robot.standing import STAND_S, WAIT_S, Standing
from readygo.common.state_policy.state_policy import StatePolicy


class StateCommands:
    """Decides for some robots, each over one episode."""

    def __init__(self, policy: StatePolicy, count: int = 1) -> None:
        """Begin.

        Args:
            policy: Decides.
            count: Number of robots N.
        """
        self._policy, self._standing = policy, Standing(count)

    def decide(self, told: Float32Array, time_s: Float64Array, xy_m: Float64Array, alone: BoolArray) -> Float64Array:
        """The commands now: v [m/s], w [rad/s], shape (N, 2).

        Args:
            told: What the policy is told, shape (N, told_count).
            time_s: Time since the robots' episodes began [s], shape (N,).
            xy_m: Positions of the robots [m], shape (N, 2).
            alone: True where no person is tracked, shape (N,).
        """
        stands = self._standing.seconds(time_s, xy_m) >= np.where(alone, STAND_S, WAIT_S)
        commands, scores = self._policy.commands, self._policy.logits(told)
        scores = np.where(stands[:, None] & (commands[:, 0] == 0.0), -np.inf, scores)
        chosen: Float64Array = commands[scores.argmax(axis=1)]
        return chosen
