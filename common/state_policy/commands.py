"""The commands of a state policy over one episode: the best one, or the best that moves where the robot stands still.

Where a policy is unsure which way to go, its best command can be to wait, or to turn back and forth. Then nothing that
it is told changes, and it stays there until the time is up. During training commands are drawn from its distribution,
which ends that after a moment.
"""

import math

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.episode.loop import Command
from readygo.common.state_policy.state_policy import StatePolicy

STAND_S = 4.0
"""Time within `STAND_M` after which the robot has to move if no person is tracked [s]; turning around takes less."""
WAIT_S = 10.0
"""The same if a person is tracked [s]: waiting is right, but what is tracked may be no person."""
STAND_M = 0.3
"""The robot has to move until it is farther than this from where it stood [m]."""


class StateCommands:
    """Decides over one episode; remembers where the robot has been standing."""

    def __init__(self, policy: StatePolicy) -> None:
        """Begin."""
        self._policy = policy
        self._xy_m = (math.inf, math.inf)
        self._since_s = 0.0

    def decide(self, told: Float32Array, time_s: float, xy_m: tuple[float, float], *, alone: bool) -> Command:
        """The command now: v [m/s], w [rad/s].

        Args:
            told: What the policy is told, shape (1, told_count).
            time_s: Time since the episode began [s].
            xy_m: Position of the robot [m].
            alone: True if no person is tracked.
        """
        if math.dist(xy_m, self._xy_m) > STAND_M:
            self._xy_m, self._since_s = xy_m, time_s
        commands, scores = self._policy.commands, self._policy.logits(told)[0]
        if time_s - self._since_s >= (STAND_S if alone else WAIT_S):
            scores = np.where(commands[:, 0] == 0.0, -np.inf, scores)
        v, w = commands[scores.argmax()].tolist()
        return v, w
