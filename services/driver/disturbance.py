"""An expert that is pushed and obeyed late: its robot comes to states from which it must find back."""

import math
from collections.abc import Sequence

import numpy as np

from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages import EpisodeKey
from readygo.common.robot import RobotConfig

PUSH = 0.5
"""Standard deviation of the pushes, as a multiple of the largest changes of speed and yaw rate that the robot can make:
it cannot resist what is above 1. Measured, as `LATE_MAX_S`, in docs/results/driver.md."""
PUSH_TIME_S = 0.5
"""Correlation time of the pushes, an Ornstein-Uhlenbeck process [s]."""
LATE_MAX_S = 0.3
"""The robot does now what the expert planned for now this long ago at most; drawn per episode [s]."""


class Disturbance:
    """What comes between the expert and the robot in one episode; the same numbers for the same episode."""

    def __init__(
        self,
        episode: EpisodeKey,
        robot: RobotConfig,
        *,
        push: float = PUSH,
        push_time_s: float = PUSH_TIME_S,
        late_max_s: float = LATE_MAX_S,
    ) -> None:
        """Draw how late the commands are.

        Args:
            episode: Its stream is drawn from.
            robot: Whose limits pushes are measured by.
            push: Standard deviation of the pushes, see `PUSH`.
            push_time_s: Their correlation time [s].
            late_max_s: Largest delay of commands [s].
        """
        self._rng = _rng(episode)
        # The draw of `disturbs`.
        self._rng.random()
        clock = robot.clock
        self._late_steps = int(self._rng.integers(0, clock.steps(late_max_s) + 1))
        self._keep = math.exp(-clock.dt_s / push_time_s)
        self._noise = push * math.sqrt(1.0 - self._keep * self._keep)
        self._change = robot.a_max_mps2 * clock.dt_s, robot.alpha_max_radps2 * clock.dt_s
        self._push = (0.0, 0.0)

    def command(self, would: Sequence[Sequence[tuple[float, float]]], held_steps: int = 1) -> tuple[float, float]:
        """What reaches the robot: v [m/s], w [rad/s] for the next step, pushes included.

        Args:
            would: At every step so far, what the expert wanted from there on: v [m/s], w [rad/s] over every step.
            held_steps: Steps during which the robot holds a command.
        """
        late = min(self._late_steps, len(would) - 1)
        planned = would[-1 - late]
        v, w = planned[min(late + held_steps, len(planned)) - 1]
        push_v, push_w = (self._keep * push + self._noise * self._rng.standard_normal() for push in self._push)
        self._push = push_v, push_w
        return v + push_v * self._change[0], w + push_w * self._change[1]


def disturbs(episode: EpisodeKey, share: float) -> bool:
    """True in a `share` of the episodes, drawn from a dedicated random stream."""
    return bool(_rng(episode).random() < share)


def _rng(episode: EpisodeKey) -> np.random.Generator:
    return episode_rng(episode, Purpose.DISTURBANCE)
