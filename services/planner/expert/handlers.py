"""Answers requests for the expert's runs (stage 3)."""

from collections.abc import Callable, Mapping, Sequence

from readygo.common.avatars import Avatar, FootprintModel
from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.loop import Observer, run_episode
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import AvatarError, ConfigError
from readygo.common.messages import (
    EpisodeKey,
    EpisodeMotions,
    Outcome,
    RobotPlanReply,
    RobotPlanRequest,
    RobotTrajectory,
    Scenario,
)
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.config import GOAL_TOLERANCE_M, ExpertConfig
from readygo.services.planner.expert.ground import EpisodeGround, SceneGround
from readygo.services.planner.expert.hybrid_astar import HybridAStar
from readygo.services.planner.expert.interface import Decision, Expert, ExpertDriver, HumanBody
from readygo.services.planner.expert.paper import PaperExpert
from readygo.services.planner.expert.perceiving import TrackedExpert
from readygo.services.planner.expert.spacetime import SpaceTimeExpert, horizon_s
from readygo.services.planner.expert.spacetime_search import SpaceTimeSearch
from readygo.services.planner.expert.tracked import TrackedHumans
from readygo.services.planner.scene_maps import PlanningMaps


class RobotPlanner:
    """Drives the expert in one scene; what does not depend on the episode is computed once. Not thread-safe."""

    def __init__(
        self,
        maps: PlanningMaps,
        avatars: Mapping[str, Avatar],
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        config: ExpertConfig,
    ) -> None:
        """Prepare a scene.

        Args:
            maps: The scene's maps.
            avatars: Avatars by name, for experts that look at bodies (`ExpertConfig.needs_avatars`); others need none.
            robot: Footprint, limits and camera.
            episode_config: Task and judging.
            config: How the expert drives.
        """
        self.maps, self.robot, self.episode_config, self.config = maps, robot, episode_config, config
        self._latest: RobotPlanner | None = None
        sight = maps.sight if config.needs_line_of_sight else None
        self.ground = SceneGround(maps.robot, maps.human, sight, robot, episode_config, config)
        self._search = expert_search(self.ground)
        self._avatars = dict(avatars)
        self._footprints: dict[str, FootprintModel] = {}

    def body(self, name: str) -> tuple[Avatar, FootprintModel]:
        """An avatar and its footprint model.

        Raises:
            AvatarError: If there is no such avatar.
        """
        if name not in self._avatars:
            loaded = ", ".join(sorted(self._avatars)) or "none"
            raise AvatarError(f"Avatar {name!r} is not loaded; loaded: {loaded}.")
        if name not in self._footprints:
            self._footprints[name] = FootprintModel.from_avatar(self._avatars[name])
        return self._avatars[name], self._footprints[name]

    def of(self, episode: EpisodeKey) -> "RobotPlanner":
        """The planner for the robot of an episode: this one, unless that differs from episode to episode."""
        robot = robot_of_episode(self.robot, episode)
        if robot is self.robot:
            return self
        if self._latest is None or self._latest.robot != robot:
            self._latest = RobotPlanner(self.maps, self._avatars, robot, self.episode_config, self.config)
        return self._latest

    def expert(self, scenario: Scenario, motions: EpisodeMotions) -> Expert:
        """An expert for one episode, and its robot.

        Raises:
            AvatarError: If it looks at bodies and a human's avatar is not loaded.
        """
        return self.of(scenario.episode)._expert(scenario, motions)

    def tracked_expert(self, scenario: Scenario, *, velocities: bool = False) -> tuple[SpaceTimeExpert, TrackedHumans]:
        """An expert for one episode that knows of people what it is told by tracks, and these tracks.

        Args:
            scenario: Of the episode.
            velocities: As for `PeopleTracker`.

        Raises:
            ConfigError: If the expert's mode is "paper": its search takes bodies.
        """
        return self.of(scenario.episode)._tracked_expert(scenario, velocities)

    def detecting_expert(self, scenario: Scenario, noise: PerceptionNoise) -> TrackedExpert:
        """An expert for one episode that knows people by tracks of simulated detections.

        Args:
            scenario: Of the episode.
            noise: How detections err.

        Raises:
            ConfigError: As for `tracked_expert`.
        """
        expert, people = self.tracked_expert(scenario, velocities=noise.measures_velocity)
        robot = robot_of_episode(self.robot, scenario.episode)
        return TrackedExpert(expert, people, scenario.episode, robot, noise)

    def _tracked_expert(self, scenario: Scenario, velocities: bool) -> tuple[SpaceTimeExpert, TrackedHumans]:
        if isinstance(self._search, HybridAStar):
            raise ConfigError('People are tracked for experts of mode "spacetime"; set mode under [expert].')
        made: list[TrackedHumans] = []

        def find_people(local: EpisodeGround, count: int) -> TrackedHumans:
            made.append(TrackedHumans(self.ground, local, count, velocities=velocities))
            return made[0]

        nobody = EpisodeMotions(humans=())
        return SpaceTimeExpert(self.ground, self._search, scenario, nobody, find_people), made[0]

    def _expert(self, scenario: Scenario, motions: EpisodeMotions) -> Expert:
        if isinstance(self._search, HybridAStar):
            bodies = [HumanBody(human, *self.body(human.avatar)) for human in motions.humans]
            return PaperExpert(self.ground, self._search, scenario, bodies)
        return SpaceTimeExpert(self.ground, self._search, scenario, motions)

    def simulation(self, scenario: Scenario, motions: EpisodeMotions) -> EpisodeSimulation:
        """The closed loop of one episode, at its start."""
        robot = robot_of_episode(self.robot, scenario.episode)
        return EpisodeSimulation(scenario, motions, self.maps.robot, robot, self.episode_config)


def expert_search(ground: SceneGround) -> HybridAStar | SpaceTimeSearch:
    """The search of the configured mode, with its working memory."""
    config, robot = ground.config, ground.robot
    if config.mode == "paper":
        return HybridAStar(robot)
    # Arriving means to come within the circle of success; a human who stands nearer to the goal does not matter.
    tolerance_m = max(GOAL_TOLERANCE_M, ground.success_radius_m - 0.2)
    return SpaceTimeSearch(robot, horizon_s=horizon_s(config), goal_tolerance_m=tolerance_m)


def handle_robot_plan(planner: RobotPlanner, request: RobotPlanRequest) -> RobotPlanReply:
    """Drive the expert through a scenario; a run that does not succeed is rejected with its outcome."""
    trajectory = drive(planner, request.scenario, request.motions)
    success = trajectory.outcome is Outcome.SUCCESS
    return RobotPlanReply(
        episode=request.scenario.episode,
        trajectory=trajectory,
        rejected="" if success else trajectory.outcome.value,
    )


class DecisionLog(Observer):
    """What an expert decides at every step of an episode."""

    def __init__(self, expert: Expert) -> None:
        """Prepare an episode.

        Args:
            expert: Of the episode.
        """
        self.expert = expert
        self.decisions: list[Decision] = []
        """One per step so far."""

    def step(self, simulation: EpisodeSimulation) -> None:
        """Ask the expert."""
        self.decisions.append(self.expert.act(simulation))

    def trajectory(self, simulation: EpisodeSimulation) -> RobotTrajectory:
        """The run, once it has ended, with what the expert decided."""
        return simulation.trajectory(
            human_visible=[decision.visible for decision in self.decisions],
            replanned=[decision.replanned for decision in self.decisions],
            expert_cost=[decision.cost for decision in self.decisions],
            replan_times_s=self.expert.replan_times_s,
        )


def drive(
    planner: RobotPlanner,
    scenario: Scenario,
    motions: EpisodeMotions,
    observe: Callable[[Expert], Sequence[Observer]] = lambda _: (),
) -> RobotTrajectory:
    """Drive the expert from start to end.

    Args:
        planner: Makes simulation and expert.
        scenario: Start, goal and humans.
        motions: How the humans move.
        observe: Makes observers besides, of the expert.
    """
    simulation, expert = planner.simulation(scenario, motions), planner.expert(scenario, motions)
    log = DecisionLog(expert)
    run_episode(simulation, ExpertDriver(lambda *_: expert), [log, *observe(expert)])
    return log.trajectory(simulation)
