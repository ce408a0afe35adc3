"""The commands of a state policy over an episode: the best one, or the best that moves where the robot stands still.

Where a policy is unsure which way to go, its best command can be to wait, or to turn back and forth. Then nothing that
it is told changes, and it stays there until the time is up. During training commands are drawn from its distribution,
which ends that after a moment.
"""

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.state_policy.state_policy import StatePolicy

STAND_S = 4.0
"""Time within `STAND_M` after which the robot has to move if no person is tracked [s]; turning around takes less."""
WAIT_S = 10.0
"""The same if a person is tracked [s]: waiting is right, but what is tracked may be no person."""
STAND_M = 0.3
"""The robot has to move until it is farther than this from where it stood [m]."""


class StateCommands:
    """Decides for some robots, each over one episode; remembers where they have been standing."""

    def __init__(self, policy: StatePolicy, count: int = 1) -> None:
        """Begin.

        Args:
            policy: Decides.
            count: Number of robots N.
        """
        self._policy = policy
        self._xy_m, self._since_s = np.full((count, 2), np.inf), np.zeros(count)

    def decide(self, told: Float32Array, time_s: Float64Array, xy_m: Float64Array, alone: BoolArray) -> Float64Array:
        """The commands now: v [m/s], w [rad/s], shape (N, 2).

        Args:
            told: What the policy is told, shape (N, told_count).
            time_s: Time since the robots' episodes began [s], shape (N,).
            xy_m: Positions of the robots [m], shape (N, 2).
            alone: True where no person is tracked, shape (N,).
        """
        moved = np.hypot(*(xy_m - self._xy_m).T) > STAND_M
        self._xy_m[moved], self._since_s[moved] = xy_m[moved], time_s[moved]
        stands = time_s - self._since_s >= np.where(alone, STAND_S, WAIT_S)
        commands, scores = self._policy.commands, self._policy.logits(told)
        scores = np.where(stands[:, None] & (commands[:, 0] == 0.0), -np.inf, scores)
        chosen: Float64Array = commands[scores.argmax(axis=1)]
        return chosen
