"""Perceive, track, act: a state policy drives on the map that it knows, among the people that the camera shows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure
from readygo.common.perception import PeopleTracker, Perception
from readygo.common.perception.episode import EpisodePerception, OnLook, SteppedTracker, perceive_step
from readygo.common.policy.driver import PolicyCamera
from readygo.common.state_policy.actor import StateActor
from readygo.common.state_policy.state_policy import StatePolicy
from readygo.common.state_simulation.goal_distances import GoalDistances
from readygo.common.state_simulation.world import StateWorld


@dataclass(eq=False)
class ActingState:
    """What the driver remembers of one episode."""

    perception: EpisodePerception[SteppedTracker]
    actor: StateActor


class PerceivingStateDriver:
    """Drives by images, odometry, map and goal; a state policy decides."""

    looks = True
    on_look: OnLook[SteppedTracker] | None = None
    """Told of every look, for viewers."""

    def __init__(
        self,
        policy: StatePolicy,
        perception: Perception,
        camera: PolicyCamera,
        world: StateWorld,
        distances: GoalDistances,
        make_tracker: Callable[[], PeopleTracker],
    ) -> None:
        """Prepare a scene.

        Args:
            policy: Decides.
            perception: Tells what images show.
            camera: Where its images come from.
            world: Scene, robot and rules, with the policy's observation.
            distances: Of the robot's map.
            make_tracker: Makes the tracker of an episode.
        """
        self._policy, self._perception, self._camera = policy, perception, camera
        self._world, self._distances, self._make_tracker = world, distances, make_tracker

    def start(self, simulation: EpisodeSimulation) -> ActingState:
        """See `Driver.start`."""
        goal = simulation.scenario.goal_xy_m.tolist()
        actor = StateActor(self._policy, self._world, self._distances, self._make_tracker(), goal)
        return ActingState(EpisodePerception(self._perception, actor.people, simulation.robot), actor)

    def act(self, running: Sequence[tuple[EpisodeSimulation, ActingState]]) -> list[Command | DriverFailure]:
        """See `Driver.act`."""
        looked = perceive_step(self._camera, [(simulation, state.perception) for simulation, state in running])
        if self.on_look is not None:
            for simulation, perception, image in looked:
                self.on_look(simulation, perception, image)
        return [state.actor.act(simulation) for simulation, state in running]
