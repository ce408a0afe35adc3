"""A state policy in the expert's place: it labels the states of an episode, and drives where no policy does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.state_policy.state_driver import StateDriver


@dataclass(frozen=True, kw_only=True, eq=False)
class TeacherAdvice:
    """What a teacher would do at a state; see `Advice`."""

    commands: Float64Array
    """Its command, which is held: v [m/s], w [rad/s], shape (1, 2)."""
    visible: bool
    """True if a human is in view."""
    replanned: bool = False
    """It has no plan."""
    cost: float = 0.0


class StateTeacher:
    """A `LabellingExpert` for one episode; it decides at every state at which it is asked, and holds no command.

    Its detections err by the episode's key, as those of `StateDriver`.
    """

    replan_times_s: Sequence[float] = ()

    def __init__(self, driver: StateDriver, simulation: EpisodeSimulation) -> None:
        """Prepare an episode.

        Args:
            driver: Perceives and decides.
            simulation: The episode at its start.
        """
        self._driver, self._episode = driver, driver.start(simulation)
        self._perceived_step = -1

    def act(self, simulation: EpisodeSimulation) -> TeacherAdvice:
        """See `LabellingExpert.act`."""
        visible = self.watch(simulation)
        command = self._driver.decide(simulation, self._episode)
        return TeacherAdvice(commands=np.array([command]), visible=visible)

    def watch(self, simulation: EpisodeSimulation) -> bool:
        """See `LabellingExpert.watch`."""
        if simulation.step != self._perceived_step:
            self._driver.perceive(simulation, self._episode)
            self._perceived_step = simulation.step
        return self._driver.sees_human(simulation)
