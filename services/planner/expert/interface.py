"""What an expert is: it looks at an episode step by step and decides on commands."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar, FootprintModel
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.messages import EpisodeMotions, HumanMotion, Scenario
from readygo.services.planner.expert.perception import PerceivedHuman


class HumanBody(NamedTuple):
    """A human of an episode, for those who look at more than its place."""

    human: HumanMotion
    avatar: Avatar
    footprint: FootprintModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """What the expert does in one step, and why."""

    v_mps: float
    w_radps: float
    replanned: bool
    """True if a search ran at this step."""
    cost: float
    """Cost of the plan in force; 0 without a plan."""
    visible: bool
    """True if a human is in view."""
    commands: Float64Array
    """This command and those that the plan in force has for the next steps: v [m/s], w [rad/s], shape (N, 2); only
    this one where no plan has times. A view: copy it to keep it."""
    path_xy_m: Float64Array
    """What is left of the path in force [m], shape (N, 2); empty without a plan. A view: copy it to keep it."""
    perceived: tuple[PerceivedHuman, ...]
    """The humans that the expert knows of."""


class Expert(Protocol):
    """Drives one episode."""

    @property
    def replan_times_s(self) -> Sequence[float]:
        """CPU time of each replan so far [s]."""
        ...

    def act(self, simulation: EpisodeSimulation) -> Decision:
        """Decide on the next command, wherever the robot is; call it at every step. Asked again, it says the same."""
        ...

    def watch(self, simulation: EpisodeSimulation) -> bool:
        """Look without deciding, at a step at which `act` is not called; True if a human is in view."""
        ...


class ExpertDriver:
    """Drives by an expert: it knows the map, and of humans what its settings let it."""

    looks = False

    def __init__(self, make_expert: Callable[[Scenario, EpisodeMotions], Expert]) -> None:
        """Prepare to drive.

        Args:
            make_expert: Makes the expert of an episode.
        """
        self._make_expert = make_expert

    def start(self, simulation: EpisodeSimulation) -> Expert:
        """An expert for the episode."""
        return self._make_expert(simulation.scenario, simulation.motions)

    def act(self, running: Sequence[tuple[EpisodeSimulation, Expert]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        decisions = [expert.act(simulation) for simulation, expert in running]
        return [(decision.v_mps, decision.w_radps) for decision in decisions]


def expected_array(humans: Sequence[PerceivedHuman], count: int) -> Float64Array:
    """Where humans are expected in the next steps [m], shape (M, count, 2)."""
    expected = np.empty((len(humans), count, 2))
    for m, human in enumerate(humans):
        expected[m] = human.ahead_m[:count]
    return expected
