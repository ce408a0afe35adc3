"""Methods that need nothing but the episode, and how methods are named."""

from collections.abc import Sequence

from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.episode.straight_line import straight_line_command

POLICY, EXPERT, STRAIGHT_LINE = "policy", "expert", "straight-line"
"""Names of methods: the policy at hand; the planner that recorded its data and knows the map; a blind one."""


def short_name(method: str) -> str:
    """What tables call a method: a user's own by its class."""
    return method.rpartition(":")[2]


class StraightLineDriver:
    """Turns to the goal and drives straight at it."""

    looks = False

    def start(self, simulation: EpisodeSimulation) -> None:
        """See `Driver.start`; keeps no state."""

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        return [straight_line_command(simulation.goal_xy_robot_m, simulation.robot) for simulation, _ in running]
