"""Answers requests for scenarios (stage 1)."""

import itertools
from collections.abc import Callable, Sequence

from readygo.common.episode import EpisodeConfig, Purpose, episode_rng
from readygo.common.episode.loop import run_episode
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import ConfigError
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanPlanReply, HumanPlanRequest, Scenario
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ
from readygo.services.planner.expert.interface import Expert, ExpertDriver
from readygo.services.planner.humans.config import HumanPlannerConfig
from readygo.services.planner.humans.reactive import ReactiveHumans, ReactiveSimulation, walked_scenario
from readygo.services.planner.humans.sampler import IN_THE_WAY, STANDING, RejectedError, ScenarioSampler
from readygo.services.planner.humans.scenario_file import ScenarioFile
from readygo.services.planner.humans.script import Script, ScriptMaps
from readygo.services.planner.humans.slopes import without_slopes
from readygo.services.planner.humans.timing import nearest_m
from readygo.services.planner.scene_maps import PlanningMaps

MakeExpert = Callable[[Scenario, EpisodeMotions], Expert]
"""An expert for one episode, see `RobotPlanner.expert`."""


class HumanPlanner:
    """Plans scenarios in one scene; what does not depend on the episode is computed once. Not thread-safe."""

    def __init__(
        self,
        maps: PlanningMaps,
        avatar_names: Sequence[str],
        robot: RobotConfig,
        episode_config: EpisodeConfig,
        config: HumanPlannerConfig,
        *,
        scenarios: ScenarioFile | None = None,
        make_expert: MakeExpert | None = None,
    ) -> None:
        """Prepare a scene.

        Args:
            maps: The scene's maps.
            avatar_names: Who may walk; may be empty if there are no humans.
            robot: Footprint and limits.
            episode_config: Task and judging.
            config: How scenarios are drawn.
            scenarios: Is played instead of drawing.
            make_expert: Whom reactive humans yield to; only asked if they do.

        Raises:
            SceneError: If the robot has no free space.
            ConfigError: If a scenario of the file cannot take place here, or reactive humans lack an expert.
        """
        if config.reactive and make_expert is None:
            raise ConfigError("Reactive humans yield to an expert: give the human planner one to drive among them.")
        self.maps, self.robot, self.episode_config, self.config = maps, robot, episode_config, config
        self.avatar_names = sorted(avatar_names)
        self.make_expert = make_expert
        self._scenarios = scenarios
        self.human_map = without_slopes(maps.human, maps.floor, config.slope_max)
        self.sampler = ScenarioSampler(
            maps.robot,
            self.human_map,
            robot,
            episode_config,
            config,
            find_sight=lambda: maps.sight,
        )
        self.script = None
        if scenarios is not None:
            places = ScriptMaps(robot_map=maps.robot, human_map=maps.human, paths=self.sampler.site.paths)
            self.script = Script(scenarios, places, robot, episode_config, self.avatar_names)

    def of(self, episode: EpisodeKey) -> "HumanPlanner":
        """The planner for the robot of an episode: this one, unless that differs from episode to episode."""
        robot = robot_of_episode(self.robot, episode)
        if robot is self.robot:
            return self
        return HumanPlanner(
            self.maps,
            self.avatar_names,
            robot,
            self.episode_config,
            self.config,
            scenarios=self._scenarios,
            make_expert=self.make_expert,
        )

    def reacts(self, scenario: Scenario) -> list[bool]:
        """Who of a scenario's humans yields; the others keep to their trajectories, as a file of scenarios may say.

        Each human is drawn to yield or not, the same one in the same episode for every driver.
        """
        if self.script is None:
            drawn = episode_rng(scenario.episode, Purpose.REACTION).random(len(scenario.humans)) < self.config.yielding
            return [
                bool(yields) and human.encounter != STANDING
                for yields, human in zip(drawn, scenario.humans, strict=True)
            ]
        return self.script.scenario(scenario.episode, static=not scenario.humans)[1]


def handle_human_plan(planner: HumanPlanner, request: HumanPlanRequest) -> HumanPlanReply:
    """Draw the scenario of an episode, or play the file's; what cannot take place is rejected with a short reason."""
    planner = planner.of(request.episode)
    rng = episode_rng(request.episode, Purpose.SCENARIO)
    static = request.static or _nobody_walks(request.episode, planner.config)
    try:
        if planner.script is None:
            scenario = planner.sampler.draw(request.episode, rng, planner.avatar_names, static=static)
        else:
            scenario, _ = planner.script.scenario(request.episode, static=static)
        if planner.config.reactive and any(reacts := planner.reacts(scenario)):
            scenario = let_react(planner, scenario, reacts)
    except RejectedError as reason:
        return HumanPlanReply(episode=request.episode, rejected=str(reason))
    return HumanPlanReply(episode=request.episode, scenario=scenario)


def _nobody_walks(episode: EpisodeKey, config: HumanPlannerConfig) -> bool:
    drawn = episode_rng(episode, Purpose.ABSENCE).random()
    return episode.index < config.absent_first or bool(drawn < config.absent)


def let_react(planner: HumanPlanner, scenario: Scenario, reacts: Sequence[bool]) -> Scenario:
    """The scenario with the walks of humans who see the expert drive; after its end they continue alone.

    Args:
        planner: Maps, robot and expert.
        scenario: With drawn trajectories.
        reacts: Who yields, by the order of the humans; the others keep to their trajectories.

    Raises:
        RejectedError: If humans run into each other.
    """
    assert planner.make_expert is not None
    config = planner.episode_config
    contact_m = planner.robot.radius_m + config.human_radius_m
    drawn = [human.xy_m for human in scenario.humans]
    humans = ReactiveHumans(drawn, reacts, planner.human_map, contact_m, config)
    simulation = ReactiveSimulation(scenario, humans, planner.maps.robot, planner.robot, config)
    run_episode(simulation, ExpertDriver(planner.make_expert))
    while not humans.at_rest and len(humans.xy_m) < round(config.time_limit_s * RATE_HZ):
        humans.advance(None)
    walked = walked_scenario(scenario, humans)
    for a, b in itertools.combinations(walked.humans, 2):
        if nearest_m(a.xy_m, b.xy_m) < 2 * config.human_radius_m - 0.05:
            raise RejectedError(IN_THE_WAY)
    return walked
