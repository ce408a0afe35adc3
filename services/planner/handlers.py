"""Answers planning requests: scenarios (stage 1) and expert runs (stage 3)."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Protocol

from readygo.common.avatars import Avatar, FootprintModel
from readygo.common.episode import EpisodeConfig, EpisodeSimulation, Purpose, episode_rng
from readygo.common.errors import AvatarError
from readygo.common.maps import FloorMap, OccupancyMap, SightMap
from readygo.common.messages import (
    EpisodeMotions,
    HumanPlanReply,
    HumanPlanRequest,
    Outcome,
    RobotPlanReply,
    RobotPlanRequest,
    RobotTrajectory,
    Scenario,
)
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ
from readygo.services.planner.config import HumanPlannerConfig
from readygo.services.planner.expert.config import ExpertConfig
from readygo.services.planner.expert.ground import ExpertGround
from readygo.services.planner.expert.hybrid_astar import HybridAStar
from readygo.services.planner.expert.interface import Decision, Expert
from readygo.services.planner.expert.paper import PaperExpert
from readygo.services.planner.expert.spacetime import SpaceTimeExpert
from readygo.services.planner.expert.spacetime_search import SpaceTimeSearch
from readygo.services.planner.humans.human import without_slopes
from readygo.services.planner.humans.reactive import ReactivePeople, ReactiveSimulation, reacted
from readygo.services.planner.humans.scenario import IN_THE_WAY, RejectedError, ScenarioSampler
from readygo.services.planner.humans.scenario_file import ScenarioFile
from readygo.services.planner.humans.scripted import Script, ScriptMaps
from readygo.services.planner.humans.walk import nearest_m


class SceneMaps(Protocol):
    """The maps of a scene that planning needs."""

    @property
    def robot(self) -> OccupancyMap:
        """What blocks the robot."""
        ...

    @property
    def human(self) -> OccupancyMap:
        """What blocks a human."""
        ...

    @property
    def floor(self) -> FloorMap:
        """Height of the floor."""
        ...

    @property
    def sight(self) -> SightMap:
        """What hides people from a camera; dear to make, so only asked for where it is needed."""
        ...


class Planner:
    """Plans episodes in one scene; what does not depend on the episode is computed once. Not thread-safe."""

    def __init__(
        self,
        maps: SceneMaps,
        avatars: Mapping[str, Avatar],
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        human_config: HumanPlannerConfig,
        expert_config: ExpertConfig,
        scenarios: ScenarioFile | None = None,
    ) -> None:
        """Prepare a scene.

        Args:
            maps: The scene's maps.
            avatars: Avatars by name; may be empty if there are no humans.
            robot: Footprint and limits.
            episode_config: Task and judging.
            human_config: How scenarios are drawn.
            expert_config: How the expert drives.
            scenarios: Is played instead of drawing.

        Raises:
            SceneError: If the robot has no free space.
            ConfigError: If a scenario of the file cannot take place here.
        """
        self.maps, self.robot, self.episode_config = maps, robot, episode_config
        self.avatar_names = sorted(avatars)
        self.human_config = human_config
        self.human_map = without_slopes(maps.human, maps.floor, human_config.slope_max)
        self.sampler = ScenarioSampler(
            maps.robot,
            self.human_map,
            robot,
            episode_config,
            human_config,
            expert_config.cell_margin_m,
            find_sight=lambda: maps.sight,
        )
        self.script = None
        if scenarios is not None:
            places = ScriptMaps(robot_map=maps.robot, human_map=maps.human, paths=self.sampler.site.paths)
            self.script = Script(scenarios, places, robot, episode_config, human_config, self.avatar_names)
        sight = maps.sight if expert_config.needs_line_of_sight else None
        self.ground = ExpertGround(maps.robot, maps.human, sight, robot, episode_config, expert_config)
        self._search = expert_search(self.ground)
        self._avatars = dict(avatars)
        self._footprints: dict[str, FootprintModel] = {}

    def footprint(self, name: str) -> tuple[Avatar, FootprintModel]:
        """An avatar and its footprint model.

        Raises:
            AvatarError: If there is no such avatar.
        """
        if name not in self._avatars:
            raise AvatarError(f"Avatar {name!r} is not loaded; loaded: {', '.join(self.avatar_names) or 'none'}.")
        if name not in self._footprints:
            self._footprints[name] = FootprintModel.from_avatar(self._avatars[name])
        return self._avatars[name], self._footprints[name]

    def expert(self, scenario: Scenario, motions: EpisodeMotions) -> Expert:
        """An expert for one episode.

        Raises:
            AvatarError: If a human's avatar is not loaded.
        """
        people = [(human, *self.footprint(human.avatar)) for human in motions.humans]
        if isinstance(self._search, HybridAStar):
            return PaperExpert(self.ground, self._search, scenario, people)
        return SpaceTimeExpert(self.ground, self._search, scenario, people)

    def simulation(self, scenario: Scenario, motions: EpisodeMotions) -> EpisodeSimulation:
        """The closed loop of one episode, at its start."""
        return EpisodeSimulation(scenario, motions, self.maps.robot, self.robot, self.episode_config)


def expert_search(ground: ExpertGround) -> HybridAStar | SpaceTimeSearch:
    """The search of the configured mode, with its working memory."""
    config, robot = ground.config, ground.robot
    if config.mode == "paper":
        return HybridAStar(robot, config)
    # Arriving means to come within the circle of success; a person who stands nearer to the goal does not matter.
    tolerance_m = max(config.goal_tolerance_m, ground.success_radius_m - 0.2)
    return SpaceTimeSearch(robot, config, tolerance_m)


def handle_human_plan(planner: Planner, request: HumanPlanRequest) -> HumanPlanReply:
    """Draw the scenario of an episode, or play the file's; what cannot take place is rejected with a short reason."""
    rng = episode_rng(request.episode, Purpose.SCENARIO)
    try:
        if planner.script is None:
            scenario = planner.sampler.draw(request.episode, rng, planner.avatar_names, static=request.static)
            reacts = [True] * len(scenario.humans)
        else:
            scenario, reacts = planner.script.scenario(request.episode, static=request.static)
        if planner.human_config.reactive and any(reacts):
            scenario = let_react(planner, scenario, reacts)
    except RejectedError as reason:
        return HumanPlanReply(episode=request.episode, rejected=str(reason))
    return HumanPlanReply(episode=request.episode, scenario=scenario)


def let_react(planner: Planner, scenario: Scenario, reacts: Sequence[bool]) -> Scenario:
    """The scenario as its people walk it who see the expert drive; when it has ended they go on alone.

    Args:
        planner: Maps, robot and expert.
        scenario: With drawn trajectories.
        reacts: Who yields, by the order of the humans; the others keep to their trajectories.

    Raises:
        RejectedError: If people run into each other.
    """
    config = planner.episode_config
    contact_m = planner.robot.radius_m + config.human_radius_m
    drawn = [human.xy_m for human in scenario.humans]
    people = ReactivePeople(drawn, reacts, planner.human_map, contact_m, config, planner.human_config)
    simulation = ReactiveSimulation(scenario, people, planner.maps.robot, planner.robot, config)
    for _ in decisions(planner.expert(scenario, simulation.motions), simulation):
        pass
    while not people.at_rest and len(people.xy_m) < round(config.time_limit_s * RATE_HZ):
        people.advance(None)
    walked = reacted(scenario, people)
    for a, b in itertools.combinations(walked.humans, 2):
        if nearest_m(a.xy_m, b.xy_m) < 2 * config.human_radius_m - 0.05:
            raise RejectedError(IN_THE_WAY)
    return walked


def handle_robot_plan(planner: Planner, request: RobotPlanRequest) -> RobotPlanReply:
    """Drive the expert through a scenario; a run that does not succeed is rejected with its outcome."""
    trajectory = drive(planner, request.scenario, request.motions)
    success = trajectory.outcome is Outcome.SUCCESS
    return RobotPlanReply(
        episode=request.scenario.episode,
        trajectory=trajectory,
        rejected="" if success else trajectory.outcome.value,
    )


def drive(
    planner: Planner,
    scenario: Scenario,
    motions: EpisodeMotions,
    *,
    observe: Callable[[Decision], None] = lambda _: None,
) -> RobotTrajectory:
    """The expert's closed loop, from start to end; `observe` is told of every decision before it is executed."""
    simulation = planner.simulation(scenario, motions)
    expert = planner.expert(scenario, motions)
    made = []
    for decision in decisions(expert, simulation):
        made.append(decision)
        observe(decision)
    return simulation.trajectory(
        human_visible=[decision.visible for decision in made],
        replanned=[decision.replanned for decision in made],
        expert_cost=[decision.cost for decision in made],
        replan_times_s=expert.replan_times_s,
    )


def decisions(expert: Expert, simulation: EpisodeSimulation) -> Iterator[Decision]:
    """What the expert decides until the episode ends; each decision is executed when the next one is asked for."""
    while simulation.outcome is None:
        decision = expert.act(simulation)
        yield decision
        simulation.advance(decision.v_mps, decision.w_radps)
