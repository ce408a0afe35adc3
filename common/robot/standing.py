"""How long robots have stood: one that stands too long has to move.

Where a policy is unsure which way to go, its best command can be to wait, or to turn back and forth. Then nothing that
it is told changes, and it stays there until the time is up. During training commands are drawn from its distribution,
which ends that after a moment.
"""

import numpy as np

from readygo.common.arrays import Float64Array

STAND_S = 4.0
"""Time within `STAND_M` after which a robot has to move that knows of no person [s]; turning around takes less."""
WAIT_S = 10.0
"""The same if there may be a person [s]: waiting is right, but what is tracked may be no person."""
STAND_M = 0.3
"""The robot has to move until it is farther than this from where it stood [m]."""


class Standing:
    """Remembers where some robots have been standing, each over one episode."""

    def __init__(self, count: int = 1) -> None:
        """Begin.

        Args:
            count: Number of robots N.
        """
        self._xy_m, self._since_s = np.full((count, 2), np.inf), np.zeros(count)

    def seconds(self, time_s: Float64Array, xy_m: Float64Array) -> Float64Array:
        """How long each robot has been within `STAND_M` [s], shape (N,).

        Args:
            time_s: Time of the robots' episodes [s], shape (N,).
            xy_m: Positions of the robots [m], shape (N, 2).
        """
        moved = np.hypot(*(xy_m - self._xy_m).T) > STAND_M
        self._xy_m[moved], self._since_s[moved] = xy_m[moved], time_s[moved]
        stood_s: Float64Array = time_s - self._since_s
        return stood_s
